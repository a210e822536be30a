"""The data of ``self_test``: a short run from either start, exact results, and a derived tolerance for each.

The results are exact to fifty digits; the tolerances are the bounds of `bounds` on the C's rounding errors.
The inputs jump about, so that u meets its limits and every gain and coefficient acts on v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.export import fields
from pmjoint_codegen.export.fields import INTEGER, defaults, nearest
from pmjoint_codegen.export.lines import Line
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import TEMPLATES, Identity, replaced
from pmjoint_codegen.export.tree import Precision
from pmjoint_codegen.export.twin import COMMAND, Arithmetic, Twin, bounded_arithmetic, exact_arithmetic

ROWS: Final = 8  # samples from either start
_DIGITS: Final = 5  # of the inputs
_DOUBLINGS: Final = 30  # of the reference
_NEAR: Final = range(ROWS // 2, ROWS)  # samples before which a rate-limited command is put near a limit


@dataclass(frozen=True)
class Sample:
    """One sample.

    Attributes:
        y: measured.
        y_r: the reference and its derivatives.
        measured_u: None where the controller's own u acts.
        command: what the actuator was told before, where a rate keeps the samples from getting there.
        expected: each output, exact.
        tolerance: bound on the error of each.
    """

    y: float
    y_r: tuple[float, ...]
    measured_u: float | None
    command: float | None
    expected: tuple[float, ...]
    tolerance: tuple[float, ...]


def twin_of(program: Program, arithmetic: Arithmetic, precision: Precision, *, matched: bool) -> Twin:
    """The controller with the model's own parameters."""
    values = {symbol: arithmetic.number(value) for symbol, value in defaults(program, precision).items()}
    T = nearest(program.derivation.model.simulation.sample_time, precision)
    return Twin(program, arithmetic, values, arithmetic.number(T), matched)


@np.errstate(all="ignore")  # what overflows has no bound, and is refused
def recorded(program: Program, precision: Precision, *, matched: bool) -> tuple[Sample, ...]:
    """The samples from one start.

    Raises:
        ModelError: a result or the bound on its error is no number of the precision: nothing could be tested.
    """
    plan, samples = _plan(program, precision), []
    exact = twin_of(program, exact_arithmetic(), precision, matched=matched)
    bounded = twin_of(program, bounded_arithmetic(precision), precision, matched=matched)
    for k, given in enumerate(plan):
        both = [_stepped(twin, k, *given) for twin in (exact, bounded)]
        expected = tuple(nearest(float(value), precision) for value in both[0])
        spread = [
            float(item.error) + 2.0 * precision.roundoff * abs(value) + precision.smallest
            for item, value in zip(both[1], expected, strict=True)
        ]
        tolerance = tuple(_up(value, precision) for value in spread)
        if not np.all(np.isfinite([*expected, *tolerance])):
            raise _boundless(program, precision, k)
        samples.append(Sample(*given, expected, tolerance))
    return tuple(samples)


def _boundless(program: Program, precision: Precision, k: int) -> ModelError:
    """Why a controller is not written in a precision."""
    adaptation = program.derivation.model.adaptation
    learns = adaptation is not None and bool(adaptation.unknown)
    gains = "lower gains of [adaptation]" if learns else "lower gains of [design]"
    other = "--precision double, " if precision.suffix else ""
    return ModelError(
        f"sample {k + 1} of the self test has no finite bound on what rounding errors of {precision.name} do "
        "to the controller",
        where="export",
        remedy=f"give {other}{gains}, or a shorter sample_time",
    )


Given = tuple[float, tuple[float, ...], float | None, float | None]  # as in `Sample`


def _stepped(
    twin: Twin, k: int, y: float, y_r: tuple[float, ...], measured: float | None, command: float | None
) -> list[Any]:
    """The outputs of a twin's sample k."""
    number = twin.arithmetic.number
    given = number(y), [number(entry) for entry in y_r]
    if k == 0:
        twin.reset(*given)
    if command is not None:
        twin.values[COMMAND] = number(command)
    found = twin.step(*given, None if measured is None else number(measured))
    return [found[symbol] for symbol in outputs(twin.program)]


def _plan(program: Program, precision: Precision) -> list[Given]:
    """The inputs of every sample.

    The reference swings by the least power of two, relative to y, for which v passes both limits. Where a
    rate holds the command back, it is put near the limit that v asks for.
    """
    numbers, model = _numbers(program, precision), program.derivation.model
    lower, upper = (float(limit.xreplace(numbers)) for limit in model.limits)
    factor = 1.0
    for _ in range(_DOUBLINGS):
        plan: list[Given] = [(*inputs(program, precision, k, factor), None) for k in range(ROWS)]
        twin = twin_of(program, bounded_arithmetic(precision), precision, matched=False)
        v = [float(_stepped(twin, k, *given)[0].value) for k, given in enumerate(plan)]
        if min(v) < lower and max(v) > upper:
            break
        factor *= 2.0
    if "rate" not in model.chain:
        return plan
    reach = 0.3 * float(model.chain["rate"].xreplace(numbers)) * model.simulation.sample_time
    near = [max(upper - reach, lower) if value > 0 else min(lower + reach, upper) for value in v]
    return [(*given[:3], _short(near[k], precision) if k in _NEAR else None) for k, given in enumerate(plan)]


