"""An independent solver: heyoka, with located events, on the derivation's own expressions.

It shares nothing with what it checks but the symbolic derivation: no CasADi, no C of ours, no Taylor
recurrence, no event search of ours, no step control either: its steps are short, and compared with the
right-hand side at points inside. Held against it are the model's own run and runs with a drawn limit of u
from drawn initial states. heyoka says which of these saturate and come back, so that a switch that our loop
does not see keeps no run from being held.
"""

from __future__ import annotations

import dataclasses
from itertools import islice
from typing import Any, Final

import numpy as np

from pmjoint_codegen.check.drawn import Draw, draws
from pmjoint_codegen.check.golden import TOLERANCE, Trajectory, compare, default_run, kept_rows, trajectory_of
from pmjoint_codegen.check.heyoka_loop import Loop, UntrustedError
from pmjoint_codegen.check.result import GateResult, Verdict, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.errors import installing
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.simulate.modes import Actuator, make_actuator
from pmjoint_codegen.simulate.run import Run, initial_state, run
from pmjoint_codegen.simulate.settings import Settings, make_settings
from pmjoint_codegen.simulate.status import Status

NAME = "trajectory.independent"
RUNS: Final = (2, 48)  # drawn runs that are held: at least, at most
STEPS: Final = {"compiled": 500_000, "interpreted": 2_000}  # what they may take between them: some seconds
TRIES: Final = 4  # draws for each of them at most: a limit may be too wide, or the joint lost


def check(subject: Subject) -> GateResult:
    """Integrate the default run and the drawn runs a second time, with heyoka, and compare."""
    if subject.manifest.kinks:
        return not_run(NAME, "the disturbance has a kink (abs or sign), and heyoka locates no kinks")
    try:
        import heyoka
    except ImportError:
        return not_run(NAME, f"no heyoka; {installing('heyoka')}")
    evaluator = subject.compiled or subject.interpreted
    done = default_run(evaluator)
    loop = Loop(heyoka, subject, done.settings.parameters)
    result = hold(loop, subject, done)
    if result.verdict is not Verdict.PASSED:
        return result
    affordable = STEPS[evaluator.kind] // done.steps
    return hold_drawn(loop, subject, evaluator, result, min(max(affordable, RUNS[0]), RUNS[1]))


def hold(loop: Loop, subject: Subject, done: Run) -> GateResult:
    """Hold a run against heyoka's from the same state, at the instants that a golden file keeps.

    Args:
        loop: heyoka's side.
        subject: the model.
        done: the run.
    """
    if done.status != Status.DONE:
        return failed(NAME, f"the run ended early: {done.message}")
    try:
        expected = reference(loop, subject, done.settings)
    except UntrustedError as error:
        return not_run(NAME, f"heyoka's run is no reference: it {error}")
    return _compare(loop, expected, done)


def hold_drawn(
    loop: Loop, subject: Subject, evaluator: Evaluator, own: GateResult, wanted: int
) -> GateResult:
    """Hold drawn runs, and say the worst of all.

    Args:
        loop: heyoka's side.
        subject: the model.
        evaluator: of our side.
        own: what the model's own run gave.
        wanted: how many runs.
    """
    worst, held, switches, untrusted = own, 0, 0, 0
    for draw in islice(draws(subject.manifest), TRIES * wanted):
        settings = drawn_settings(subject, draw)
        try:
            expected = reference(loop, subject, settings)
        except UntrustedError:
            untrusted += 1
            continue
        if not saturates_and_returns(expected):
            continue
        held, switches = held + 1, switches + len(expected.switches)
        done = run(evaluator, settings)
        if done.status != Status.DONE:
            return failed(NAME, f"a drawn run ended early, with {_said(subject, draw)}: {done.message}")
        result = _compare(loop, expected, done)
        if result.verdict is Verdict.FAILED:
            return dataclasses.replace(result, detail=f"{result.detail}, with {_said(subject, draw)}")
        if (result.figure or 0.0) > (worst.figure or 0.0):
            worst = result
        if held == wanted:
            break
    drawn = (
        f"{held} drawn runs with {switches} switching instants"
        if held
        else "no drawn run that saturates and returns"
    )
    left = f"; heyoka gave no reference for {untrusted} more" if untrusted else ""
    return dataclasses.replace(worst, detail=f"{own.detail}, and {drawn}{left}")


def drawn_settings(subject: Subject, draw: Draw) -> Settings:
    """The model's run with a drawn limit from a drawn state."""
    limit = subject.manifest.written({subject.manifest.limit: draw.limit})
    return make_settings(subject.manifest, parameters=limit, x0=draw.x0, tolerance=TOLERANCE)


def reference(loop: Loop, subject: Subject, settings: Settings) -> Trajectory:
    """What heyoka makes of some settings, at the instants that a golden file keeps.

    Raises:
        UntrustedError: heyoka's run leaves its own equations.
    """
    times = settings.times()
    limit, start = settings.parameters[subject.manifest.limit], initial_state(subject.manifest, settings)
    return loop.run(times[kept_rows(len(times))], start, limit, _actuator(subject, settings))


def saturates_and_returns(found: Trajectory) -> bool:
    """Whether u is at a limit for a while and inside at the end: a run that is lost stays at its limit."""
    return bool(found.switches) and found.switches[-1][1] == 0 and bool(np.all(np.isfinite(found.values)))


def _compare(loop: Loop, expected: Trajectory, done: Run) -> GateResult:
    limit = done.settings.parameters[done.manifest.limit]
    return compare(NAME, expected, trajectory_of(done), "heyoka", loop.scales(expected, limit))


def _actuator(subject: Subject, settings: Settings) -> Actuator:
    limits: Any = subject.interpreted.call("actuation", settings.p)[0]
    return make_actuator(limits)


def _said(subject: Subject, draw: Draw) -> str:
    """The options of `pmjoint simulate` that make a drawn run again."""
    x0 = ",".join(repr(value) for value in draw.x0.tolist())
    return f"--set {subject.manifest.limit}={draw.limit!r} --x0={x0}"
