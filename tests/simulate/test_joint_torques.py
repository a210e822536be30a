"""Joints with torque, friction and disturbance, against the physics integrated by SciPy under the same u."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.provision import provide
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

from .joints import COULOMB, GRAVITY, SHAKEN, SMOOTH, Array, Bench, write_joint

BOUND = max(2e-8, 100 * DEFAULT_TOLERANCE)
PERIOD = 0.01
# name -> what the design keeps, the keys of [joint], the bench
CASES: dict[str, tuple[tuple[str, ...], dict[str, str], Bench]] = {
    "gravity kept": (("damping", "torque", "gain"), {"torque": GRAVITY}, Bench(gravity=True)),
    "gravity left out": (("damping",), {"torque": GRAVITY}, Bench(gravity=True)),
    "gravity and lag kept": (
        ("damping", "torque", "pressure_lag"),
        {"torque": GRAVITY},
        Bench(gravity=True, lagged=True),
    ),
    "all, lag left out": (
        ("torque", "quadratic_gain"),
        {"torque": GRAVITY, "friction": SMOOTH, "disturbance": SHAKEN},
        Bench(gravity=True, lagged=True, friction="smooth", shaken=True),
    ),
    "all, lag kept": (
        ("damping", "torque", "pressure_lag"),
        {"torque": GRAVITY, "friction": SMOOTH, "disturbance": SHAKEN},
        Bench(gravity=True, lagged=True, friction="smooth", shaken=True),
    ),
    "stick": (
        ("damping", "torque", "gain"),
        {"torque": GRAVITY, "friction": COULOMB},
        Bench(gravity=True, friction="coulomb"),
    ),
    "stick behind a lag": (
        ("damping", "torque", "pressure_lag"),
        {"torque": GRAVITY, "friction": COULOMB},
        Bench(gravity=True, lagged=True, friction="coulomb"),
    ),
}


def load(folder: Path, case: str, evaluator: str = "compiled") -> ClosedLoop:
    keep, torques, bench = CASES[case]
    path = write_joint(folder, keep, lagged=bench.lagged, **torques)
    return ClosedLoop.load(path, evaluator, notify=lambda line: None)


def simulated(loop: ClosedLoop, **settings: Any) -> Run:
    """A sampled run with an output instant in the middle of every hold."""
    return loop.simulate(
        controller="sampled", sample_time=PERIOD, output_step=PERIOD / 2, **{"horizon": 2.0, **settings}
    )


def followed(bench: Bench, run: Run) -> Array:
    """Theta, theta_dot, P1, P2 at the samples, under the u of the run."""
    start = np.array([run["theta"][0], run["theta_dot"][0], bench.P0, bench.P0])
    rows, count = [start], (len(run.t) - 1) // 2
    for k in range(count):
        u = float(run["u"][2 * k + 1])
        rows.append(bench.after_hold(u, k * PERIOD, (k + 1) * PERIOD, rows[-1]))
    return np.array(rows)


@pytest.mark.parametrize("J_plant", [500.0, 700.0])
@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_full_physics_under_its_input(case: str, J_plant: float, tmp_path: Path) -> None:
    """In the plant that the design knows, and in one with another inertia."""
    bench = CASES[case][2]
    bench = replace(bench, J=J_plant * 1e-4)  # kg cm^2
    run = simulated(load(tmp_path, case), parameters={"J_plant": J_plant})
    rows = followed(bench, run)
    np.testing.assert_allclose(run["theta"][::2], rows[:, 0], atol=BOUND)
    np.testing.assert_allclose(run["theta_dot"][::2], rows[:, 1], atol=30 * BOUND)
    if bench.lagged:
        np.testing.assert_allclose(run["P1"][::2], rows[:, 2], rtol=BOUND)
        np.testing.assert_allclose(run["P2"][::2], rows[:, 3], rtol=BOUND)
    assert np.ptp(run["u"]) > 1.0


STICKING = ("stick", "stick behind a lag")


@pytest.mark.parametrize("case", STICKING)
@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_stuck_joint_does_not_move_at_all(case: str, controller: str, tmp_path: Path) -> None:
    """Its speed is x2 - a x1, or x2 - (a + 1/tau) x1: exactly 0, whether or not the design knows J."""
    loop = load(tmp_path, case)
    for J_plant in (500.0, 700.0):
        run = loop.simulate(
            controller=controller,
            sample_time=PERIOD if controller == "sampled" else None,
            parameters={"J_plant": J_plant},
            output_step=0.004,
        )
        assert run.sticks
        moving = np.ones(len(run.t), dtype=bool)
        for begin, end in run.sticks:
            rows = (run.t > begin) & (run.t < end)
            moving &= (run.t < begin) | (run.t > end)
            assert np.count_nonzero(rows) > 50
            assert np.all(run["theta_dot"][rows] == 0.0)
            assert len(set(run["theta"][rows].tolist())) == 1
        assert np.all(run["theta_dot"][moving] != 0.0)


@pytest.mark.parametrize("theta", [0.3, -0.17])
def test_a_joint_that_starts_at_rest_is_stuck_at_once(theta: float, tmp_path: Path) -> None:
    """x2 = a theta is rounded, so its speed may begin at 1e-17, not at 0."""
    run = load(tmp_path, "stick behind a lag").simulate(
        x0=[theta, 0.0], parameters={"Fc": 9000.0, "J_plant": 700.0}, horizon=0.5
    )
    assert run.sticks == ((0.0, 0.5),)
    assert set(run["theta"].tolist()) == {theta} and not np.any(run["theta_dot"])


@pytest.mark.parametrize("case", ["all, lag kept", "stick behind a lag", "stick"])
def test_interpreted_and_swept_runs_agree_with_compiled_ones(case: str, tmp_path: Path) -> None:
    """The interpreter bit by bit, the lanes of a sweep to rounding."""
    compiled, interpreted = (
        load(tmp_path, case, kind).simulate(horizon=0.8) for kind in ("compiled", "interpreted")
    )
    for column in compiled.columns:
        assert compiled[column].tobytes() == interpreted[column].tobytes(), column
    provided = provide(
        tmp_path / "drawn-joint.toml", environment=os.environ, notify=lambda line: None, lanes=True
    )
    plan = make_plan(("J_plant=450,700", "theta=-0.1,0.2", "m_plant=2000,3000"), (), None, 0, "sobol")
    request = make_request(provided.manifest, plan, tolerance=1e-11, output_step=0.2, horizon=2.0)
    columns = plan.columns(0, plan.runs)
    found = simulate_chunk(library_of(make_inputs(provided.folder), os.environ), request, columns)
    loop = load(tmp_path, case)
    states = [item.name for item in loop.manifest.states]
    for i in range(plan.runs):
        values = {name: float(column[i]) for name, column in columns.items()}
        run = loop.simulate(
            x0=[values.pop("theta"), -0.3],
            parameters=values,
            output_step=0.2,
            horizon=2.0,
            tolerance=1e-12,
        )
        expected = np.column_stack([run[name] for name in (*states, "v", "e")])
        assert np.max(np.abs(found.trajectories[i] - expected)) <= 1e-9 * np.max(np.abs(expected))


def test_a_design_that_keeps_all_is_left_rounding(tmp_path: Path) -> None:
    """In place of gravity's 15 rad/s^2: the law is then exact, and so is tracking."""
    keep, torques, _ = CASES["gravity kept"]
    run = load(tmp_path, "gravity kept").simulate(horizon=6.0)
    terms = 1000.0  # rad/s^2 that cancel in D: 5 V times b0 = 44, some times over
    assert np.max(np.abs(run["D2"])) <= terms * 2.0**-52
    assert np.max(np.abs(run["e"][run.t > 4.0])) < 1e-9
    left = ClosedLoop.load(
        write_joint(tmp_path, [item for item in keep if item != "torque"], lagged=False, **torques),
        notify=lambda line: None,
    ).simulate(horizon=6.0)
    assert np.max(np.abs(left["D2"])) > 10.0
