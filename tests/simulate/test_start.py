"""Runs from a matched start: the paper's figures, and the same X(0) from every evaluator and in sweeps."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.start import initial_state
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import fill_in, simulate_chunk
from pmjoint_codegen.sweep.plan import Plan, make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.workspace import find_model, generated_root

EPSILON = float(np.finfo(float).eps)
MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")
ADAPTIVE = ("paper-adaptive", "joint-load", "lag-adaptive")


@pytest.fixture(scope="module")
def paper() -> ClosedLoop:
    return ClosedLoop.load("paper")


def generated(name: str) -> Path:
    return generated_root(find_model(name)) / name


def decays(rate: float) -> dict[str, float]:
    return {"ck1": rate, "ck2": rate}


@pytest.mark.parametrize(
    ("start", "rate", "ise", "peak"),
    [
        ("zero", 1.0, 9.421, 225.7),
        ("matched", 1.0, 1.566, 0.611),
        ("matched", 2.0, 1.062, 1.2),
        ("matched", 5.0, 0.511, 13.9),
        ("matched", 10.0, 0.395, 65.0),
        ("matched", 15.0, 0.378, 154.0),
    ],
)
def test_the_papers_figures(paper: ClosedLoop, start: str, rate: float, ise: float, peak: float) -> None:
    run = paper.simulate(start=start, parameters=decays(rate), horizon=20.0)
    assert run.ise == pytest.approx(ise, abs=1e-3)
    assert run.peaks["v"][0] == pytest.approx(peak, rel=0.05)
    assert run.summary["start"] == start


@pytest.mark.parametrize(("start", "critical"), [("zero", 70.17), ("matched", 100.0)])
def test_the_boundary_of_the_papers_joint(start: str, critical: float) -> None:
    loop = ClosedLoop.load("paper", reference="0", disturbance=["0", "0"])

    def held(x1: float) -> bool:
        try:
            run = loop.simulate(x0=[x1, 0.0], start=start, horizon=120.0, divergence=1e3, output_step=1.0)
        except SimulationError:
            return False
        return bool(run.summary["held"])

    assert held(critical - 0.05)
    assert not held(critical + 0.05)


@pytest.mark.parametrize("name", (*MODELS, *ADAPTIVE))
def test_the_errors_start_at_zero(name: str) -> None:
    run = ClosedLoop.load(name).simulate(start="matched", horizon=0.02)
    manifest = run.manifest
    size = max(1.0, float(np.max(np.abs(run.states[0]))))
    for i in range(1, manifest.rho + 1):
        assert abs(run[f"z{i}"][0]) <= 1e-12 * size, i
    assert run["x_hat1"][0] == run["x1"][0]


@pytest.mark.parametrize("name", (*MODELS, *ADAPTIVE[:2]))
def test_every_evaluator_and_the_lanes_start_alike(name: str) -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("the lanes are compiled")
    compiled, interpreted = (ClosedLoop.load(name, kind) for kind in ("compiled", "interpreted"))
    manifest = compiled.manifest
    plan = make_plan(("ck1=0.5:20:7", "c1=4,9"), (), None, 0, "latin-hypercube")
    request = make_request(manifest, plan, start="matched")
    library = library_of(make_inputs(generated(name)), os.environ)
    columns = plan.columns(0, plan.runs)
    x0, p = fill_in(manifest, request, columns)
    states = library.starts(x0[:, 0], p)
    assert np.any(states != 0.0)
    for i in range(plan.runs):
        changed = {key: float(values[i]) for key, values in columns.items()}
        settings = make_settings(manifest, parameters=changed, start="matched")
        wanted = initial_state(compiled.evaluator, settings)
        np.testing.assert_array_equal(initial_state(interpreted.evaluator, settings), wanted)
        scale = float(np.max(np.abs(wanted)))  # lanes share inverses where single runs divide
        np.testing.assert_allclose(states[i], wanted[manifest.nx :], rtol=0.0, atol=32 * EPSILON * scale)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_sweep_starts_where_a_single_run_does(paper: ClosedLoop, controller: str) -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("the lanes are compiled")
    library = library_of(make_inputs(generated("paper")), os.environ)
    run = paper.simulate(start="matched", controller=controller, horizon=5.0)
    request = make_request(
        paper.manifest, Plan(()), start="matched", controller=controller, horizon=5.0, output_step=5.0
    )
    found = simulate_chunk(library, request, {"ck1": np.array([1.0, 3.0])})
    np.testing.assert_array_equal(found.trajectories[0, 0, : paper.manifest.nX], run.states[0])
    np.testing.assert_allclose(found.trajectories[0, -1, : paper.manifest.nX], run.states[-1], atol=1e-5)


def test_interpreted_runs_are_the_compiled_ones(paper: ClosedLoop) -> None:
    other = ClosedLoop.load("paper", "interpreted")
    for controller in ("continuous", "sampled"):
        one, two = (
            loop.simulate(start="matched", controller=controller, horizon=1.0) for loop in (paper, other)
        )
        np.testing.assert_array_equal(one.states, two.states)


def test_plain_clipping_matches_the_filters_only(paper: ClosedLoop) -> None:
    run = paper.simulate(start="matched", compensator=False, horizon=20.0)
    assert run["xi1"][0] == run["y"][0] != 0.0
    assert not run["r1"].any()
    assert not run["r2"].any()
    assert run.ise == pytest.approx(0.381, abs=1e-3)
    assert run.peaks["v"][0] == pytest.approx(219.7, abs=0.5)


def test_zero_stays_as_it_is(paper: ClosedLoop) -> None:
    one, two = paper.simulate(horizon=1.0), paper.simulate(horizon=1.0, start="zero")
    np.testing.assert_array_equal(one.states, two.states)
    assert not one.states[0, paper.manifest.nx :].any()


def test_another_start_is_refused(paper: ClosedLoop) -> None:
    with pytest.raises(UsageError, match="start: is 'cold'; allowed: zero, matched"):
        paper.simulate(start="cold")
