"""An independent solver: heyoka, with located events, on the derivation's own expressions.

It shares only the symbolic derivation with the checked side: no CasADi, none of our C, Taylor recurrences or
event search, and no step control either: its steps are short, and are compared with the right-hand side at
points inside. It checks the model's own run and runs with a drawn limit of u from drawn initial states.
heyoka decides which of these saturate and return, so a switch that our loop misses does not exclude a run
from the comparison. heyoka locates kinks too. A run that is stuck to a kink ends early: it must end between
the same rows in both, and is then left out.
"""

from __future__ import annotations

import dataclasses
from itertools import islice
from typing import Final

import numpy as np

from pmjoint_codegen.check.inputs.drawn import Draw, drawn_limits, draws
from pmjoint_codegen.check.oracles.heyoka_kinks import SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.heyoka_loop import Loop
from pmjoint_codegen.check.result import GateResult, Verdict, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import (
    ACCURACY,
    Trajectory,
    compare,
    default_run,
    exact_run,
    kept_rows,
    trajectory_of,
)
from pmjoint_codegen.errors import installing
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.chain import actuator_of
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import Settings, make_settings
from pmjoint_codegen.simulate.start import initial_state

RUNS: Final = (2, 24)  # drawn runs to compare: at least, at most
STEPS: Final = {"compiled": 50_000, "interpreted": 2_000}  # for all of them together: some seconds
_HALVINGS: Final = 60  # of a drawn start's distance from the model's own
TRIES: Final = 4  # draws for each of them at most: a limit may be too wide, or the run diverge


def check(subject: Subject) -> GateResult:
    """Integrate the default run and the drawn runs a second time, with heyoka, and compare."""
    try:
        import heyoka
    except ImportError:
        return not_run(f"no heyoka; {installing('heyoka')}")
    evaluator = subject.compiled or subject.interpreted
    done = default_run(evaluator)
    loop = Loop(heyoka, subject, done.settings.parameters)
    result = compare_run(loop, subject, done)
    # A run of the model's own that is stuck to a kink leaves the drawn ones to be compared.
    if result.verdict is not Verdict.PASSED and not (
        result.verdict is Verdict.NOT_RUN and done.status == Status.SLIDING
    ):
        return result
    affordable = STEPS[evaluator.kind] // max(done.steps, 1)
    return compare_drawn(loop, subject, evaluator, result, min(max(affordable, RUNS[0]), RUNS[1]))


def compare_run(loop: Loop, subject: Subject, done: Run) -> GateResult:
    """Check a run against heyoka's from the same state, at the instants that a golden file keeps.

    Args:
        loop: heyoka's side.
        subject: the model.
        done: the run.
    """
    if done.status not in (Status.DONE, Status.SLIDING):
        return failed(f"the run ended early: {done.message}")
    try:
        expected = reference(loop, subject, done.settings)
    except SlidingError as error:
        return _both_stuck(error, done)
    except UntrustedError as error:
        return not_run(f"heyoka's run is no reference: it {error}")
    if done.status != Status.DONE:
        return failed(f"the run ended early, and heyoka's does not: {done.message}")
    return _compare(loop, expected, done)


def compare_drawn(
    loop: Loop, subject: Subject, evaluator: Evaluator, default: GateResult, wanted: int
) -> GateResult:
    """Compare drawn runs, and give the worst of all.

    Args:
        loop: heyoka's side.
        subject: the model.
        evaluator: of our side.
        default: result of the model's own run.
        wanted: how many runs.
    """
    worst, compared, switches, untrusted, stuck = default, 0, 0, 0, 0
    for wide in islice(draws(subject.manifest), TRIES * wanted):
        draw = _within_range(subject, wide)
        settings = drawn_settings(subject, draw)
        expected: Trajectory | SlidingError
        try:
            expected = reference(loop, subject, settings)
        except SlidingError as error:
            expected = error
        except UntrustedError:
            untrusted += 1
            continue
        if not isinstance(expected, SlidingError) and not (
            saturates_and_returns(expected) and _stays_in_range(subject, expected)
        ):
            continue
        done = exact_run(evaluator, settings)
        if isinstance(expected, SlidingError):
            result = _both_stuck(expected, done)
        elif done.status != Status.DONE:
            return failed(f"a drawn run ended early, with {_options(subject, draw)}: {done.message}")
        else:
            result = _compare(loop, expected, done)
        if result.verdict is Verdict.FAILED:
            return dataclasses.replace(result, detail=f"{result.detail}, with {_options(subject, draw)}")
        if isinstance(expected, SlidingError):
            stuck += 1
            continue
        compared, switches = compared + 1, switches + len(expected.switches)
        if worst.verdict is not Verdict.PASSED or (result.figure or 0.0) > (worst.figure or 0.0):
            worst = result
        if compared == wanted:
            break
    drawn = (
        f"{compared} drawn runs with {switches} switching instants"
        if compared
        else "no drawn run that saturates and returns"
    )
    left = f"; heyoka gave no reference for {untrusted} more" if untrusted else ""
    left += f"; {stuck} more are stuck to a kink and left out" if stuck else ""
    return dataclasses.replace(worst, detail=f"{default.detail}, and {drawn}{left}")


