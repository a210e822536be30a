"""Kinks of the disturbance are events, located by both controllers and both evaluators."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import ModelError, SimulationError, UsageError
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run

FRICTION = ("0", "-0.3*sign(x2) - abs(x1)/10")
CONTROLLERS = ("continuous", "sampled")


def load(disturbance: tuple[str, str], evaluator: str = "compiled", reference: str = "sin(t)") -> ClosedLoop:
    return ClosedLoop.load(
        "paper", evaluator, reference=reference, disturbance=disturbance, notify=lambda line: None
    )


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_controller_meets_the_friction_that_was_stated(controller: str) -> None:
    run = load(FRICTION).simulate(controller=controller, horizon=2.0)
    expected = -0.3 * np.sign(run["x2"]) - np.abs(run["x1"]) / 10
    moving = np.abs(run["x2"]) > 0
    if controller == "continuous":
        np.testing.assert_allclose(run["D2"][moving], expected[moving], rtol=1e-14)
    assert np.any(run["D2"] > 0) and np.any(run["D2"] < 0)


# Without input the plant is x1' = x2, x2' = d1 x1 + D; each case has its solution in closed form or by parts.
FREE: dict[str, Any] = dict(parameters={"b0_plant": 1e-12, "d1_plant": -4.0}, horizon=3.0, output_step=0.01)


def free_motion(pieces: list[tuple[float, Any]], x0: list[float], t: np.ndarray) -> np.ndarray:
    """x1 and x2 over t, each piece of D(t, x) up to its end, so that the integrator meets no kink."""
    states, start, x = np.empty((len(t), 2)), 0.0, np.array(x0)
    for end, force in pieces:
        inside = (t >= start) & (t <= end)
        grid = np.unique([start, *t[inside], end])

        def rates(s: float, y: np.ndarray, force: Any = force) -> list[float]:
            return [y[1], -4.0 * y[0] + force(s, y)]

        found = solve_ivp(rates, (start, end), x, "DOP853", grid, rtol=1e-12, atol=1e-13, max_step=0.01)
        states[inside] = found.y.T[np.searchsorted(grid, t[inside])]
        start, x = end, found.y[:, -1]
    return states


TIMES: dict[str, tuple[str, list[tuple[float, Any]]]] = {
    "jump": ("sign(t-0.7305)", [(0.7305, lambda t, x: -1.0), (3.0, lambda t, x: 1.0)]),
    "corner": ("abs(t-1.2345)", [(1.2345, lambda t, x: 1.2345 - t), (3.0, lambda t, x: t - 1.2345)]),
    "ramp": (
        "min(max(5*(t-1.01), 0), 2)",
        [(1.01, lambda t, x: 0.0), (1.41, lambda t, x: 5 * (t - 1.01)), (3.0, lambda t, x: 2.0)],
    ),
    "one inside another": (
        "abs(abs(t-1.5) - 0.25)",
        [
            (1.25, lambda t, x: 1.25 - t),
            (1.5, lambda t, x: t - 1.25),
            (1.75, lambda t, x: 1.75 - t),
            (3.0, lambda t, x: t - 1.75),
        ],
    ),
    "a pulse's threshold": (
        "sign(exp(-((t-2)/0.02)**2) - 0.5)",
        [
            (2 - 0.02 * np.log(2) ** 0.5, lambda t, x: -1.0),
            (2 + 0.02 * np.log(2) ** 0.5, lambda t, x: 1.0),
            (3.0, lambda t, x: -1.0),
        ],
    ),
}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("name", TIMES)
def test_kinks_over_time_are_met_where_they_are(name: str, controller: str) -> None:
    text, pieces = TIMES[name]
    run = load(("0", text)).simulate(x0=[0.3, 0.0], controller=controller, sample_time=0.01, **FREE)
    wanted = free_motion(pieces, [0.3, 0.0], run.t)
    assert np.max(np.abs(run.states[:, :2] - wanted)) < 2e-9


# The product of sides is not affine in either, so neither kink can hold.
PRODUCT = ("0", "-0.3*sign(x2)*(2 + sign(x2)*sign(x1 - 5))")


@pytest.mark.parametrize("settings", [{}, {"controller": "sampled", "sample_time": 0.01}])
@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
def test_a_kink_that_cannot_be_solved_ends_a_run_with_a_word(
    evaluator: str, settings: dict[str, Any]
) -> None:
    """No number for what the loops cannot tell; the word names the kink."""
    with pytest.raises(SimulationError, match=r"stuck to the kink of sign\(x2\) at t = 0 s") as caught:
        load(PRODUCT, evaluator, "0").simulate(x0=[0.0, 0.0], horizon=1.0, **settings)
    run = caught.value.run
    assert isinstance(run, Run) and run.status == Status.SLIDING


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_both_evaluators_do_the_same(controller: str) -> None:
    disturbance = ("0", "-0.3*sign(x2) + 0.2*abs(abs(x1) - 0.5) - max(0, x2 - 1)")
    settings: dict[str, Any] = dict(horizon=1.5, controller=controller, sample_time=0.02)
    one, other = (load(disturbance, kind).simulate(**settings) for kind in ("compiled", "interpreted"))
    assert np.array_equal(one.states, other.states)
    assert (one.steps, one.ise, one.peaks) == (other.steps, other.ise, other.peaks)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_smooth_stand_in_comes_as_close_as_it_is_narrow(controller: str) -> None:
    settings: dict[str, Any] = dict(horizon=1.0, controller=controller)
    run = load(FRICTION).simulate(**settings)
    far, near = (
        load(("0", f"-0.3*tanh(x2/{width}) - abs(x1)/10")).simulate(**settings) for width in ("1e-3", "1e-4")
    )
    apart = [np.max(np.abs(run["x1"] - stand_in["x1"])) for stand_in in (far, near)]
    assert apart[1] < 0.2 * apart[0] < 1e-4


def test_min_and_max_take_two() -> None:
    with pytest.raises(ModelError, match=r"min takes two arguments; write min\(a, b\)"):
        load(("0", "min(x1)"))


def test_what_the_controller_knows_must_stay_smooth() -> None:
    with pytest.raises(ModelError, match="abs has a kink; allowed in a disturbance only"):
        ClosedLoop.load("paper", reference="abs(sin(t))")


def test_a_longest_step_is_a_positive_number() -> None:
    with pytest.raises(UsageError, match="max step: is 0 s"):
        load(("0", "0")).simulate(max_step=0.0)


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
def test_beyond_a_kink_a_hold_is_looked_at_anew(evaluator: str) -> None:
    """A bump that one side has and the other has not, narrower than a hold, right behind the kink."""
    kind: dict[str, Any] = dict(
        x0=[-0.3, 0.0], horizon=1.0, controller="sampled", sample_time=0.001, tolerance=1e-8
    )
    bump = "30*exp(-((x1-0.002+{})/0.00002)**2)"
    behind, everywhere, nowhere = (
        load(("0", force), evaluator).simulate(**kind)
        for force in (bump.format("5*(1-sign(x1))"), bump.format("0"), "0")
    )
    met = abs(everywhere.ise - nowhere.ise)
    assert met > 1e-5 * nowhere.ise
    assert abs(behind.ise - everywhere.ise) < 1e-3 * met


@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
@pytest.mark.parametrize("inner", ["-", "+"])
@pytest.mark.parametrize("settings", [{}, {"controller": "sampled", "sample_time": 0.05}])
def test_an_argument_that_jumps_with_another_s_side_is_passed_once(
    evaluator: str, inner: str, settings: dict[str, Any]
) -> None:
    """At 0.13 s the inner sign makes the outer argument jump over 0; the same in smooth pieces."""
    kinked = load(("0", f"-2*sign(x1 + 0.4 {inner} 0.9*sign(t-0.13))"), evaluator)
    found = kinked.simulate(x0=[0, 0], horizon=2.0, **settings)
    fine = kinked.simulate(x0=[0, 0], horizon=2.0, max_step=1e-3, **settings)
    assert found.status is Status.DONE
    expected = -2 * np.sign(found["x1"] + 0.4 + (0.9 if inner == "+" else -0.9) * np.sign(found.t - 0.13))
    inside = np.abs(found.t - 0.13) > 1e-9
    if not settings:
        np.testing.assert_allclose(found["D2"][inside], expected[inside], atol=1e-12)
    np.testing.assert_allclose(found["x1"], fine["x1"], rtol=0, atol=2e-8)
    # With the sides that D shows, x2' is what the states say: no side is held wrongly.
    x2 = found["x2"]
    assert abs(found.ise - fine.ise) <= 2e-8 and np.all(np.isfinite(x2))


ISE = {"-": 0.0282870825, "+": 0.0486987879}  # of steps of 0.1 ms; the first also of another integrator


@pytest.mark.parametrize("inner", ["-", "+"])
def test_such_a_jump_has_the_ise_of_small_steps(inner: str) -> None:
    kinked = load(("0", f"-2*sign(x1 + 0.4 {inner} 0.9*sign(t-0.13))"))
    assert kinked.simulate(x0=[0, 0], horizon=2.0).ise == pytest.approx(ISE[inner], abs=2e-9)


def test_what_min_does_not_choose_does_not_count() -> None:
    """min(exp(20 t), 1) is 1 for t > 0, however large the exponential is."""
    chosen = load(("0", "min(exp(20*t), 1)"), reference="0").simulate(x0=[0, 0], horizon=2.0)
    plain = load(("0", "1"), reference="0").simulate(x0=[0, 0], horizon=2.0)
    assert chosen.status is Status.DONE
    np.testing.assert_allclose(chosen["x1"], plain["x1"], rtol=0, atol=2e-8)


@pytest.mark.parametrize("text", ["sign(max(t-1,0))", "sign(abs(x1) - x1)", "sign(min(x2, 0) + abs(0))"])
def test_a_sign_that_is_0_over_an_interval_is_refused(text: str) -> None:
    with pytest.raises(ModelError, match="is 0 over an interval"):
        load(("0", text))
    load(("0", "sign(abs(x1) - 0.5)"))
