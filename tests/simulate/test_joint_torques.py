"""Joints with torque, friction and disturbance, against the physics integrated by SciPy under the same u."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE

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
