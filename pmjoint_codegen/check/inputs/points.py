"""Points for kernels: random points, and points chosen to be hard.

Hard points: zeros of either sign, denormal, tiny and huge numbers, control values at and beside the
actuator's limit, and control values that cancel to nearly nothing. There are also points where the
model's functions are of order one: see :mod:`features`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.inputs.estimates import order_ranges, place_estimates
from pmjoint_codegen.check.inputs.features import Features
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.chain import actuator_of
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.manifest import ADAPTATION, Function, Manifest

Array = npt.NDArray[np.float64]
Draw = Callable[[int], Array]


@dataclass(frozen=True)
class Batch:
    """Points of one kind for one kernel.

    Attributes:
        kind: what is special about them.
        arguments: one for each input, shape (points, size).
    """

    kind: str
    arguments: tuple[Array, ...]


def batches(
    evaluator: Evaluator,
    function: Function,
    count: int,
    seed: int,
    *,
    extreme: bool,
    features: Features | None = None,
    y_range: tuple[float, float] | None = None,
) -> list[Batch]:
    """Points for one kernel.

    Args:
        evaluator: to place the control value; its manifest describes the inputs.
        function: the kernel.
        count: points of each kind.
        seed: of the random numbers; equal seeds give equal points.
        extreme: include magnitudes that overflow and underflow.
        features: of the model, to visit each place where its functions are of order one at least once.
        y_range: least and greatest y that the design is for. Angles beyond are folded into it: a muscle's
            exponential force overflows at a hundred turns.
    """
    random = np.random.default_rng([seed, *function.name.encode()])

    moderate = _moderate_draws(random)

    def drawn(draw: Draw, rows: int, *, learnt: bool = True) -> tuple[Array, ...]:
        arguments = _arguments(evaluator, function, draw, rows, random)
        if learnt:
            place_estimates(evaluator.manifest, function, arguments, random)
        return _folded(function, arguments, y_range)

    draws = _draws(random) if extreme else moderate
    found = [Batch(kind, drawn(draw, count, learnt=kind in moderate)) for kind, draw in draws.items()]
    for kind, level in (("v near a limit", "limit"), ("v cancels", "zero")):
        arguments = drawn(draws["random"], count)
        placed = _place(evaluator, function, arguments, level, random)
        found += [Batch(kind, placed)] if placed is not None else []
    for kind, draw in (("slow", "slow"), ("at rest", "all zero")):
        arguments = drawn(draws[draw], count)
        found.append(Batch(f"{kind} and unforced", _unforced(function, arguments)))
    if extreme and any(label == "p" for label, _ in function.inputs):
        # Near their defaults, parameters keep their signs, and |p| is p.
        arguments = drawn(draws["random"], count)
        found.append(Batch("parameters of either sign", _signed_parameters(function, arguments, random)))
    if features is not None and (needed := features.count(function)):
        moved = features.near(function, drawn(draws["random"], max(count, needed)), random)
        if moved is not None:
            found.append(Batch("functions of order one", _folded(function, moved, y_range)))
    return found


def _folded(
    function: Function, arguments: tuple[Array, ...], y_range: tuple[float, float] | None
) -> tuple[Array, ...]:
    """Points with y, the first state, within a range; those within it already stay."""
    if y_range is None:
        return arguments
    low, high = y_range
    folded = [array.copy() for array in arguments]
    for (label, size), array in zip(function.inputs, folded, strict=True):
        if label in ("y", "x", "X") and size:
            y = array[:, 0]
            array[:, 0] = np.where((low <= y) & (y <= high), y, low + np.mod(y - low, high - low))
    return tuple(folded)


def _unforced(function: Function, arguments: tuple[Array, ...]) -> tuple[Array, ...]:
    """Points without input: in Taylor coefficients, fast motion hides slow motion and time dependence."""
    return tuple(
        np.zeros_like(array) if label in ("g", "w") else array
        for (label, _), array in zip(function.inputs, arguments, strict=True)
    )


def _signed_parameters(
    function: Function, arguments: tuple[Array, ...], random: np.random.Generator
) -> tuple[Array, ...]:
    """Every parameter with a random sign of its own."""
    return tuple(
        array * random.choice(np.array([-1.0, 1.0]), array.shape) if label == "p" else array
        for (label, _), array in zip(function.inputs, arguments, strict=True)
    )


def _moderate_draws(random: np.random.Generator) -> dict[str, Draw]:
    def signs(size: int) -> Array:
        return random.choice(np.array([-1.0, 1.0]), size)

    return {
        "random": lambda size: random.uniform(-3.0, 3.0, size),
        "many scales": lambda size: signs(size) * 10.0 ** random.uniform(-9.0, 2.0, size),
        "zeros": lambda size: random.uniform(-3.0, 3.0, size) * random.integers(0, 2, size),
        "all zero": lambda size: np.zeros(size),
        "slow": lambda size: random.uniform(-1e-3, 1e-3, size),
    }


def _draws(random: np.random.Generator) -> dict[str, Draw]:
    def signed(magnitude: npt.NDArray[np.floating[Any]]) -> Array:
        return np.asarray(random.choice(np.array([-1.0, 1.0]), len(magnitude)) * magnitude, dtype=np.float64)

    return {
        **_moderate_draws(random),
        "signed zeros": lambda size: signed(np.zeros(size)),
        "denormal": lambda size: signed(random.integers(1, 2**52, size) * 2.0**-1074),
        "tiny": lambda size: signed(10.0 ** random.uniform(-300.0, -100.0, size)),
        "huge": lambda size: signed(10.0 ** random.uniform(100.0, 300.0, size)),
        "mixed": lambda size: signed(10.0 ** random.uniform(-320.0, 308.0, size)),
    }


def _arguments(
    evaluator: Evaluator, function: Function, draw: Draw, count: int, random: np.random.Generator
) -> tuple[Array, ...]:
    """One array per input: parameters near their defaults, time in the horizon, real modes, others drawn."""
    manifest = evaluator.manifest
    special: Mapping[str, Callable[[int], Array]] = {
        "p": lambda _size: parameter_values(manifest, count, random),
        "t": lambda size: random.uniform(0.0, manifest.simulation.horizon, (count, size)),
        "g": lambda size: _with_sides(_modes(evaluator, count, random), manifest, random, size),
        "held": lambda _size: _flags(count, len(manifest.kinks), random),
        "R": lambda size: 10.0 ** random.uniform(-4.0, 2.0, (count, size)),
        "P": lambda size: 10.0 ** random.uniform(-4.0, 2.0, (count, size)),
    }
    if manifest.kinks and dict(function.inputs).get("w", 0) > manifest.nw:
        special = {
            **special,
            "w": lambda size: _with_sides(
                draw(count * manifest.nw).reshape(count, manifest.nw), manifest, random, size
            ),
        }
    return tuple(
        special[label](size) if label in special else draw(count * size).reshape(count, size)
        for label, size in function.inputs
    )


def parameter_values(manifest: Manifest, count: int, random: np.random.Generator) -> Array:
    """Parameters at 1/2 to 2 times their defaults, shape (count, size); row 0 holds the defaults.

    Those of estimates that are 0 by default, such as leakage, are drawn from 0 to 1, so that what they
    multiply shows. Guesses are inside their ranges, whose ends are in order.
    """
    defaults = np.array([item.value for item in manifest.parameters])
    values = defaults * random.uniform(0.5, 2.0, (count, len(defaults)))
    for i, item in enumerate(manifest.parameters):
        if item.kind == ADAPTATION and item.value == 0:
            values[:, i] = random.uniform(0.0, 1.0, count)
    values[0] = defaults
    for i, item in enumerate(manifest.parameters):
        if item.kind == "switch":
            values[:, i] = random.integers(0, 2, count)
    order_ranges(manifest, values, random)
    return np.ascontiguousarray(values)


def _modes(evaluator: Evaluator, count: int, random: np.random.Generator) -> Array:
    """Actuators of random saturation modes, for the default parameters, shape (count, 2 nw)."""
    modes = _actuator(evaluator).modes
    return np.ascontiguousarray(modes[random.integers(0, len(modes), count)])


def _with_sides(actuation: Array, manifest: Manifest, random: np.random.Generator, size: int) -> Array:
    """The given actuator entries, then a random side of every kink, then, to `size`, which of them holds."""
    kinks = len(manifest.kinks)
    sides = random.choice(np.array([-1.0, 1.0]), (len(actuation), kinks))
    flags = np.empty((len(actuation), 0))
    if size > actuation.shape[1] + kinks:
        flags = _flags(len(actuation), kinks, random)
    return np.ascontiguousarray(np.hstack([actuation, sides, flags]))


def _flags(count: int, kinks: int, random: np.random.Generator) -> Array:
    """Which kink holds a run: one or none, shape (count, kinks)."""
    return np.ascontiguousarray(np.eye(kinks + 1, kinks)[random.integers(0, kinks + 1, count)])


def _actuator(evaluator: Evaluator) -> Actuator:
    defaults = np.array([item.value for item in evaluator.manifest.parameters])
    return actuator_of(evaluator, defaults)


def _place(
    evaluator: Evaluator,
    function: Function,
    arguments: tuple[Array, ...],
    level: str,
    random: np.random.Generator,
) -> tuple[Array, ...] | None:
    """Move the last compensator state, in which v is affine, until v is at a level; None without v."""
    labels = [label for label, _ in function.inputs]
    manifest = evaluator.manifest
    state = next((labels.index(label) for label in ("X", "s") if label in labels), None)
    if state is None or not ({"t", "X", "p"} <= set(labels) or {"y", "s", "y_r", "p"} <= set(labels)):
        return None
    last = manifest.blocks["r"][1] - 1 - (0 if labels[state] == "X" else manifest.nx)
    moved = [array.copy() for array in arguments]
    given = dict(zip(labels, moved, strict=True))
    ends = []
    for value in (0.0, 1.0):
        moved[state][:, last] = value
        ends.append(_control(evaluator, given))
    slope = ends[1] - ends[0]
    levels = _levels(evaluator, len(slope), level, random)
    moved[state][:, last] = (levels - ends[0]) / np.where(slope == 0, 1.0, slope)
    return tuple(moved)


def _control(evaluator: Evaluator, given: Mapping[str, Array]) -> Array:
    """Control value v at some points, shape (points,)."""
    if "X" in given:
        place = next(i for i, item in enumerate(evaluator.manifest.signals) if item.name == "v")
        return evaluator.call("signals", given["t"], given["X"], given["p"])[0][:, place]
    return evaluator.call("law", given["y"], given["s"], given["y_r"], given["p"])[2][:, 0]


def _levels(evaluator: Evaluator, count: int, level: str, random: np.random.Generator) -> Array:
    thresholds = _actuator(evaluator).thresholds
    if level == "zero" or not len(thresholds):
        return np.zeros(count)
    beside = 1 + random.integers(-2, 3, count) * 2.0**-52
    return np.asarray(random.choice(thresholds, count) * beside, dtype=np.float64)


def describe_point(function: Function, arguments: tuple[Array, ...], row: int) -> str:
    """One point as text that can be pasted: every digit of every input."""
    return ", ".join(
        f"{label}=[{', '.join(repr(float(x)) for x in array[row])}]"
        for (label, _), array in zip(function.inputs, arguments, strict=True)
    )
