"""What a run reports besides its states, at its output instants."""

from __future__ import annotations

from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.constants import SAME_INSTANT
from pmjoint_codegen.loops.problem import Memory, Problem
from pmjoint_codegen.manifest import Manifest

INSTANTANEOUS: Final = ("y", "y_r", "e")  # signals that a sampled controller does not hold constant
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag
ROWS: Final = 4096  # computed at a time where each has its own segment of the reference


def signals_of(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory) -> Array:
    """The signals of the manifest, shape (rows, signals).

    Args:
        evaluator: of the kernels.
        problem: constants of the run.
        states: at the output instants, shape (rows, nX).
        memory: of a sampled run: the last sample before each row.
    """
    times = problem.times[: len(states), np.newaxis]
    if not problem.sample_time:
        return _evaluated(evaluator, problem, "signals", times, states)
    # Constant since the last sample, except for the plant and the reference.
    since, held = memory.row_sample_times[: len(states), np.newaxis], memory.row_samples[: len(states)]
    signals = _evaluated(evaluator, problem, "signals", since, held)
    names = [item.name for item in evaluator.manifest.signals]
    y, y_r, e = map(names.index, INSTANTANEOUS)
    signals[:, y] = states[:, 0]
    signals[:, y_r] = _evaluated(evaluator, problem, "reference", times)[:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        live = _evaluated(evaluator, problem, "signals", times, states)
        signals[:, moving] = live[:, moving]
    acting = [names.index(f"D{i}") for i in range(1, evaluator.manifest.n + 1) if f"D{i}" in names]
    if acting:
        signals[:, acting] = _disturbance(evaluator, problem, times, states, signals[:, names.index("v")])
    return signals


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


def _disturbance(evaluator: Evaluator, problem: Problem, times: Array, states: Array, v: Array) -> Array:
    """D of (12), shape (rows, n): the plant moves and the clock runs while v is held."""
    manifest = evaluator.manifest
    (limits,) = evaluator.call("actuation", problem.p)
    offset, slope, lower, upper = limits.reshape(manifest.nw, 4).T
    with np.errstate(all="ignore"):  # a failed run may end in infinities
        w = np.clip(offset + slope * v[:, np.newaxis], lower, upper)
    return evaluator.call("disturbance", times, states[:, : manifest.nx], w, problem.p)[0]
