"""Runs that share what is prepared for them: the same as runs alone, whatever came before or runs beside."""

from __future__ import annotations

import copy
import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, SimulationError
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.simulate import run as module
from pmjoint_codegen.simulate.run import Run, Simulator

ASKED: tuple[dict[str, Any], ...] = (
    {},
    {"x0": [-2.0, 1.0]},
    {"x0": [105.0, 0.0], "horizon": 40.0},  # diverges
    {"horizon": 3.0},
    {"output_step": 0.5},
    {"tolerance": 1e-7},
    {"max_step": 0.01},
    {"divergence": 8.545},  # |r2| passes it within a step, and not at an end of one
    {"divergence": 6.0},
    {"parameters": {"c1": 20.0}},
    {"parameters": {"b0_plant": 1.8}, "x0": [1.0, 0.0]},
    {"compensator": False},
    {"controller": "sampled", "horizon": 2.0},
    {"controller": "sampled", "horizon": 2.0, "sample_time": 0.004},
    {"max_step": 1e-4, "horizon": 1.0},  # more steps than a short run has
    {"output_step": 0.001, "horizon": 11.0},  # more rows
)


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    """The paper's loop, compiled."""
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    return ClosedLoop.load("paper", "compiled")


def simulated(loop: ClosedLoop, asked: dict[str, Any]) -> Run:
    """A run, whether it reached its horizon or not."""
    try:
        return loop.simulate(**asked)
    except SimulationError as error:
        assert isinstance(error.run, Run)
        return error.run


def contents(run: Run) -> dict[str, Any]:
    """All that a run says, bit for bit, but for how long it took and what does not compare."""
    found = {field.name: getattr(run, field.name) for field in fields(run)}
    shapes = {name: (found[name].shape, found[name].tobytes()) for name in ("t", "states", "signals")}
    settings = {**run.settings.__getstate__(), "p": run.settings.p.tolist(), "x0": run.settings.x0.tolist()}
    return {**found, **shapes, "settings": settings, "manifest": run.manifest.name, "wall_s": 0.0}


@pytest.mark.parametrize("asked", ASKED, ids=str)
def test_a_short_run_is_the_whole_run(
    loop: ClosedLoop, asked: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = simulated(loop, asked)
    monkeypatch.setattr(module, "FEW_ROWS", 0)
    whole = simulated(ClosedLoop(loop.evaluator), asked)
    assert {"peaks", "ise", "settling_s"} <= whole.__dict__.keys()
    assert contents(short) == contents(whole)


def test_a_short_run_leaves_for_later_what_is_read_later(loop: ClosedLoop) -> None:
    run = loop.simulate()
    deferred = {"signals", "peaks", "ise", "settling_s"}
    assert run.__dict__.keys() & deferred == set()
    assert run["x1"][0] == 1.5
    assert run.__dict__.keys() & deferred == set()
    assert run.ise > 0.0
    assert run.__dict__.keys() & deferred == deferred - {"signals"}
    with pytest.raises(AttributeError, match="'Run' object has no attribute 'peak'"):
        _ = run.peak  # type: ignore[attr-defined]


def test_no_run_shows_what_another_left_behind(loop: ClosedLoop) -> None:
    """In every order of two: what is kept for the next run holds nothing of the last."""
    alone = [contents(simulated(ClosedLoop(loop.evaluator), asked)) for asked in ASKED]
    for i, first in enumerate(ASKED):
        one = simulated(loop, first)
        for j, second in enumerate(ASKED[:10]):
            other = simulated(loop, second)
            assert contents(other) == alone[j]
        assert contents(one) == alone[i]  # read at last, with other runs since


def test_threads_share_a_loop(loop: ClosedLoop) -> None:
    starts = np.random.default_rng(2).uniform(-3.0, 3.0, size=(400, 2)).tolist()
    alone = [loop.simulate(x0=x0, output_step=1.0).states.tobytes() for x0 in starts]
    with ThreadPoolExecutor(max_workers=4) as pool:
        found = pool.map(lambda x0: loop.simulate(x0=x0, output_step=1.0).states.tobytes(), starts)
        assert list(found) == alone


def test_a_run_is_copied_with_what_was_not_read_yet(loop: ClosedLoop) -> None:
    expected = contents(loop.simulate())
    assert contents(pickle.loads(pickle.dumps(loop.simulate()))) == expected
    assert contents(copy.copy(loop.simulate())) == expected
    assert contents(copy.deepcopy(loop.simulate())) == expected


def test_runs_share_what_nobody_can_write(loop: ClosedLoop) -> None:
    run = loop.simulate(output_step=1.0)
    for array in (run.t, run.states, run.settings.p, run.settings.x0):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0
    with pytest.raises(TypeError, match="item assignment"):
        run.settings.parameters["c1"] = 7.0  # type: ignore[index]


def test_settings_are_made_anew_where_what_was_asked_has_changed(loop: ClosedLoop) -> None:
    parameters, x0 = {"c1": 20.0}, [1.0, 0.0]
    assert loop.simulate(parameters=parameters, x0=x0).states[0, 0] == 1.0
    parameters["c1"], x0[0] = 21.0, 2.0
    run = loop.simulate(parameters=parameters, x0=x0)
    assert (run.settings.parameters["c1"], run.states[0, 0]) == (21.0, 2.0)
    simulator = Simulator(loop.evaluator)
    assert simulator.settings(horizon=2) is simulator.settings(horizon=2)
    with pytest.raises(TypeError, match="horizn"):
        simulator.settings(horizn=2.0)  # type: ignore[call-arg]


def test_progress_is_told_of_short_and_long_runs(loop: ClosedLoop) -> None:
    for asked in ({}, {"max_step": 1e-4, "horizon": 1.0}):
        told: list[float] = []
        loop.simulate(progress=told.append, **asked)  # type: ignore[arg-type]
        assert told[-1] == 1.0 and told == sorted(told)
    assert len(told) > 2


def test_a_simulator_prepares_again_what_differs(loop: ClosedLoop) -> None:
    simulator = Simulator(loop.evaluator)
    settings = [simulator.settings(**asked) for asked in ASKED]
    prepared = [simulator._prepared(item) for item in settings]
    same = [one is other for one, other in pairwise(prepared)]
    assert same == [True, *[False] * (len(ASKED) - 2)]
