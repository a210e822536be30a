"""One simulation: settings in, `Run` out.

The stages of `run`: actuator modes from the model, a `Problem` from the settings, the loop until it ends, the
derived columns by the ``signals`` kernel over all rows at once, the summary.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops import quadrature
from pmjoint_codegen.loops.guard import HOLD_RATIOS, discs, hold_factors
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.modes import Actuator, make_actuator
from pmjoint_codegen.loops.problem import Memory, Problem, Progress, make_memory
from pmjoint_codegen.loops.select import Advance, make_loop
from pmjoint_codegen.loops.status import Status, sentence
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.record import RATE, Record, reports_rate
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.simulate.summary import summarise
from pmjoint_codegen.values import SETTLED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INSTANTANEOUS: Final = ("y", "y_r", "e")  # of the signals, what a sampled controller does not hold
LAGGED: Final = frozenset({"q1", "q2"})  # states of pressures that lag
BUDGET: Final = 2000  # steps between two looks at progress and Ctrl-C
FEW_SWITCHES: Final = 1000  # more begin the run again, with room for as many as the settings allow

Tell = Callable[[float], None]


@dataclass(frozen=True)
class Run(Record):
    """A simulated trajectory, and what users do with it."""

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` holds."""
        return summarise(self)

    def to_csv(self, path: str | Path) -> None:
        """Write ``trajectory.csv``, atomically; raises `UsageError` where that is impossible."""
        from pmjoint_codegen.simulate.trajectory import write_csv

        write_csv(self, Path(path))

    def plot(self) -> Figure:
        """Draw an overview of the run."""
        from pmjoint_codegen.simulate.figures import overview

        return overview(self)


def run(evaluator: Evaluator, settings: Settings, progress: Tell | None = None) -> Run:
    """Simulate the closed loop.

    Args:
        evaluator: of the model's kernels.
        settings: of the run.
        progress: told the fraction done, from 0 to 1, now and then.

    Returns:
        The run, whether it reached its horizon or not: see `Run.status`.
    """
    begun = time.perf_counter()
    actuator = make_actuator(evaluator.call("actuation", settings.p)[0])
    problem = make_problem(evaluator, settings, actuator)
    memory, state = _integrate(evaluator, settings, problem, progress)
    signals = _signals(evaluator, problem, memory, state.row)
    return Run(
        manifest=evaluator.manifest,
        settings=settings,
        evaluator=evaluator.kind,
        status=Status(state.status),
        message=_message(evaluator.manifest, settings, memory, state),
        t=problem.times[: state.row],
        states=memory.rows[: state.row],
        signals=signals,
        switches=_switches(actuator, memory, state),
        initial_mode=actuator.labels[state.first_mode],
        peaks=_peaks(evaluator.manifest, memory),
        ise=state.integral,
        settling_s=state.settled if state.band > 0.0 else None,
        steps=state.steps,
        wall_s=time.perf_counter() - begun,
    )


def make_problem(evaluator: Evaluator, settings: Settings, actuator: Actuator) -> Problem:
    """Put together the constants of a run."""
    manifest = evaluator.manifest
    sampled = settings.controller == "sampled"
    order, hold_order = (manifest.plant_order, manifest.hold_order) if sampled else (manifest.order, 0)
    guard = manifest.guards["plant_taylor" if sampled else "taylor"]
    around = discs(guard, settings.tolerance)
    rule = quadrature.long_steps()
    times = settings.times()
    return Problem(
        n_plant=manifest.nx,
        n_states=manifest.nX,
        n_channels=(manifest.nx + 1 if sampled else manifest.nX + 2) + len(manifest.kinks),
        n_rates=manifest.nx if sampled else manifest.nX,
        n_kinks=len(manifest.kinks),
        n_actuated=actuator.channels,
        order=order,
        n_thresholds=len(actuator.thresholds),
        thresholds=actuator.thresholds,
        modes=actuator.modes,
        p=settings.p,
        hold=hold_matrices(evaluator, settings.p, settings.sample_time) if sampled else np.empty(0),
        nodes=np.array(rule.nodes),
        weights=np.array(rule.weights),
        n_nodes=len(rule.nodes),
        n_searched=manifest.nX + 2,
        notes_rate=int(reports_rate(manifest)),
        inside=np.array(guard.inside),
        n_inside=len(guard.inside),
        lebesgue=guard.lebesgue,
        ratios=np.array(around.ratios),
        factors=np.array(around.factors),
        n_ratios=len(around.ratios),
        max_step=settings.max_step,
        settled=SETTLED,
        times=times,
        n_rows=len(times),
        sample_time=settings.sample_time if sampled else 0.0,
        hold_ratios=np.array(HOLD_RATIOS),
        hold_rate_factors=np.array(hold_factors(hold_order)),
        hold_value_factors=np.array(hold_factors(hold_order + 1)),
        n_hold_ratios=len(HOLD_RATIOS),
        tolerance=settings.tolerance,
        safety=_safety(order),
        hold_fraction=_hold_fraction(hold_order, settings.tolerance) if sampled else 0.0,
        divergence=settings.divergence,
        max_steps=settings.max_steps,
        max_switches=settings.max_switches,
    )


