"""What a run reports besides its states, at its output instants.

That of a sampled run is as of the sample, except for what moves in between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import ACTING, CLOCK, COMMAND, FILTERED, MEASURED, U
from pmjoint_codegen.loops.constants import SAME_INSTANT
from pmjoint_codegen.loops.logits import inside
from pmjoint_codegen.loops.problem import Memory, Problem
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.estimates import range_of
from pmjoint_codegen.simulate.located import Holds

INSTANTANEOUS: Final = ("y", "y_r", "e")  # signals that a sampled controller does not hold constant
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
        return _inside(
            evaluator.manifest, problem.p, _reported(evaluator, problem, holds, "signals", times, states)
        )
    if problem.n_history:
        return _chained_signals(evaluator, problem, states, memory, holds)
    # Constant since the last sample, except for the plant and the reference.
    since, samples = memory.row_sample_times[:rows, np.newaxis], memory.row_samples[:rows]
    signals = _evaluated(evaluator, problem, "signals", since, samples)
    w = _actuated(evaluator, problem, signals[:, _place(evaluator.manifest, "v")])
    _put_live(evaluator, problem, states, w, signals, holds)
    return signals


def _inside(manifest: Manifest, p: Array, signals: Array) -> Array:
    """The same with each estimate strictly inside its range."""
    values = dict(zip(manifest.parameter_names, p.tolist(), strict=False))  # a segment's follow
    for place, item in enumerate(manifest.signals):
        ends = range_of(item.name, values) if item.truth else None
        if ends is not None:
            signals[:, place] = inside(signals[:, place], *ends)
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
    w = held[:, ACTING:]
    known = {
        "y_m": held[:, MEASURED],
        "y_f": held[:, FILTERED],
        "u": held[:, U],
        "u_command": held[:, COMMAND],
    }
    if "u_valve" in places:
        known["u_valve"] = w[:, 1]
    for name, column in known.items():
        if name in places:
            signals[:, places[name]] = column
    _put_live(evaluator, problem, states, w, signals, holds)
    return signals


def _put_live(
    evaluator: Evaluator, problem: Problem, states: Array, w: Array, signals: Array, holds: Holds
) -> None:
    """Signals of a sampled run that move between samples: y, y_r, e, and all that the plant reports.

    These are D and, of a joint or a system, the physical quantities; they depend on what acts, w.
    """
    manifest, times = evaluator.manifest, problem.times[: len(states), np.newaxis]
    y, y_r, e, D = (_place(manifest, name) for name in (*INSTANTANEOUS, "D1"))
    signals[:, y] = states[:, 0]
    signals[:, y_r] = _evaluated(evaluator, problem, "reference", times)[:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    acting = _reported(evaluator, problem, holds, "disturbance", times, states[:, : manifest.nx], w)
    signals[:, D : D + acting.shape[1]] = acting


def _place(manifest: Manifest, name: str) -> int:
    """Where a signal stands among the signals."""
    return next(i for i, item in enumerate(manifest.signals) if item.name == name)


def _reported(
    evaluator: Evaluator, problem: Problem, holds: Holds, kernel: str, times: Array, *others: Array
) -> Array:
    """``signals`` or ``disturbance`` at instants, with the side that holds where one does."""
    if not len(holds.begins):
        return _evaluated(evaluator, problem, kernel, times, *others)
    flags = holds.flags(times[:, 0], problem.n_kinks)
    return _evaluated(evaluator, problem, f"{kernel}_held", times, *others, flags)


def _evaluated(evaluator: Evaluator, problem: Problem, kernel: str, times: Array, *others: Array) -> Array:
    """A kernel's results side by side, shape (rows, size), each instant in its segment of the reference."""
    if not problem.n_breaks:
        return np.hstack(evaluator.call(kernel, times, *others, problem.p))
    slack = SAME_INSTANT * problem.sample_time  # as the sampled loop has it
    places = np.searchsorted(problem.breaks, times[:, 0] + slack, side="right")
    found = []
    for start in range(0, len(times), ROWS):  # a whole table of p may be larger than all results
        part = slice(start, start + ROWS)
        p = np.tile(problem.p, (len(places[part]), 1))
        p[:, -problem.n_segment :] = problem.segments[places[part]]
        found.append(np.hstack(evaluator.call(kernel, times[part], *(array[part] for array in others), p)))
    return np.concatenate(found)


def _actuated(evaluator: Evaluator, problem: Problem, v: Array) -> Array:
    """What the actuator delivers for a held v, shape (rows, nw)."""
    (limits,) = evaluator.call("actuation", problem.p)
    offset, slope, lower, upper = limits.reshape(evaluator.manifest.nw, 4).T
    with np.errstate(all="ignore"):  # a failed run may end in infinities
        return np.clip(offset + slope * v[:, np.newaxis], lower, upper)
