"""A run that leaves its reference says so, soon, by name, and by the rule of sweeps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.summary_table import summary_table
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.simulate.divergence import DIVERGENCE
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

SLOW = {"c1": 2.0, "c2": 2.0}  # gains with which x2 goes further than any state of the controller


@pytest.fixture(scope="module")
def paper() -> ClosedLoop:
    return ClosedLoop.load("paper")


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_lost_joint_ends_soon_and_names_its_state(evaluator: str, controller: str) -> None:
    loop = ClosedLoop.load("paper", evaluator)
    with pytest.raises(SimulationError, match=r"diverged: r2 passed 10000 at t = 2\.80") as caught:
        loop.simulate(parameters={"d1": 10.0}, controller=controller)
    run = caught.value.run
    assert isinstance(run, Run)
    assert run.steps < 10_000  # a million without the limit
    assert run.summary["held"] is False
    assert (
        "diverged: r2 passed" in (table := summary_table(run, (), ())) and "diverged: diverged" not in table
    )


def test_the_limit_is_an_option(paper: ClosedLoop) -> None:
    with pytest.raises(SimulationError, match="r2 passed 50 at"):
        paper.simulate(parameters={"d1": 10.0}, divergence=50.0)
    with pytest.raises(UsageError, match=r"^--divergence: is 0; allowed: a number greater than 0$"):
        paper.simulate(divergence=0.0)


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("r2", {}),
        ("x2", {"controller": "sampled", "sample_time": 1e-3, "parameters": SLOW}),
        ("x2", {"controller": "sampled", "sample_time": 0.2, "parameters": SLOW}),
    ],
    ids=["continuous", "short holds", "long holds"],
)
def test_a_peak_inside_a_step_passes_the_limit_when_it_does(
    evaluator: str, name: str, more: dict[str, Any]
) -> None:
    """Judged at the ends of steps alone, the run would go on."""
    loop = ClosedLoop.load("paper", evaluator)
    peak, when = loop.simulate(horizon=1.0, **more).peaks[name]
    assert loop.simulate(horizon=1.0, **more, divergence=peak * (1.0 + 1e-9)).summary["status"] == "done"
    limit = peak * (1.0 - 1e-9)
    with pytest.raises(SimulationError, match=f"diverged: {name} passed") as caught:
        loop.simulate(horizon=1.0, **more, divergence=limit)
    run = caught.value.run
    assert isinstance(run, Run)
    assert run.peaks[name][0] == pytest.approx(limit, rel=1e-14)  # the run ends there
    assert run.peaks[name][1] < when  # and not after it
    assert when - run.peaks[name][1] < 1e-3
    assert run.t[-1] <= run.peaks[name][1]


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_start_beyond_the_limit_is_the_end(controller: str, paper: ClosedLoop) -> None:
    with pytest.raises(SimulationError, match=r"diverged: x2 passed 1\.6 at t = 0 s"):
        paper.simulate(x0=[1.5, 50.0], divergence=1.6, controller=controller)


def test_single_runs_and_sweeps_have_one_limit(paper: ClosedLoop) -> None:
    plan = make_plan(("c1=10,15",), (), None, 0, "latin-hypercube")
    assert make_request(paper.manifest, plan).divergence == make_settings(paper.manifest).divergence
    assert make_settings(paper.manifest).divergence == DIVERGENCE


def test_the_limit_leaves_room_for_pressures_and_for_the_start(paper: ClosedLoop) -> None:
    lagging = ClosedLoop.load("joint-lag").manifest
    assert make_settings(lagging).divergence == 4 * 5e5
    assert make_settings(lagging, parameters={"P_max": 6e5}).divergence == 4 * 6e5
    assert make_settings(paper.manifest, x0=[-2e4, 0.0]).divergence == 2e6


FLEXIBLE = """
schema = 1
name = "flexible"
[parameters]
Ks = {{ value = 1.61 }}
Jh = {{ value = 0.0021 }}
Jl = {{ value = 0.0059 }}
Kt = {{ value = {torque} }}
u_max = {{ value = {limit} }}
[plant]
order = 4
phi = ["-50*y", "-(Ks/Jl + Ks/Jh)*y", "-50*Ks/Jl*y", "0"]
b = ["Kt*Ks/(Jh*Jl)"]
[actuator]
limit = "u_max"
[design]
bandwidth = 20
input_scale = "auto"
start = "matched"
[simulation]
reference = "0.5*(1 - cos(t))"
x0 = [0.0, 0.0, 0.0, 0.0]
horizon = 3.0
"""


@pytest.mark.parametrize(("torque", "limit"), [(0.2, 10.0), (2e-7, 1e7)])
def test_large_derivatives_and_a_small_unit_of_the_input_are_no_divergence(
    torque: float, limit: float, tmp_path: Path
) -> None:
    file = tmp_path / "flexible.toml"
    file.write_text(FLEXIBLE.format(torque=torque, limit=limit), encoding="utf-8")
    run = ClosedLoop.load(file).simulate()
    assert run.summary["status"] == "done"
    assert run.summary["max_abs_e"] < 0.05
    assert max(float(np.abs(run[name]).max()) for name in ("x4", "lambda4")) > DIVERGENCE


def test_a_run_that_ends_far_away_at_its_limit_is_lost(paper: ClosedLoop) -> None:
    lost = paper.simulate(x0=[60.0, 20.0], horizon=5.0)
    assert lost.summary["status"] == "done"
    assert lost.summary["held"] is False
    assert "tracking is lost for good" in summary_table(lost, (), ())
    kept = paper.simulate()
    assert kept.summary["held"] is True
    assert "diverging" not in summary_table(kept, (), ())
