"""The columns that follow from a run's states.

Those of a sampled run are as of the sample, except for what moves in between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import ACTING, CLOCK, COMMAND, FILTERED, MEASURED, U
from pmjoint_codegen.loops.problem import Memory, Problem
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import of_plant

INSTANTANEOUS: Final = ("y", "y_r", "e")  # signals that a sampled controller does not hold constant
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag


def signals_of(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory) -> Array:
    """What the ``signals`` kernel reports at a run's rows, shape (rows, number of signals).

    Args:
        evaluator: of the model's kernels.
        problem: constants of the run.
        states: X at the rows.
        memory: of the run, which has reached these rows.
    """
    rows = len(states)
    times = problem.times[:rows, np.newaxis]
    if not problem.sample_time:
        return evaluator.call("signals", times, states, problem.p)[0]
    if problem.n_history:
        return _chained_signals(evaluator, problem, states, memory)
    # Constant since the last sample, except for the plant and the reference.
    (signals,) = evaluator.call(
        "signals", memory.row_sample_times[:rows, np.newaxis], memory.row_samples[:rows], problem.p
    )
    _put_live(evaluator, problem, states, signals)
    return signals


def _chained_signals(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory) -> Array:
    """The same where the law takes what a sensor reads, and the plant what an actuator delivers."""
    manifest, rows = evaluator.manifest, len(states)
    held, samples = memory.row_held[:rows], memory.row_samples[:rows]
    seen = samples.copy()
    seen[:, 0] = held[:, FILTERED]
    (signals,) = evaluator.call("signals", held[:, CLOCK, np.newaxis], seen, problem.p)
    places = {item.name: i for i, item in enumerate(manifest.signals)}
    w = held[:, ACTING:]
    instants = memory.row_sample_times[:rows, np.newaxis]
    (D,) = evaluator.call("disturbance", instants, samples[:, : manifest.nx], w, problem.p)
    known = {
        "y_m": held[:, MEASURED],
        "y_f": held[:, FILTERED],
        "u": held[:, U],
        "u_command": held[:, COMMAND],
    }
    known |= {f"D{i}": column for i, column in enumerate(D.T, start=1)}
    if "u_valve" in places:
        known["u_valve"] = w[:, 1]
    if "P1" in places and not set(manifest.start.names) >= LAGGED:
        values = dict(zip(manifest.parameter_names, problem.p.tolist(), strict=True))
        base = of_plant(values, "k0") * of_plant(values, "u0")
        known |= {"P1": base + w[:, -2], "P2": base - w[:, -1]}
    for name, column in known.items():
        if name in places:
            signals[:, places[name]] = column
    _put_live(evaluator, problem, states, signals)
    return signals


def _put_live(evaluator: Evaluator, problem: Problem, states: Array, signals: Array) -> None:
    """Signals of a sampled run that move between samples: y, y_r, e, and states of a joint."""
    times = problem.times[: len(states), np.newaxis]
    y, y_r, e = map([item.name for item in evaluator.manifest.signals].index, INSTANTANEOUS)
    signals[:, y] = states[:, 0]
    signals[:, y_r] = evaluator.call("reference", times, problem.p)[0][:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        (live,) = evaluator.call("signals", times, states, problem.p)
        signals[:, moving] = live[:, moving]


def _moving(manifest: Manifest) -> list[int]:
    """A joint's physical signals that depend only on the plant's states, and so change between samples."""
    names = set(manifest.start.names)
    if (
        names >= LAGGED
    ):  # pressures with their own states; otherwise they are commands, constant between samples
        names |= {"P1", "P2"}
    return [i for i, item in enumerate(manifest.signals) if item.name in names]
