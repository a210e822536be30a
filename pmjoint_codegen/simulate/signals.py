"""What a run reports besides its states, at its output instants.

That of a sampled run is as of the sample, except for what moves in between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import ACTING, CLOCK, COMMAND, FILTERED, MEASURED, U
from pmjoint_codegen.loops.constants import SAME_INSTANT
from pmjoint_codegen.loops.problem import Memory, Problem
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.located import Holds
from pmjoint_codegen.values import of_plant

INSTANTANEOUS: Final = ("y", "y_r", "e")  # signals that a sampled controller does not hold constant
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag
ROWS: Final = 4096  # computed at a time where each has its own segment of the reference


def signals_of(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory, holds: Holds) -> Array:
    """The signals of the manifest, shape (rows, signals).

    Args:
        evaluator: of the kernels.
        problem: constants of the run.
        states: at the output instants, shape (rows, nX).
        memory: of a sampled run: the last sample before each row.
        holds: when a kink held the plant.
    """
    rows = len(states)
    times = problem.times[:rows, np.newaxis]
    if not problem.sample_time:
        return _reported(evaluator, problem, holds, "signals", times, states)
    if problem.n_history:
        return _chained_signals(evaluator, problem, states, memory, holds)
    # Constant since the last sample, except for the plant and the reference.
    since, samples = memory.row_sample_times[:rows, np.newaxis], memory.row_samples[:rows]
    signals = _evaluated(evaluator, problem, "signals", since, samples)
    _put_live(evaluator, problem, states, signals, holds)
    names = [item.name for item in evaluator.manifest.signals]
    D = [f"D{i}" for i in range(1, evaluator.manifest.n + 1)]
    if D[0] in names:
        w = _actuated(evaluator, problem, signals[:, names.index("v")])
        x = states[:, : evaluator.manifest.nx]
        signals[:, [*map(names.index, D)]] = _reported(evaluator, problem, holds, "disturbance", times, x, w)
    return signals


def _chained_signals(
    evaluator: Evaluator, problem: Problem, states: Array, memory: Memory, holds: Holds
) -> Array:
    """The same where the law takes what a sensor reads, and the plant what an actuator delivers."""
    manifest, rows = evaluator.manifest, len(states)
    held = memory.row_held[:rows]
    seen = memory.row_samples[:rows].copy()
    seen[:, 0] = held[:, FILTERED]
    signals = _evaluated(evaluator, problem, "signals", held[:, CLOCK, np.newaxis], seen)
    places = {item.name: i for i, item in enumerate(manifest.signals)}
    w, times = held[:, ACTING:], problem.times[:rows, np.newaxis]
    D = _reported(evaluator, problem, holds, "disturbance", times, states[:, : manifest.nx], w)
    known = {
        "y_m": held[:, MEASURED],
        "y_f": held[:, FILTERED],
        "u": held[:, U],
        "u_command": held[:, COMMAND],
    }
    known |= {f"D{i}": column for i, column in enumerate(D.T, start=1)}
    if "u_valve" in places:
        known["u_valve"] = w[:, 1]
    physical = set(manifest.start.names)
    if "P1" in places and not physical >= LAGGED and "P1" not in physical:
        values = dict(zip(manifest.parameter_names, problem.p.tolist(), strict=False))
        base = of_plant(values, "k0") * of_plant(values, "u0")
        known |= {"P1": base + w[:, -2], "P2": base - w[:, -1]}
    for name, column in known.items():
        if name in places:
            signals[:, places[name]] = column
    _put_live(evaluator, problem, states, signals, holds)
    return signals


def _put_live(evaluator: Evaluator, problem: Problem, states: Array, signals: Array, holds: Holds) -> None:
    """Signals of a sampled run that move between samples: y, y_r, e, and states of a joint."""
    times = problem.times[: len(states), np.newaxis]
    y, y_r, e = map([item.name for item in evaluator.manifest.signals].index, INSTANTANEOUS)
    signals[:, y] = states[:, 0]
    signals[:, y_r] = _evaluated(evaluator, problem, "reference", times)[:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        live = _reported(evaluator, problem, holds, "signals", times, states)
        signals[:, moving] = live[:, moving]


def _reported(
    evaluator: Evaluator, problem: Problem, holds: Holds, kernel: str, times: Array, *others: Array
) -> Array:
    """``signals`` or ``disturbance`` at instants, with the side that holds where one does."""
    if not len(holds.begins):
        return _evaluated(evaluator, problem, kernel, times, *others)
    flags = holds.flags(times[:, 0], problem.n_kinks)
    return _evaluated(evaluator, problem, f"{kernel}_held", times, *others, flags)


def _evaluated(evaluator: Evaluator, problem: Problem, kernel: str, times: Array, *others: Array) -> Array:
    """A kernel's first result at instants, shape (rows, size), each in its own segment of the reference."""
    if not problem.n_breaks:
        return evaluator.call(kernel, times, *others, problem.p)[0]
    slack = SAME_INSTANT * problem.sample_time  # as the sampled loop has it
    places = np.searchsorted(problem.breaks, times[:, 0] + slack, side="right")
    found = []
    for start in range(0, len(times), ROWS):  # a whole table of p may be larger than all results
        part = slice(start, start + ROWS)
        p = np.tile(problem.p, (len(places[part]), 1))
        p[:, -problem.n_segment :] = problem.segments[places[part]]
        found.append(evaluator.call(kernel, times[part], *(array[part] for array in others), p)[0])
    return np.concatenate(found)


def _moving(manifest: Manifest) -> list[int]:
    """A joint's physical signals that depend only on the plant's states, and so change between samples."""
    names = set(manifest.start.names)
    if (
        names >= LAGGED
    ):  # pressures with their own states; otherwise they are commands, constant between samples
        names |= {"P1", "P2"}
    return [i for i, item in enumerate(manifest.signals) if item.name in names]


def _actuated(evaluator: Evaluator, problem: Problem, v: Array) -> Array:
    """What the actuator delivers for a held v, shape (rows, nw)."""
    (limits,) = evaluator.call("actuation", problem.p)
    offset, slope, lower, upper = limits.reshape(evaluator.manifest.nw, 4).T
    with np.errstate(all="ignore"):  # a failed run may end in infinities
        return np.clip(offset + slope * v[:, np.newaxis], lower, upper)