def outputs(program: Program) -> tuple[sp.Symbol, ...]:
    """What is compared, in the order of the structure of outputs."""
    s = program.derivation.signals
    return (s.v, COMMAND, s.u, *program.estimate, *s.z)


def inputs(
    program: Program, precision: Precision, k: int, factor: float
) -> tuple[float, tuple[float, ...], float | None]:
    """Y, the reference and the measured u of sample k.

    Args:
        program: of the controller.
        precision: of the numbers.
        k: which sample, from 0.
        factor: how far the reference swings, relative to y.
    """
    d = program.derivation
    scale = abs(d.model.simulation.x0[0]) or 1.0
    if d.model.y_range is not None:
        scale = min(scale, 0.9 * min(abs(end) for end in d.model.y_range))
    y = _short(scale * math.sin(0.9 + 1.7 * k), precision)
    y_r = tuple(
        _short(0.8 * scale * factor * math.cos(0.7 * k + 1.1 * order), precision)
        for order in range(len(d.signals.y_r))
    )
    limit = float(d.model.least_limit.xreplace(_numbers(program, precision)))
    measured = _short(0.6 * limit * math.cos(2.3 * k), precision) if k % 3 == 2 else None
    return y, y_r, measured


def _numbers(program: Program, precision: Precision) -> dict[sp.Symbol, sp.Float]:
    return {symbol: sp.Float(value) for symbol, value in defaults(program, precision).items()}


def _short(value: float, precision: Precision) -> float:
    return nearest(float(f"{value:.{_DIGITS}g}"), precision)


def _up(value: float, precision: Precision) -> float:
    """A number of the precision that is not below a double."""
    return nearest(value * (1.0 + 4.0 * precision.roundoff), precision)


def self_test_lines(program: Program, identity: Identity, precision: Precision) -> list[Line]:
    """The self test in C."""
    given = [item.name for item in fields.input_fields(program)]
    rated = "rate" in program.derivation.model.chain
    taken = [item.name for item in fields.output_fields(program) if item.kind != INTEGER]
    data: list[str] = []
    for matched in (False, True):
        data.append("    { /* matched start */" if matched else "    { /* start at zero */")
        for sample in recorded(program, precision, matched=matched):
            data += _row(sample, precision, rated=rated)
        data.append("    }," if not matched else "    }")
    words = {
        "rows": str(ROWS),
        "inputs": str(len(given) + 2 * rated),
        "outputs": str(len(taken)),
        "found": ", ".join(f"out.{name}" for name in taken),
        "data": "\n".join(data),
        "begin": _settings(given, precision, " " * 8),
        "set": _settings(given, precision, " " * 12),
        "prepare": "\n".join(_prepared(len(given), precision) if rated else []),
        "name": identity.prefix,
        "real": precision.name,
        "f": precision.suffix,
    }
    template = (TEMPLATES / "self_test.c.in").read_text(encoding="utf-8")
    lines = [line for line in template.splitlines() if rated or line != "@prepare@"]
    return [Line(text) for text in replaced("\n".join(lines), words).splitlines()]


def _settings(names: list[str], precision: Precision, indent: str) -> str:
    """Statements that take the input from a row."""
    lines: list[str] = []
    for place, name in enumerate(names):
        if name == "use_measured_u":
            lines.append(f"in.{name} = 0;")
            lines.append(f"if (row[{place}] > {precision.literal(0.5)}) {{")
            lines += [f"    in.{name} = 1;", "}"]
        else:
            lines.append(f"in.{name} = row[{place}];")
    return "\n".join(indent + line for line in lines)


def _prepared(place: int, precision: Precision) -> list[str]:
    """Put the command where a row says."""
    return [
        f"            if (row[{place}] > {precision.literal(0.5)}) {{ /* as if many samples had passed */",
        f"                state.command = row[{place + 1}];",
        "            }",
    ]


def _row(sample: Sample, precision: Precision, *, rated: bool) -> list[str]:
    """One sample as an initialiser, a line for the inputs and one for each output."""
    optional = [sample.measured_u, *([sample.command] if rated else [])]
    pairs_of = [(0.0, 0.0) if value is None else (1.0, value) for value in optional]
    flat = [entry for pair in pairs_of for entry in pair]
    text = [precision.literal(value) for value in (sample.y, *sample.y_r, *flat)]
    pairs = [
        f"         {precision.literal(value)}, {precision.literal(tolerance)}"
        for value, tolerance in zip(sample.expected, sample.tolerance, strict=True)
    ]
    return [f"        {{{', '.join(text)},", ",\n".join(pairs) + "},"]