def _both_stuck(found: SlidingError, done: Run) -> GateResult:
    """If heyoka's run is stuck to a kink, ours must end too, between the same rows."""
    if done.status != Status.SLIDING:
        return failed(f"heyoka's run {found}, and the run does not end there: {done.message}")
    around = np.array([found.t - ACCURACY, found.t + ACCURACY])
    least, most = np.searchsorted(done.settings.times(), around, side="right")
    if not least <= len(done.t) <= most:
        return failed(f"heyoka's run {found}, and the run elsewhere: {done.message}")
    return not_run(f"the run and heyoka's are stuck to a kink at t = {found.t:.6g} s")


def drawn_settings(subject: Subject, draw: Draw) -> Settings:
    """The model's run with a drawn limit from a drawn state."""
    limits = subject.manifest.written(drawn_limits(subject.manifest, draw))
    return make_settings(subject.manifest, parameters=limits, x0=draw.x0, controller="continuous")


def _within_range(subject: Subject, draw: Draw) -> Draw:
    """The draw, moved towards the model's own start until y is in the range that the design is for."""
    if subject.model.y_range is None:
        return draw
    low, high = subject.model.y_range
    usual = np.array(subject.manifest.simulation.x0)
    parameters = {item.name: np.array([item.value]) for item in subject.manifest.parameters}
    for halvings in range(_HALVINGS):
        x0 = usual + (draw.x0 - usual) * 0.5**halvings
        if low <= subject.manifest.start.states(x0[np.newaxis], parameters)[0, 0] <= high:
            return dataclasses.replace(draw, x0=x0)
    return dataclasses.replace(draw, x0=usual)


def _stays_in_range(subject: Subject, found: Trajectory) -> bool:
    """Whether y stays in the range that the design is for: a pole may lie beyond."""
    low, high = subject.model.y_range or (-np.inf, np.inf)
    y = found.values[:, found.names.index("x1")]
    return bool(np.all((low <= y) & (y <= high)))


def reference(loop: Loop, subject: Subject, settings: Settings) -> Trajectory:
    """The heyoka run of some settings, at the instants that a golden file keeps.

    Raises:
        SlidingError: heyoka's run is stuck to a kink.
        UntrustedError: heyoka's run deviates from its own equations.
    """
    times = settings.times()
    start = initial_state(subject.interpreted, settings)
    return loop.run(
        times[kept_rows(len(times))], start, _limits(settings, subject), _actuator(subject, settings)
    )


def _limits(settings: Settings, subject: Subject) -> tuple[float, ...]:
    return tuple(settings.parameters[name] for name in subject.manifest.limit_parameters)


def saturates_and_returns(found: Trajectory) -> bool:
    """Whether u is at a limit for a while and inside at the end: a diverging run stays at its limit."""
    return bool(found.switches) and found.switches[-1][1] == 0 and bool(np.all(np.isfinite(found.values)))


def _compare(loop: Loop, expected: Trajectory, done: Run) -> GateResult:
    limits = tuple(done.settings.parameters[name] for name in done.manifest.limit_parameters)
    return compare(expected, trajectory_of(done), "heyoka", loop.scales(expected, limits))


def _actuator(subject: Subject, settings: Settings) -> Actuator:
    return actuator_of(subject.interpreted, settings.p)


def _options(subject: Subject, draw: Draw) -> str:
    """The options of `pmjoint simulate` that reproduce a drawn run."""
    x0 = ",".join(repr(value) for value in draw.x0.tolist())
    limits = subject.manifest.written(drawn_limits(subject.manifest, draw)).items()
    return f"{' '.join(f'--set {name}={value!r}' for name, value in limits)} --x0={x0}"
