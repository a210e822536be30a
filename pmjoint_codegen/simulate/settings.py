"""All settings of one run, checked before it starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal, TypedDict, Unpack

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.chain import MOST_WAITING, clocked
from pmjoint_codegen.errors import UsageError, quoted
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.misplaced import advice
from pmjoint_codegen.reference.reader import command_of
from pmjoint_codegen.reference.segments import Segments, make_segments
from pmjoint_codegen.simulate.divergence import DIVERGENCE, default_divergence
from pmjoint_codegen.values import (
    COMPENSATOR,
    OWN_SUFFIX,
    SI,
    STARTS,
    ZERO,
    check_rules,
    check_values,
    to_si,
)

Controller = Literal["continuous", "sampled"]


class CommandOptions(TypedDict, total=False):
    """Keywords of a run that a command passes on as they are."""

    horizon: float | None
    parameters: Mapping[str, float] | None
    x0: Sequence[float] | Array | None
    output_step: float | None
    controller: str | None
    sample_time: float | None
    compensator: bool | None
    start: str | None
    tolerance: float
    max_step: float | None
    divergence: float | None


class RunOptions(CommandOptions, total=False):
    """Keywords of a run; see `ClosedLoop.simulate`."""

    reference: object


DEFAULT_TOLERANCE: Final = 1e-10
TOLERANCES: Final = (1e-14, 1e-3)
MAX_ROWS: Final = 10_000_000
_LARGE: Final = 1e300


@dataclass(frozen=True)
class Settings:
    """One run, as requested.

    Attributes:
        parameters: name -> value of every parameter, gain and switch, and of the plant's own, in the kernels'
            order and units; `Manifest.written` gives them in the model file's.
        p: the same values as a vector.
        x0: initial states as defined by `Manifest.start`, physical ones for a joint, shape (nx,).
        horizon: s.
        output_step: s.
        controller: ``continuous`` or ``sampled``.
        sample_time: s; used by the sampled controller.
        tolerance: local error, relative to max(1, |value|), of every state and of v.
        max_step: longest integration step, s.
        divergence: |X_i| above it ends the run.
        max_steps: limit of integration steps.
        max_switches: limit of saturation switches.
        start: of the controller: ``zero``, or ``matched`` to the measured output.
        reference: where it is data; None where it is an expression, which the kernels contain.
    """

    parameters: Mapping[str, float]
    p: Array
    x0: Array
    horizon: float
    output_step: float
    controller: Controller
    sample_time: float
    tolerance: float
    max_step: float = math.inf
    divergence: float = DIVERGENCE
    max_steps: int = 10_000_000
    max_switches: int = 100_000
    start: str = ZERO
    reference: Segments | None = None

    __repr__ = brief

    def __getstate__(self) -> dict[str, Any]:
        """Return the parameters as a dictionary: a read-only view cannot be pickled."""
        return {**vars(self), "parameters": dict(self.parameters)}

    @property
    def rows(self) -> int:
        """Number of output instants: every multiple of the step before the horizon, and the horizon."""
        return count_instants(self.horizon, self.output_step)

    def times(self) -> Array:
        """Output instants, s: multiples of the step; the last one is the horizon, multiple or not."""
        return instants(self.horizon, self.output_step)


def count_instants(horizon: float, step: float) -> int:
    """Number of multiples of the step before the horizon, and one for the horizon."""
    return 1 + math.ceil(horizon / step * (1 - 1e-12))


def instants(horizon: float, step: float) -> Array:
    """Multiples of the step before the horizon, and the horizon, s; shape (count_instants(...),)."""
    times = np.arange(count_instants(horizon, step), dtype=np.float64) * step
    times[-1] = horizon
    return times


def make_settings(
    manifest: Manifest, own: Settings | None = None, /, **asked: Unpack[RunOptions]
) -> Settings:
    """Complete a run's settings from the model's defaults and check them.

    Args:
        manifest: the model.
        own: the result for the model without keywords: it is shared, and not checked again.
        asked: see `ClosedLoop.simulate`.

    Raises:
        UsageError: for the first setting that is unknown, of the wrong length, or out of its range.
        TypeError: for a keyword that no run has.
    """
    if not asked.keys() <= RunOptions.__optional_keys__:
        unknown = min(asked.keys() - RunOptions.__optional_keys__)
        raise TypeError(f"a run got an unexpected keyword argument {unknown!r}")
    simulation = manifest.simulation
    overrides, compensator, x0 = asked.get("parameters"), asked.get("compensator"), asked.get("x0")
    known = own if overrides is None and compensator is None else None
    values = known.parameters if known else _values(manifest, overrides or {}, compensator)
    horizon, output_step = asked.get("horizon"), asked.get("output_step")
    length = simulation.horizon if horizon is None else _positive("horizon", horizon, "s")
    step = simulation.output_step if output_step is None else _positive("output step", output_step, "s")
    if step > length:  # the horizon bounds a default; a given value is not changed
        step = length if output_step is None else _at_most("output step", step, length, "the horizon")
    controller = _controller(asked.get("controller") or default_controller(manifest))
    sample_time = asked.get("sample_time")
    period = simulation.sample_time if sample_time is None else _positive("sample time", sample_time, "s")
    if controller == "sampled":  # without a second sample, a sampled controller shows nothing
        _at_most("sample time", period, length, "the horizon")
        _check_clock(manifest, values, period)
    initial = own.x0 if own and x0 is None else _initial(manifest, x0)
    start = simulation.start if asked.get("start") is None else _start(asked["start"])
    tolerance = _tolerance(asked.get("tolerance", DEFAULT_TOLERANCE))
    max_step, divergence = asked.get("max_step"), asked.get("divergence")
    longest = math.inf if max_step is None else _positive("max step", max_step, "s")
    if divergence is not None:
        limit = _positive("--divergence", divergence, "")
    elif known and x0 is None and start == known.start:
        limit = known.divergence
    else:
        limit = default_divergence(manifest, values, initial, start)
    _check_rows(length, step)
    segments = _segments(manifest, own, asked.get("reference"), lambda: instants(length, step))
    p = known.p if known and "reference" not in asked else vector_of(values, segments)
    return Settings(
        values,
        p,
        initial,
        length,
        step,
        controller,
        period,
        tolerance,
        longest,
        limit,
        start=start,
        reference=segments,
    )


def _segments(
    manifest: Manifest, own: Settings | None, given: object, times: Callable[[], Array]
) -> Segments | None:
    """The reference where it is data: the one given, or the model's."""
    if given is None and own is not None:
        return own.reference
    if not manifest.segment:
        if given is None:
            return None
        raise UsageError(
            f"is {quoted(given)}, and these kernels contain an expression of t",
            where="reference",
            remedy="give it to ClosedLoop.load, or ClosedLoop.simulate",
        )
    unit = next(item.unit for item in manifest.signals if item.name == "y_r")
    command = manifest.simulation.command if given is None else command_of(given, instants=times, unit=unit)
    if command is None:
        raise UsageError(
            "has no data",
            where="reference",
            remedy='give some, such as {"steps": [[0, 0], [1, 0.5]], "filter": 10}',
        )
    return make_segments(command, manifest.rho)


