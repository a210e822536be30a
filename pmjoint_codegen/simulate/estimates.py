"""An adaptive controller's estimates, what they are of, and the run in which they stand still.

An estimate is no identified parameter: only a reference that excites the loop brings it to the truth.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen.initial import Variable
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.logits import estimate_name
from pmjoint_codegen.manifest import ADAPTATION, Manifest
from pmjoint_codegen.simulate.pace import leading as b_m
from pmjoint_codegen.values import evaluate

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

LYAPUNOV: Final = "V"  # column
HAT: Final = "_hat"
RHO_HAT: Final = f"rho{HAT}"  # of 1/b_m
GUESS: Final = "_guess"
GAMMA: Final = "gamma_"
LEAKAGE: Final = "leakage"
INITIAL_GAIN: Final = "ls_P0"  # of least squares, whose gain stays 0 if it starts there
_OF_STATES: Final = ("Theta", "rho")  # blocks of X


@dataclass(frozen=True)
class Estimate:
    """One estimate of a run.

    Attributes:
        name: of its column, such as ``b0_hat``.
        of: what it estimates: ``b0``, ``d1``, ``w``, or ``1/b0``, where ``b0`` is b_m.
        unit: physical unit.
        guess: where it starts.
        truth: the plant's own value.
        range: the open interval that it stays in; None if it has none.
    """

    name: str
    of: str
    unit: str
    guess: float
    truth: float
    range: tuple[float, float] | None


@dataclass(frozen=True)
class Guess:
    """What a controller first takes for an entry that it does not know, or, unless it is estimated, for good.

    Attributes:
        of: the entry: ``b0``, ``d1``, ``w``.
        value: of the guess.
        truth: the plant's own value; None where no parameter has it.
        leading: whether the entry is b_m.
        kept: whether the controller never changes it.
    """

    of: str
    value: float
    truth: float | None
    leading: bool
    kept: bool


@dataclass(frozen=True)
class FrozenError:
    """The tracking error of the same run with estimates that stay at their guesses.

    Attributes:
        t: output instants, s, shape (rows,); fewer than those of the run where this one ended early.
        e: in the unit of e, shape (rows,).
    """

    t: Array
    e: Array


def is_adaptive(manifest: Manifest) -> bool:
    """Whether a controller has estimates."""
    return any(block in manifest.blocks for block in _OF_STATES)


def estimates(run: Record) -> tuple[Estimate, ...]:
    """The estimates of a run at its parameters, b_m's first; none without an adaptive controller."""
    return tuple(_estimates(run.manifest, run.settings.parameters))


def _estimates(manifest: Manifest, values: Mapping[str, float]) -> Iterator[Estimate]:
    columns = {name: np.array(value) for name, value in values.items()}
    for item in estimate_columns(manifest):
        name = item.name.removesuffix(HAT)
        with np.errstate(all="ignore"):  # a truth that is not finite is shown as such
            truth = float(evaluate(ast.parse(item.truth, mode="eval").body, columns))
        yield Estimate(
            name=item.name,
            of=f"1/b{manifest.m}" if item.name == RHO_HAT else name,
            unit=item.unit,
            guess=values[f"{name}{GUESS}"],
            truth=truth,
            range=range_of(item.name, values),
        )


def guesses(run: Record) -> tuple[Guess, ...]:
    """All guesses of a run at its parameters, in the order of the kernels; that of 1/b_m is none of them."""
    manifest, values = run.manifest, run.settings.parameters
    learnt = {item.name for item in estimate_columns(manifest)}
    leading = (f"b{manifest.m}", manifest.leading)
    found = [
        item.name.removesuffix(GUESS)
        for item in manifest.settable
        if item.kind == ADAPTATION and item.name.endswith(GUESS)
    ]
    return tuple(
        Guess(
            of=name,
            value=values[f"{name}{GUESS}"],
            truth=b_m(manifest, values) if name in leading else values.get(name),
            leading=name in leading,
            kept=f"{name}{HAT}" not in learnt,
        )
        for name in found
        if f"{name}{HAT}" != RHO_HAT
    )


def has_lyapunov(run: Record) -> bool:
    """Whether V has a value anywhere: it has none where a true value is outside its range, or a gain is 0."""
    return LYAPUNOV in run.columns and bool(np.any(np.isfinite(run[LYAPUNOV])))


def estimate_columns(manifest: Manifest) -> tuple[Variable, ...]:
    """The estimates, in the order of their states: a state, or of one with a range a signal."""
    known = {item.name: item for item in (*manifest.states, *manifest.signals)}
    names = (
        estimate_name(state.name)
        for block in _OF_STATES
        for state in manifest.states[slice(*manifest.blocks.get(block, (0, 0)))]
    )
    return tuple(known[name] for name in names)


def range_of(name: str, values: Mapping[str, float]) -> tuple[float, float] | None:
    """The ends between which an estimate stays; None of one without a range.

    Args:
        name: of its column.
        values: parameters by name.
    """
    low, high = (f"{name.removesuffix(HAT)}_{end}" for end in ("low", "high"))
    return (values[low], values[high]) if low in values else None


def leaking(name: str) -> tuple[str, str, str]:
    """The parameters of an estimate's leakage: its gain, the leakage itself, where it pulls to."""
    stem = name.removesuffix(HAT)
    return f"{GAMMA}{stem}", "rho_leakage" if name == RHO_HAT else LEAKAGE, f"{stem}_prior"


def stale_defaults(run: Record) -> list[str]:
    """What the file left to follow from a guess, and a run with another guess left where it was."""
    values = run.settings.parameters
    file = {item.name: item.value for item in run.manifest.parameters}
    b_m = f"b{run.manifest.m}_guess"
    follows = {"rho_guess": b_m} | {f"{item.name.removesuffix(HAT)}_prior": "" for item in estimates(run)}
    found = []
    for name, guess in follows.items():
        guess = guess or f"{name.removesuffix('_prior')}_guess"
        if name not in values or guess not in values or values[guess] == file[guess]:
            continue
        wanted, was = (1 / of[guess] if name == "rho_guess" else of[guess] for of in (values, file))
        if values[name] == file[name] == was and (name == "rho_guess" or _pulls(values, name)):
            found.append(
                f"{name} is still {was:.4g}, but {guess} is {values[guess]:g}: set it to {wanted:.4g}"
            )
    return found


def _pulls(values: Mapping[str, float], prior: str) -> bool:
    """Whether leakage pulls to a prior."""
    gain, leakage, _ = leaking(f"{prior.removesuffix('_prior')}{HAT}")
    return values.get(gain, 0.0) * values.get(leakage, 0.0) > 0.0


def frozen_parameters(manifest: Manifest) -> dict[str, float]:
    """The parameters with which every estimate stays at its guess: gains of 0."""
    names = [item.name for item in manifest.settable if item.kind == ADAPTATION]
    return {name: 0.0 for name in names if name.startswith(GAMMA) or name == INITIAL_GAIN}


def is_frozen(run: Record) -> bool:
    """Whether all estimates of a run stay at their guesses."""
    values = run.settings.parameters
    return all(values[name] == 0.0 for name in frozen_parameters(run.manifest))


def frozen_error(run: Record) -> FrozenError:
    """The part of a frozen run that figures show."""
    return FrozenError(run.t, run["e"])