def _safety(order: int) -> float:
    """Factor on a step of Taylor polynomials of an order; Jorba and Zou (2005)."""
    return math.exp(-0.7 / (order - 1))


def _hold_fraction(order: int, tolerance: float) -> float:
    """`Problem.hold_fraction`: terms fall to the tolerance at the last order, what follows lies below it."""
    return _safety(order) * math.pow(tolerance, 1.0 / order)


def _integrate(
    evaluator: Evaluator, settings: Settings, problem: Problem, progress: Tell | None
) -> tuple[Memory, Progress]:
    """Drive the loop to its end, with room for few switches first: large arrays cost more than a run."""
    start = initial_state(evaluator.manifest, settings)
    few = replace(problem, max_switches=min(problem.max_switches, FEW_SWITCHES))
    for given in (few, problem):
        memory, state = make_memory(given, start), Progress()
        _drive(make_loop(evaluator, given, state, memory), given, state, progress)
        if state.status != Status.TOO_MANY_SWITCHES or given.max_switches == problem.max_switches:
            break
    return memory, state


def initial_state(manifest: Manifest, settings: Settings) -> Array:
    """X(0): the plant as x0 has it, the controller at 0; shape (nX,)."""
    state = np.zeros(manifest.nX)
    values = {name: np.array([value]) for name, value in settings.parameters.items()}
    state[: manifest.nx] = manifest.start.states(settings.x0[np.newaxis], values)[0]
    return state


def _drive(advance: Advance, problem: Problem, state: Progress, tell: Tell | None) -> None:
    """Advance until the run ends, looking up now and then: Ctrl-C comes through between two calls."""
    while state.status == Status.RUNNING:
        advance(BUDGET)
        if tell is not None:
            tell(min(state.t / problem.horizon, 1.0))


def _signals(evaluator: Evaluator, problem: Problem, memory: Memory, rows: int) -> Array:
    """Everything that follows from the states, shape (rows, number of signals)."""
    times = problem.times[:rows, np.newaxis]
    if not problem.sample_time:
        return evaluator.call("signals", times, memory.rows[:rows], problem.p)[0]
    # Held as of the last sample, but for what the plant and the reference do meanwhile.
    (signals,) = evaluator.call(
        "signals", memory.row_sample_times[:rows, np.newaxis], memory.row_samples[:rows], problem.p
    )
    y, y_r, e = (_index(evaluator.manifest, name) for name in INSTANTANEOUS)
    signals[:, y] = memory.rows[:rows, 0]
    signals[:, y_r] = evaluator.call("reference", times, problem.p)[0][:, 0]
    signals[:, e] = signals[:, y] - signals[:, y_r]
    moving = _moving(evaluator.manifest)
    if moving:
        (live,) = evaluator.call("signals", times, memory.rows[:rows], problem.p)
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


def _switches(actuator: Actuator, memory: Memory, state: Progress) -> tuple[tuple[float, int], ...]:
    """The switches at which u enters or leaves a limit; those of other channels alone are left out."""
    found = []
    before = actuator.labels[state.first_mode]
    for i in range(state.switches):
        label = actuator.labels[int(memory.switch_modes[i])]
        if label != before:
            found.append((float(memory.switch_times[i]), label))
        before = label
    return tuple(found)


def _peaks(manifest: Manifest, memory: Memory) -> dict[str, tuple[float, float]]:
    names = [*(item.name for item in manifest.states), "v", "e", *([RATE] if reports_rate(manifest) else [])]
    pairs = zip(memory.peaks.tolist(), memory.peak_times.tolist(), strict=True)
    return dict(zip(names, pairs, strict=False))  # the last place may be unused


def _message(manifest: Manifest, settings: Settings, memory: Memory, state: Progress) -> str:
    return sentence(
        Status(state.status),
        t=state.t,
        divergence=settings.divergence,
        max_steps=settings.max_steps,
        max_switches=settings.max_switches,
        state=manifest.states[int(np.argmax(memory.peaks[: manifest.nX]))].name,  # the one that passed
    )
