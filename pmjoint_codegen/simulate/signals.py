"""What a run reports besides its states, at its output instants."""

from __future__ import annotations

from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.problem import Memory, Problem
from pmjoint_codegen.manifest import Manifest

INSTANTANEOUS: Final = ("y", "y_r", "e")  # signals that a sampled controller does not hold constant
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag


def signals_of(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory) -> Array:
    """The signals of the manifest, shape (rows, signals).

    Args:
        evaluator: of the kernels.
        problem: constants of the run.
        states: at the output instants, shape (rows, nX).
        memory: of a sampled run: the last sample before each row.
    """
    rows = len(states)
    times = problem.times[:rows, np.newaxis]
    if not problem.sample_time:
        return evaluator.call("signals", times, states, problem.p)[0]
    # Constant since the last sample, except for the plant and the reference.
    (signals,) = evaluator.call(
        "signals", memory.row_sample_times[:rows, np.newaxis], memory.row_samples[:rows], problem.p
    )
    names = [item.name for item in evaluator.manifest.signals]
    y, y_r, e = map(names.index, INSTANTANEOUS)
    signals[:, y] = states[:, 0]
    signals[:, y_r] = evaluator.call("reference", times, problem.p)[0][:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        (live,) = evaluator.call("signals", times, states, problem.p)
        signals[:, moving] = live[:, moving]
    acting = [names.index(f"D{i}") for i in range(1, evaluator.manifest.n + 1) if f"D{i}" in names]
    if acting:
        signals[:, acting] = _disturbance(evaluator, problem, times, states, signals[:, names.index("v")])
    return signals


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
