"""What a loop leaves behind, in the words of a run: signals, switches, figures, and how it ended."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.status import Status, sentence
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.record import RATE, reports_rate
from pmjoint_codegen.simulate.settings import Settings

INSTANTANEOUS: Final = ("y", "y_r", "e")  # of the signals, what a sampled controller does not hold
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag


def signals_of(evaluator: Evaluator, problem: Problem, states: Array, memory: Memory) -> Array:
    """Everything that follows from the states, shape (rows, number of signals)."""
    rows = len(states)
    times = problem.times[:rows, np.newaxis]
    if not problem.sample_time:
        return evaluator.call("signals", times, states, problem.p)[0]
    # Held as of the last sample, but for what the plant and the reference do meanwhile.
    (signals,) = evaluator.call(
        "signals", memory.held_times[:rows, np.newaxis], memory.held[:rows], problem.p
    )
    y, y_r, e = (_index(evaluator.manifest, name) for name in INSTANTANEOUS)
    signals[:, y] = states[:, 0]
    signals[:, y_r] = evaluator.call("reference", times, problem.p)[0][:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        (live,) = evaluator.call("signals", times, states, problem.p)
        signals[:, moving] = live[:, moving]
    return signals


def _moving(manifest: Manifest) -> list[int]:
    """A joint's physical signals that follow from the plant's states alone, and so move between samples."""
    names = set(manifest.start.names)
    if names >= LAGGED:  # pressures with states of their own; without, they are commands, which are held
        names |= {"P1", "P2"}
    return [i for i, item in enumerate(manifest.signals) if item.name in names]


def _index(manifest: Manifest, name: str) -> int:
    return next(i for i, item in enumerate(manifest.signals) if item.name == name)


def switches_of(actuator: Actuator, memory: Memory, state: Progress) -> tuple[tuple[float, int], ...]:
    """The switches at which u enters or leaves a limit; those of other channels alone are left out."""
    found = []
    before = actuator.labels[state.first_mode]
    for i in range(state.switches):
        label = actuator.labels[int(memory.switch_modes[i])]
        if label != before:
            found.append((float(memory.switch_times[i]), label))
        before = label
    return tuple(found)


def figures_of(manifest: Manifest, memory: Memory, state: Progress) -> dict[str, Any]:
    """Peaks, integral of e^2 and settling time, by the names that `Record` has for them."""
    names = [*(item.name for item in manifest.states), "v", "e", *([RATE] if reports_rate(manifest) else [])]
    pairs = zip(memory.peaks.tolist(), memory.peak_times.tolist(), strict=True)
    return {
        "peaks": dict(zip(names, pairs, strict=False)),  # the last place may be unused
        "ise": state.integral,
        "settling_s": state.settled if state.band > 0.0 else None,
    }


def message_of(
    manifest: Manifest, settings: Settings, status: Status, t: float, memory: Memory | None = None
) -> str:
    """How a run ended; where it diverged, with the state that did so first."""
    size, when = (memory.peaks, memory.peak_times) if memory else (np.empty(0), np.empty(0))
    beyond = [i for i, peak in enumerate(size[: manifest.nX].tolist()) if peak > settings.divergence]
    first = min(beyond, key=lambda i: (float(when[i]), -float(size[i])), default=None)
    return sentence(
        status,
        t=t,
        divergence=settings.divergence,
        max_steps=settings.max_steps,
        max_switches=settings.max_switches,
        state="a state" if first is None else manifest.states[first].name,
    )
