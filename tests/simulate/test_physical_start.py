"""A joint starts in physical states and reports them, whatever the plant's own numbers are."""

from __future__ import annotations

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.simulate.trajectory import csv_columns
from pmjoint_codegen.sweep.chunks import fill_in
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

JOINTS = ("joint", "joint-damped", "joint-exact", "joint-lag")


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
@pytest.mark.parametrize("J_plant", [0.03, 0.05, 0.1])
def test_the_start_speed_is_the_one_given(evaluator: str, J_plant: float) -> None:
    loop = ClosedLoop.load("joint-damped", evaluator)
    run = loop.simulate(x0=[0.02, 0.1], parameters={"J_plant": J_plant}, horizon=0.02)
    assert run["theta"][0] == 0.02
    assert run["theta_dot"][0] == pytest.approx(0.1, rel=1e-15)
    assert run["x2"][0] == pytest.approx(0.1 + 0.109 / J_plant * 0.02, rel=1e-15)  # x1' + a x1


@pytest.mark.parametrize("model", JOINTS)
@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_theta_dot_is_the_rate_of_theta(model: str, controller: str) -> None:
    """Central differences, in a plant that the controller does not know: theta_dot has no other source."""
    loop, step = ClosedLoop.load(model), 5e-5
    run = loop.simulate(
        horizon=0.2,
        output_step=step,
        controller=controller,
        sample_time=0.001 if controller == "sampled" else None,
        parameters={"k0_plant": 6e4} if model == "joint" else {"J_plant": 0.07},
    )
    theta, rate = run["theta"], run["theta_dot"]
    np.testing.assert_array_equal(theta, run["y"])
    bend = float(np.max(np.abs(np.diff(rate, 2)))) + float(np.max(np.abs(np.diff(rate)))) * (
        controller == "sampled"  # theta'' jumps at a sample
    )
    differences = (theta[2:] - theta[:-2]) / (2 * step)
    rounding = 1e-16 / step
    assert np.max(np.abs(differences - rate[1:-1])) <= bend + rounding
    assert np.max(np.abs(rate)) > 100 * (bend + rounding)


def test_pressures_start_where_they_are_said_to() -> None:
    run = ClosedLoop.load("joint-lag").simulate(
        x0=[0.1, -0.2, 1e4, -2e4], parameters={"J_plant": 0.08, "k_u_plant": 4e4}, horizon=0.02
    )
    found = [run[name][0] for name in ("theta", "theta_dot", "q1", "q2")]
    # x3 is some 10 rad/s^2; divided by b0_plant and k_u it gives the pressures back to rounding
    assert found == pytest.approx([0.1, -0.2, 1e4, -2e4], rel=1e-13)
    assert (run["P1"][0], run["P2"][0]) == pytest.approx((2.6e5, 2.7e5), rel=1e-13)


def test_sampled_pressures_that_lag_are_those_of_the_instant() -> None:
    run = ClosedLoop.load("joint-lag").simulate(
        x0=[0.1, 0.0], horizon=0.01, output_step=1e-4, controller="sampled", sample_time=0.001
    )
    inside = np.diff(run["P1"])[:9]  # within the first hold
    assert np.all(inside != 0.0)


def test_a_sweep_starts_each_plant_at_the_given_speed() -> None:
    manifest = ClosedLoop.load("joint-damped").manifest
    plan = make_plan(("J_plant=0.03,0.05,0.1", "theta_dot=-0.1,0.2"), (), None, 0, "latin-hypercube")
    request = make_request(manifest, plan, x0=[0.3, 0.0])
    x0, _ = fill_in(manifest, request, plan.columns(0, plan.runs))
    J, speed = (column.reshape(-1) for column in np.meshgrid([0.03, 0.05, 0.1], [-0.1, 0.2], indexing="ij"))
    np.testing.assert_allclose(x0[:, 1], speed + 0.109 / J * 0.3, rtol=1e-15)
    assert not x0[:, 2:].any()


def test_design_coordinates_of_a_joint_are_no_axis() -> None:
    manifest = ClosedLoop.load("joint-damped").manifest
    plan = make_plan(("x2=0,1",), (), None, 0, "latin-hypercube")
    with pytest.raises(UsageError, match=r"no 'x2' to vary; .*theta, theta_dot"):
        make_request(manifest, plan)


def test_a_wrong_number_of_states_names_those_wanted() -> None:
    loop = ClosedLoop.load("joint-lag")
    with pytest.raises(UsageError, match=r"theta, theta_dot, q1, q2; give 4, or 2 for q1, q2 = 0, 0"):
        loop.simulate(x0=[0.0, 0.0, 0.0])


@pytest.mark.parametrize("model", ["paper", "third-order", *JOINTS])
def test_the_table_of_a_run_has_estimate_and_disturbance(model: str) -> None:
    manifest = ClosedLoop.load(model).manifest
    columns, n = csv_columns(manifest), manifest.n
    wanted = [*(f"x_hat{i}" for i in range(1, n + 1)), *(f"D{i}" for i in range(1, n + 1))]
    first = columns.index("u") + 1
    assert list(columns[first : first + 2 * n]) == wanted
    assert (columns[first + 2 * n :][:2] == ("theta", "theta_dot")) == (model in JOINTS)