def vector_of(values: Mapping[str, float], segments: Segments | None) -> Array:
    """The vector p: values by name, then the reference's first segment."""
    return _vector((*values.values(), *(() if segments is None else segments.rows[0].tolist())))


def _vector(values: Iterable[float]) -> Array:
    """Numbers that several runs share."""
    vector = np.array(list(values), dtype=np.float64)
    vector.flags.writeable = False
    return vector


def _check_rows(horizon: float, step: float) -> None:
    wanted = horizon / step + 1  # infinite if the quotient overflows
    if wanted > MAX_ROWS - 1 and (wanted > MAX_ROWS + 1 or count_instants(horizon, step) > MAX_ROWS):
        raise UsageError(
            f"asks for {wanted:.9g} rows",
            where="output step",
            remedy=f"at most {MAX_ROWS}: a longer step or a shorter horizon",
        )


def _values(
    manifest: Manifest, overrides: Mapping[str, float], compensator: bool | None
) -> Mapping[str, float]:
    if not isinstance(overrides, Mapping):
        raise UsageError(f"is {overrides!r}", where="parameters", remedy="allowed: numbers by name")
    values = {item.name: float(item.value) for item in manifest.settable}
    for name, value in overrides.items():
        if name.removesuffix(OWN_SUFFIX) in values and name not in values:
            base = name.removesuffix(OWN_SUFFIX)
            raise UsageError(
                f"{manifest.name} has no {name!r}: {base} is not used by plant and controller both",
                remedy="; the plant can differ in: ".join(
                    filter(None, [f"set {base}", ", ".join(manifest.own)])
                ),
            )
        if name not in values:
            raise UsageError(
                f"{manifest.name} has no parameter {name!r}", remedy=advice(manifest, name, values)
            )
        values[name] = _number(name, to_si(_number(name, value), manifest.scales.get(name, SI)))
    values |= {own: values[name] for own, name in manifest.own.items() if own not in overrides}
    if compensator is not None:
        values[COMPENSATOR] = float(compensator)
    leading = manifest.leading if manifest.leading in values else None
    check_values(
        values,
        n=manifest.n,
        rho=manifest.rho,
        limit=manifest.limit if manifest.limit in values else None,
        leading=leading,
        where="",
        error=UsageError,
        scales=manifest.scales,
    )
    # The model's own values satisfy its rules: they were checked with its file.
    changed = {*overrides, *(own for own, name in manifest.own.items() if name in overrides)}
    changed |= set() if compensator is None else {COMPENSATOR}
    concerned = (rule for rule in manifest.rules if rule.names & changed)
    check_rules(values, concerned, error=UsageError, scales=manifest.scales)
    return MappingProxyType(values)


