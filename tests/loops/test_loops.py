"""A prepared run repeats itself bit for bit, and without the search for peaks it steps just the same."""

from __future__ import annotations

import gc
import os
import re
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.kernels.processor import VARIABLE, usable_levels
from pmjoint_codegen.loops.modes import make_actuator
from pmjoint_codegen.loops.problem import Memory, Problem, Progress, make_memory
from pmjoint_codegen.loops.select import CompiledLoop, make_loop
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import make_problem
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.start import initial_state

BUDGET = 10_000


@pytest.fixture(scope="module")
def evaluator() -> Evaluator:
    """Return the paper's compiled kernels."""
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    return ClosedLoop.load("paper", "compiled").evaluator


def prepared(evaluator: Evaluator, controller: str = "continuous") -> Problem:
    settings = make_settings(evaluator.manifest, horizon=2.0, controller=controller)
    return make_problem(evaluator, settings, make_actuator(evaluator.call("actuation", settings.p)[0]))


def driven(evaluator: Evaluator, problem: Problem) -> tuple[CompiledLoop, Progress, Memory]:
    start = initial_state(evaluator, make_settings(evaluator.manifest))
    progress, memory = Progress(), make_memory(problem, start)
    loop = cast(CompiledLoop, make_loop(evaluator, problem, progress, memory))
    loop(BUDGET)
    return loop, progress, memory


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_run_started_again_repeats_itself(evaluator: Evaluator, controller: str) -> None:
    loop, progress, memory = driven(evaluator, prepared(evaluator, controller))
    names = ("rows", "row_samples", "row_sample_times", "peaks", "peak_times")
    first = {name: np.copy(getattr(memory, name)) for name in names}
    figures = (progress.steps, progress.switches, progress.integral)
    loop.restart(np.array([3.0, *np.zeros(9)]))  # farther away: larger peaks, to be forgotten
    loop(BUDGET)
    assert np.all(memory.peaks[[0, -2]] > first["peaks"][[0, -2]])
    loop.restart(np.array([1.5, *np.zeros(9)]))
    loop(BUDGET)
    assert progress.status == Status.DONE
    assert (progress.steps, progress.switches, progress.integral) == figures
    for name, values in first.items():
        np.testing.assert_array_equal(getattr(memory, name), values)


def test_without_the_search_for_peaks_all_else_is_the_same(evaluator: Evaluator) -> None:
    _, searched, full = driven(evaluator, prepared(evaluator))
    _, bare, lean = driven(evaluator, replace(prepared(evaluator), n_searched=0))
    np.testing.assert_array_equal(full.rows, lean.rows)
    assert (searched.steps, searched.integral) == (bare.steps, bare.integral)
    r2 = evaluator.manifest.nX - 1
    assert full.peaks[r2] > 8.548  # at 0.0522 s, inside a step
    assert np.all(lean.peaks <= full.peaks) and np.any(lean.peaks < full.peaks)


def test_a_loop_outlives_the_evaluator_that_it_was_made_with() -> None:
    """The library stays loaded as long as any of its functions can be called."""
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    loop, progress, memory = driven_alone()
    gc.collect()
    first = memory.rows[-1].copy()
    loop.restart(np.array([1.5, *np.zeros(9)]))
    loop(BUDGET)
    assert progress.status == Status.DONE
    np.testing.assert_array_equal(memory.rows[-1], first)


def driven_alone() -> tuple[CompiledLoop, Progress, Memory]:
    evaluator = ClosedLoop.load("paper", "compiled").evaluator
    return driven(evaluator, prepared(evaluator))


def test_runs_do_not_depend_on_the_instructions_that_the_processor_has() -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    found = []
    for level in usable_levels(os.environ):
        environment = {**os.environ, VARIABLE: level.name}
        evaluator = ClosedLoop.load("paper", "compiled", environment=environment).evaluator
        _, progress, memory = driven(evaluator, prepared(evaluator))
        found.append((memory.rows, memory.peaks, memory.switch_times[:3], progress.integral, progress.steps))
    for other in found[1:]:
        for mine, theirs in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize("model", ["joint-damped", "joint-exact", "third-order"])
def test_no_output_row_exceeds_the_peaks_however_long_the_steps(model: str, controller: str) -> None:
    """Slow gains and a loose tolerance: an output swings there and back within a step."""
    loop = ClosedLoop.load(model)
    slow = {
        item.name: 0.2 * item.value for item in loop.manifest.parameters if re.fullmatch(r"c\d", item.name)
    }
    for parameters in ({}, slow):
        run = loop.simulate(
            tolerance=1e-3,
            output_step=0.002,
            horizon=5.0,
            parameters=parameters,
            controller=controller,
            sample_time=0.004,
        )
        assert set(run.peaks) > {"x1", "xi1", "lambda1", "r1"}
        for name, (peak, _) in run.peaks.items():
            if name not in ("v", "theta_dot"):  # their rows are the states', their peaks the polynomials'
                assert np.max(np.abs(run[name])) <= peak * (1.0 + 1e-12)
