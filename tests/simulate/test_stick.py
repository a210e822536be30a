"""Coulomb friction at rest: a located interval with speed exactly 0, then breakaway."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run

CONTROLLERS: dict[str, dict[str, Any]] = {
    "continuous": {"controller": "continuous"},
    "sampled": {"controller": "sampled", "sample_time": 0.01},
}
# Without input the plant is x1' = x2, x2' = d1 x1 + D.
FREE = {"b0_plant": 1e-12}


def load(force: str, evaluator: str = "compiled", reference: str = "0") -> ClosedLoop:
    return ClosedLoop.load(
        "paper", evaluator, reference=reference, disturbance=("0", force), notify=lambda line: None
    )


@pytest.fixture(params=CONTROLLERS)
def controller(request: pytest.FixtureRequest) -> dict[str, Any]:
    return CONTROLLERS[request.param]


@pytest.fixture(params=["compiled", "interpreted"])
def evaluator(request: pytest.FixtureRequest) -> str:
    kind: str = request.param
    return kind


def free(loop: ClosedLoop, d1: float, x0: list[float], horizon: float, controller: dict[str, Any]) -> Run:
    parameters = {**FREE, "d1_plant": d1}
    return loop.simulate(parameters=parameters, x0=x0, horizon=horizon, output_step=0.01, **controller)


def test_dry_friction_takes_its_share_of_every_half_swing(controller: dict[str, Any]) -> None:
    """Each half period of x'' = -4 x - F sign(x') takes 2 F/4 from the amplitude, until the mass sticks."""
    run = free(load("-0.3*sign(x2)"), -4.0, [0.5, 0.0], 9.0, controller)
    # 0.5, -0.35, 0.2, -0.05: then 4*0.05 < 0.3 holds it; three half periods
    ((begin, end),) = run.sticks
    assert begin == pytest.approx(3 * np.pi / 2, abs=1e-8)
    assert end == 9.0
    after = run.t > begin
    assert np.all(run["x2"][after] == 0.0)
    np.testing.assert_allclose(run["x1"][after], -0.05, atol=2e-8)
    assert np.all(run["x1"][after] == run["x1"][-1])
    assert run.summary["stuck_s"] == end - begin


def test_a_ramp_tears_a_mass_off_when_it_exceeds_friction(evaluator: str, controller: dict[str, Any]) -> None:
    """From rest, x'' = t - F sign(x'): stuck until t = F, then x = (t - F)^3/6."""
    run = free(load("t - 0.7305*sign(x2)", evaluator), 0.0, [0.2, 0.0], 2.0, controller)
    ((begin, end),) = run.sticks
    assert begin == 0.0
    assert end == pytest.approx(0.7305, abs=1e-12)
    stuck, late = run.t < end, np.maximum(run.t - 0.7305, 0.0)
    assert np.all(run["x2"][stuck] == 0.0) and np.all(run["x1"][stuck] == 0.2)
    np.testing.assert_allclose(run["x1"], 0.2 + late**3 / 6, atol=2e-9)
    np.testing.assert_allclose(run["x2"], late**2 / 2, atol=2e-9)


def test_a_step_tears_it_off_at_once_in_the_step_s_direction(controller: dict[str, Any]) -> None:
    for direction in (1, -1):
        force = f"{direction}*(0.2 + 0.3*(1 + sign(t - 0.5)))"
        run = free(load(f"{force} - 0.5*sign(x2)"), 0.0, [0.0, 0.0], 1.0, controller)
        ((begin, end),) = run.sticks
        assert begin == 0.0
        assert end == pytest.approx(0.5, abs=1e-12)
        assert run["x2"][-1] == pytest.approx(direction * 0.3 * 0.5, abs=1e-9)


STATIC, SLIDING = 0.5, 0.2
AT_REST = f"-({SLIDING} + {STATIC - SLIDING}*(1 - sign(x2)**2))*sign(x2)"


def stick_slip(k: float, speed: float, rounds: int) -> tuple[list[float], list[float]]:
    """When a mass under a spring that is pulled breaks away, and when it stops, in closed form.

    x'' = k (speed t - x) - F: it slips by z = x - speed t + F/k, z'' = -k z, until x' = 0.
    """
    omega, x, t = math.sqrt(k), 0.0, 0.0
    leaves, stops = [], []
    for _ in range(rounds):
        t = (STATIC / k + x) / speed
        leaves.append(t)
        z, dz = x - speed * t + SLIDING / k, -speed

        def rate(tau: float, z: float = z, dz: float = dz) -> float:
            return dz * math.cos(omega * tau) - z * omega * math.sin(omega * tau) + speed

        tau = float(brentq(rate, 1e-3 / omega, 1.999 * math.pi / omega, xtol=1e-15))
        x += (z * (math.cos(omega * tau) - 1) + dz / omega * math.sin(omega * tau)) + speed * tau
        t += tau
        stops.append(t)
    return leaves, stops


def test_stick_slip_under_a_pulled_spring_is_that_in_closed_form(
    evaluator: str, controller: dict[str, Any]
) -> None:
    """More friction at rest than in motion: the mass creeps in jumps."""
    run = free(load(f"4*0.3*t {AT_REST}", evaluator), -4.0, [0.0, 0.0], 8.0, controller)
    leaves, stops = stick_slip(4.0, 0.3, 4)
    begins, ends = zip(*run.sticks, strict=True)
    inside = sum(t < 8.0 for t in leaves)
    assert inside >= 3
    np.testing.assert_allclose(ends[:inside], leaves[:inside], atol=1e-8)
    np.testing.assert_allclose(begins[1:inside], stops[: inside - 1], atol=1e-8)
    for begin, end in run.sticks:
        rows = (run.t > begin) & (run.t < end)
        assert np.all(run["x2"][rows] == 0.0) and len(set(run["x1"][rows].tolist())) == 1


def test_the_belt_carries_it_where_friction_is_relative(controller: dict[str, Any]) -> None:
    """sign(x2 - 0.3): on a belt at 0.3 the mass moves with it until the spring exceeds friction."""
    run = free(load("-0.5*sign(x2 - 0.3)"), -4.0, [0.0, 0.3], 2.0, controller)
    begin, end = run.sticks[0]
    assert begin == 0.0
    assert end == pytest.approx(0.5 / 4 / 0.3, abs=1e-10)
    assert np.all(run["x2"][run.t < end] == 0.3)


def test_on_a_belt_that_speeds_up_friction_drives(controller: dict[str, Any]) -> None:
    """sign(x2 - 0.3 sin(t)): it moves with the belt while that takes less force than friction gives."""
    run = free(load("-0.2*sign(x2 - 0.3*sin(t))"), 0.0, [0.0, 0.0], 2.5, controller)
    begin, end = run.sticks[0]
    slip = math.acos(0.2 / 0.3)  # the latest instant at which the belt still outruns it
    assert begin > slip
    assert end == pytest.approx(math.pi - slip, abs=1e-9)
    rows = (run.t > begin) & (run.t < end)
    np.testing.assert_allclose(run["x2"][rows], 0.3 * np.sin(run.t[rows]), atol=1e-9)


def test_a_joint_rests_at_every_reversal(evaluator: str, controller: dict[str, Any]) -> None:
    """Under the law, with friction beyond what it knows: exactly at rest, until the input has grown."""
    loop = load("-0.8*sign(x2)", evaluator, "0.3*sin(2*t)")
    run = loop.simulate(x0=[0.0, 0.0], horizon=5.0, **controller)
    assert len(run.sticks) >= 3
    for begin, end in run.sticks:
        rows = (run.t > begin) & (run.t < end)
        assert np.all(run["x2"][rows] == 0.0)
    moving = ~np.any([(run.t >= begin) & (run.t <= end) for begin, end in run.sticks], axis=0)
    assert np.all(run["x2"][moving & (run.t > 0.0)] != 0.0)
    assert run.summary["stuck_s"] == pytest.approx(sum(end - begin for begin, end in run.sticks))


def test_friction_is_reported_as_what_it_holds_against(evaluator: str, controller: dict[str, Any]) -> None:
    """At rest D2 is minus the other forces, not 0; in motion it is what the model says."""
    run = load(AT_REST, evaluator, "0.3*sin(t)").simulate(x0=[0.0, 0.0], horizon=5.0, **controller)
    assert run.sticks
    rest = np.any([(run.t > begin) & (run.t < end) for begin, end in run.sticks], axis=0)
    moving = (run["x2"] != 0.0) & ~rest
    if controller["controller"] == "continuous":
        others = 2.0 * run["u"] + 0.2 * run["x1"]
        np.testing.assert_allclose(run["D2"][rest], -others[rest], atol=1e-12)
        np.testing.assert_allclose(run["D2"][moving], -SLIDING * np.sign(run["x2"][moving]), atol=1e-12)
    assert np.any(np.abs(run["D2"][rest]) > SLIDING) and np.all(np.abs(run["D2"]) <= STATIC + 1e-12)


@pytest.mark.parametrize(
    "force",
    [
        "-0.8*sign(x2)",
        "-(0.5 + 0.3*exp(-(x2/0.05)**2) + 0.2*(1 - sign(x2)**2))*sign(x2) - 0.1*x2*abs(x2) + 0.1*sign(t-1)",
    ],
)
def test_both_evaluators_do_the_same(force: str, controller: dict[str, Any]) -> None:
    settings: dict[str, Any] = dict(x0=[0.0, 0.0], horizon=3.0, **controller)
    one, other = (
        load(force, kind, "0.3*sin(2*t)").simulate(**settings) for kind in ("compiled", "interpreted")
    )
    assert one.sticks and one.sticks == other.sticks
    assert np.array_equal(one.states, other.states)
    assert (one.steps, one.ise, one.peaks) == (other.steps, other.ise, other.peaks)


def test_a_model_that_cannot_stick_says_nothing_of_it() -> None:
    run = load("0").simulate(horizon=0.1)
    assert "stuck_s" not in run.summary and run.sticks == ()


@pytest.mark.parametrize("force", [0.4, -0.4])
def test_a_force_between_both_frictions_does_not_start_a_mass_at_rest(
    force: float, evaluator: str, controller: dict[str, Any]
) -> None:
    """More than friction in motion, less than at rest: from a start at rest nothing moves."""
    run = free(load(f"{force} {AT_REST}", evaluator), 0.0, [0.1, 0.0], 1.0, controller)
    assert run.sticks == ((0.0, 1.0),)
    assert np.all(run["x1"] == 0.1) and np.all(run["x2"] == 0.0)
    pushed = free(
        load(f"{force} {AT_REST}", evaluator), 0.0, [0.1, math.copysign(1e-3, force)], 1.0, controller
    )
    assert pushed.sticks == () and abs(pushed["x2"][-1]) == pytest.approx(0.201, abs=1e-9)


# Arguments that are 0 at rest, x1 = 0.3 and x2 = 0: a run that settles there stays on the kink, to rounding.
BENDS = (
    "0.3*abs(x2 - 0.7*x1 + 0.21)",
    "0.3*max(x2 + 0.45*x1 - 0.135, 0)",
    "0.4*min(x2 - 0.52*x1 + 0.156, 0) - 0.2*x2",
    "0.3*abs(x2 - 0.35*x1 + 0.105) + 0.2*abs(x2)",
    "0.038*abs(x2 - 0.51*x1 + 0.1521) - 0.1*sign(x2)",  # and a force that friction just holds
)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("force", BENDS)
def test_a_run_may_come_to_rest_on_a_kink_without_a_jump(force: str, name: str) -> None:
    """Rounding alone decides the side there, and the rates on both sides are the same."""
    control = CONTROLLERS[name] | {"sample_time": 0.001}
    loop, other = (load(force, kind, "0.3") for kind in ("compiled", "interpreted"))
    for x0 in ([0.2, 1.0], [0.3, 0.0], [1.0, 0.0]):
        for tolerance in (1e-10, 1e-13):
            run = loop.simulate(x0=x0, horizon=60.0, tolerance=tolerance, **control)
            assert run.status is Status.DONE
            assert "sign(x2)" in force or not run.sticks
            assert abs(run["x1"][-1] - run["x1"][-2]) < 1e-5
    twin = other.simulate(x0=x0, horizon=1.0, tolerance=tolerance, **control)
    first = loop.simulate(x0=x0, horizon=1.0, tolerance=tolerance, **control)
    assert np.array_equal(twin.states, first.states)