def _number(name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]  # a value that float() refuses is refused below
    except (TypeError, ValueError, OverflowError):
        raise UsageError(f"is {value!r}", where=name, remedy="allowed: a finite number") from None
    if not math.isfinite(number):
        raise UsageError(f"is {number}", where=name, remedy="allowed: a finite number")
    return number


def _positive(name: str, value: object, unit: str) -> float:
    if (type(value) is float or type(value) is int) and 0 < value < _LARGE:  # nearly always
        return float(value)
    number = _number(name, value)
    if number <= 0:
        raise UsageError(
            f"is {number:g} {unit}".rstrip(), where=name, remedy="allowed: a number greater than 0"
        )
    return number


def _at_most(name: str, value: float, limit: float, what: str) -> float:
    if value > limit:
        raise UsageError(
            f"is {value:g} s, longer than {what}, {limit:g} s",
            where=name,
            remedy=f"allowed: at most {limit:g} s",
        )
    return value


def _initial(manifest: Manifest, x0: Sequence[float] | Array | None) -> Array:
    entries = (
        manifest.simulation.x0 if x0 is None else tuple(np.atleast_1d(np.asarray(x0, dtype=object)).tolist())
    )
    if len(entries) == manifest.start.required:  # the others start as in the model file
        entries = (*entries, *manifest.simulation.x0[manifest.start.required :])
    if len(entries) != manifest.nx:
        raise UsageError(
            f"has {len(entries)} {'entry' if len(entries) == 1 else 'entries'}",
            where="x0",
            remedy=_initial_rule(manifest),
        )
    return _vector(_number(f"x0, entry {i}", entry) for i, entry in enumerate(entries, start=1))


def _initial_rule(manifest: Manifest) -> str:
    """State how many initial states there are, with and without those that may be omitted."""
    names, required = manifest.start.names, manifest.start.required
    rule = f"{manifest.name} has {manifest.nx} states: {', '.join(names)}"
    if required == len(names):
        return rule
    values = ", ".join(f"{value:g}" for value in manifest.simulation.x0[required:])
    return f"{rule}; give {manifest.nx}, or {required} for {', '.join(names[required:])} = {values}"


def default_controller(manifest: Manifest) -> Controller:
    """``sampled`` for a model with keys that need a clock, else ``continuous``, as in the paper."""
    return "sampled" if clocked(manifest.chain) else "continuous"


def left_out(manifest: Manifest, controller: str) -> tuple[str, ...]:
    """The model's keys that a controller leaves out: those that need a clock, if it has none."""
    return clocked(manifest.chain) if controller == "continuous" else ()


def _check_clock(manifest: Manifest, values: Mapping[str, float], period: float) -> None:
    """Samples stay in order only if none is later than the next; commands that wait are kept in memory."""
    name = manifest.chain.get("jitter")
    if name is not None and values[name] >= period:
        raise UsageError(
            f"is {values[name]:g} s, and the sample time {period:g} s",
            where=name,
            remedy="allowed: less than the sample time",
        )
    for key, unit in (("delay", period), ("delay_samples", 1.0)):
        name = manifest.chain.get(key)
        if name is not None and values[name] > MOST_WAITING * unit:
            raise UsageError(
                f"is {values[name]:g}, more than {MOST_WAITING} samples",
                where=name,
                remedy=f"allowed: at most {MOST_WAITING * unit:g}",
            )


def _controller(name: str) -> Controller:
    if name == "continuous":
        return "continuous"
    if name == "sampled":
        return "sampled"
    raise UsageError(f"is {name!r}", where="controller", remedy="allowed: continuous, sampled")


def _start(name: object) -> str:
    if name not in STARTS:
        raise UsageError(f"is {name!r}", where="start", remedy=f"allowed: {', '.join(STARTS)}")
    return str(name)


def _tolerance(value: object) -> float:
    number = _number("tolerance", value)
    low, high = TOLERANCES
    if not low <= number <= high:
        raise UsageError(f"is {number:g}", where="tolerance", remedy=f"allowed: from {low:g} to {high:g}")
    return number
