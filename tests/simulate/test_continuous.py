"""Switching, on a model whose v is a given polynomial of time, so that every switch is known beforehand."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.evaluator import Array, Evaluator, Kernel
from pmjoint_codegen.loops.modes import make_actuator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate import run as run_module
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.simulate.summary import saturated_time

from .conftest import PolynomialEvaluator, polynomial_manifest

LIMIT = 2.0
ULP = float(np.spacing(LIMIT))


def simulate(model: Evaluator, v: Sequence[float], horizon: float = 1.0, **changes: float) -> Run:
    """Run x' = clip(v(t)) with the given coefficients of v."""
    p = np.array([LIMIT, *v, *[0.0] * (7 - len(v))])
    settings = Settings(
        parameters={},
        p=p,
        x0=np.zeros(1),
        horizon=horizon,
        output_step=horizon / 7,
        controller="continuous",
        sample_time=1.0,
        tolerance=1e-10,
    )
    return run(model, replace(settings, **changes))  # type: ignore[arg-type]  # numbers only


def shape(level: float, *roots: float, scale: float = 1.0) -> list[float]:
    """Coefficients of level + scale prod (t - root)."""
    return [float(c) for c in (Polynomial.fromroots(roots) * scale + level).coef]


def modes(found: Run) -> list[int]:
    return [found.initial_mode, *(mode for _, mode in found.switches)]


def exact(v: Sequence[float], until: float, switches: Sequence[float]) -> float:
    """Integral of clip(v) from 0 to `until`, piece by piece."""
    total = 0.0
    whole = Polynomial(v).integ()
    for start, end in zip([0.0, *switches], [*switches, until], strict=True):
        inside = float(Polynomial(v)(start + 0.4 * (end - start)))
        total += (
            whole(end) - whole(start) if abs(inside) <= LIMIT else np.sign(inside) * LIMIT * (end - start)
        )
    return float(total)


@pytest.mark.parametrize(
    ("v", "switches", "expected"),
    [
        ([0.0, 1.0], [], [0]),
        ([0.0, 4.0], [0.5], [0, 1]),
        ([-4.0, 8.0], [0.25, 0.75], [-1, 0, 1]),
        (shape(LIMIT, 0.25, 0.75), [0.25, 0.75], [1, 0, 1]),
        (shape(LIMIT, 0.25, 0.75, scale=-4.0), [0.25, 0.75], [0, 1, 0]),  # out and back inside one step
        (shape(-LIMIT, 0.25, 0.75, scale=8.0), [0.25, 0.75], [0, -1, 0]),
        (shape(-LIMIT, 0.25, 0.75, scale=-4.0), [0.25, 0.75], [-1, 0, -1]),
        (shape(LIMIT, 0.5, 0.5, scale=-1.0), [], [0]),  # touches from inside
        (shape(LIMIT, 0.5, 0.5), [], [1]),  # touches from outside
        (shape(LIMIT, 0.5, 0.5, 0.5, scale=8.0), [0.5], [0, 1]),  # passes with a horizontal tangent
        (shape(LIMIT, 0.125, 0.25, 0.5, 0.75, scale=64.0), [0.125, 0.25, 0.5, 0.75], [1, 0, 1, 0, 1]),
        (shape(LIMIT, 0.0, scale=1.0), [], [1]),  # starts on the threshold and leaves outwards
        (shape(LIMIT, 0.0, scale=-1.0), [], [0]),  # ... inwards
        (shape(LIMIT, 0.0, 0.5, scale=-1.0), [0.5], [1, 0]),  # ... outwards, comes back
        (shape(LIMIT, 0.0, 0.0, scale=1.0), [], [1]),  # ... outwards, with a horizontal tangent
        (shape(LIMIT, 0.0, 0.0, 0.0, scale=-1.0), [], [0]),
        (shape(-LIMIT, 0.0, scale=-1.0), [], [-1]),
        (shape(-LIMIT, 0.0, scale=1.0), [], [0]),
        ([LIMIT - ULP, 4.0], [], [1]),  # a rounding before the threshold, and leaves outwards
        ([LIMIT + ULP, -3.0], [], [0]),  # a rounding behind it, and comes back
        ([-LIMIT + ULP, -4.0], [], [-1]),
        ([LIMIT, ULP, -1.0], [], [0]),  # leaves it by a rounding and comes back
        ([LIMIT], [], None),  # stays on the threshold: either mode is right
        (shape(LIMIT, 1.0), [], [0]),  # reaches it at the horizon
    ],
)
def test_every_switch_is_found_where_it_is(
    polynomial_model: Evaluator, v: list[float], switches: list[float], expected: list[int] | None
) -> None:
    found = simulate(polynomial_model, v)
    assert found.status == Status.DONE
    if expected is not None:
        assert modes(found) == expected
    triple = len(set(np.round(Polynomial([v[0] - LIMIT, *v[1:]]).roots(), 3))) < len(v) - 1
    times = [t for t, _ in found.switches]
    np.testing.assert_allclose(times, switches, rtol=0, atol=1e-4 if triple else 1e-13)
    np.testing.assert_allclose(found["x1"][-1], exact(v, 1.0, switches), rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["compiled", "interpreted"])
def test_limits_of_two_channels_a_rounding_apart_are_passed_together(root: Path, kind: str) -> None:
    if kind == "compiled" and find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    loop = ClosedLoop.load(root / "models" / "joint-damped.toml", kind)
    coarse, fine = (
        loop.simulate(
            x0=[0.3, 0.0], horizon=0.3, parameters={"u_max": 2.8942391573287445}, tolerance=tolerance
        )
        for tolerance in (1e-10, 1e-12)
    )
    thresholds = make_actuator(loop.evaluator.call("actuation", fine.settings.p)[0]).thresholds
    gaps = np.diff(thresholds)[::2]  # u's limit and that of the pressures which follow u
    assert len(thresholds) == 4
    assert np.all(gaps <= 4 * np.spacing(thresholds[-1]))
    assert [mode for _, mode in coarse.switches] == [mode for _, mode in fine.switches]
    np.testing.assert_allclose(coarse["x1"], fine["x1"], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "v",
    [
        shape(LIMIT, 0.25, 0.75, scale=-4.0),
        shape(LIMIT, 0.25, 0.75, scale=4.0),
        shape(-LIMIT, 0.25, 0.75, scale=8.0),
        shape(LIMIT, 0.125, 0.25, 0.5, 0.75, scale=64.0),
        [0.0, -1.0, 30.0, -33.0],  # its line at 0 stays inside, the curve leaves on both sides
        [-1.0, 0.0, 0.0, 8.0, 0.0, -8.0],
    ],
)
def test_what_stays_between_the_thresholds_is_told_before_the_step(
    polynomial_model: Evaluator, v: list[float]
) -> None:
    """No crossing is missed, and none found by a step that fails: each piece is a polynomial, so one step."""
    found = simulate(polynomial_model, v)
    roots = [root for limit in (-LIMIT, LIMIT) for root in Polynomial([v[0] - limit, *v[1:]]).roots()]
    real = [float(np.real(root)) for root in roots if abs(np.imag(root)) < 1e-9]
    crossings = sorted(root for root in real if 0.0 < root < 1.0)
    np.testing.assert_allclose([t for t, _ in found.switches], crossings, rtol=0, atol=1e-12)
    assert found.steps == len(found.switches) + 1


def test_states_and_outputs_are_exact_on_both_sides_of_a_switch(polynomial_model: Evaluator) -> None:
    v = shape(LIMIT, 0.3, 0.6, scale=-4.0)
    found = simulate(polynomial_model, v, output_step=0.01)
    expected = [exact(v, t, [s for s in (0.3, 0.6) if s < t]) for t in found.t]
    np.testing.assert_allclose(found["x1"], expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found["v"], Polynomial(v)(found.t), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(found["u"], np.clip(found["v"], -LIMIT, LIMIT))


def test_output_instants_are_multiples_of_the_step_and_the_horizon(polynomial_model: Evaluator) -> None:
    found = simulate(polynomial_model, [1.0], output_step=0.3)
    np.testing.assert_array_equal(found.t, [0.0, 0.3, 0.6, 3 * 0.3, 1.0])
    np.testing.assert_allclose(found["x1"], found.t, rtol=0, atol=1e-15)
    assert simulate(polynomial_model, [1.0], output_step=0.1).t.size == 11


def test_integral_of_e_squared_and_peaks_come_from_the_dense_output(polynomial_model: Evaluator) -> None:
    v = [1.0, -2.0]  # x = t - t^2, largest at 1/2, which is no output instant
    found = simulate(polynomial_model, v)
    square = Polynomial([0.0, 1.0, -1.0]) ** 2
    assert found.ise == pytest.approx(float(square.integ()(1.0)), rel=1e-13)
    assert found.peaks["x1"] == pytest.approx((0.25, 0.5), rel=1e-12)
    assert found.peaks["v"] == pytest.approx((1.0, 0.0), rel=1e-12)


def test_saturated_time_adds_up(polynomial_model: Evaluator) -> None:
    found = simulate(polynomial_model, [-4.0, 8.0])
    assert saturated_time(found) == pytest.approx(0.5, abs=1e-13)
    assert found.initial_mode == -1
    assert [*map(list, found.switches)] == [[pytest.approx(0.25), 0], [pytest.approx(0.75), 1]]


def test_a_run_with_more_switches_than_there_was_room_for_begins_again(
    polynomial_model: Evaluator, monkeypatch: pytest.MonkeyPatch
) -> None:
    v = shape(LIMIT, 0.125, 0.25, 0.5, 0.75, scale=64.0)
    whole = simulate(polynomial_model, v)
    monkeypatch.setattr(run_module, "FEW_SWITCHES", 2)
    found = simulate(polynomial_model, v)
    assert found.status == Status.DONE
    assert (found.switches, found.steps, found.ise) == (whole.switches, whole.steps, whole.ise)
    np.testing.assert_array_equal(found.states, whole.states)


def test_limits_of_steps_and_switches_end_the_run_with_what_there_is(polynomial_model: Evaluator) -> None:
    v = shape(LIMIT, 0.125, 0.25, 0.5, 0.75, scale=64.0)
    few = simulate(polynomial_model, v, max_switches=2)
    assert few.status == Status.TOO_MANY_SWITCHES
    assert "2 saturation switches" in few.message
    assert len(few.switches) == 2
    short = simulate(polynomial_model, v, max_steps=3)
    assert short.status == Status.TOO_MANY_STEPS
    assert short.t[-1] <= 0.5
    np.testing.assert_allclose(
        short["x1"][-1], exact(v, short.t[-1], [s for s in (0.125, 0.25) if s < short.t[-1]])
    )


def test_divergence_ends_the_run(polynomial_model: Evaluator) -> None:
    found = simulate(polynomial_model, [1.5], horizon=100.0, divergence=30.0)
    assert found.status == Status.DIVERGED
    assert "30" in found.message


def test_what_is_not_finite_at_the_start_is_said(polynomial_model: Evaluator) -> None:
    found = simulate(polynomial_model, [np.inf, 1.0])
    assert found.status == Status.NON_FINITE
    assert found.t.tolist() == [0.0]


class Kinked(PolynomialEvaluator):
    """A model with a corner that its Taylor coefficients do not know: x' = |t - 1/3|."""

    def kernel(self, name: str) -> Kernel:
        inner = super().kernel(name)

        def kinked(t: Array, X: Array, g: Array, p: Array) -> tuple[Array, ...]:
            sign = 1.0 if t[0] >= 1 / 3 else -1.0
            return inner(t, X, g, np.array([p[0], -sign / 3, sign, *[0.0] * 5]))

        return kinked if name == "taylor" else inner


def test_a_corner_in_the_model_is_noticed_and_stepped_up_to() -> None:
    model = Kinked(polynomial_manifest())
    found = simulate(model, [0.0])
    assert found.status == Status.DONE
    # The corner's error is a slope's jump over the last interval, which the defect holds to 64 tolerances.
    assert found["x1"][-1] == pytest.approx(1 / 18 + 4 / 18, abs=64e-10)


def test_progress_goes_from_start_to_end_and_interrupts_pass_through(polynomial_model: Evaluator) -> None:
    settings = simulate(polynomial_model, [1.0]).settings
    told: list[float] = []
    run(polynomial_model, settings, told.append)
    assert told[-1] == 1.0

    def interrupt(fraction: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(polynomial_model, settings, interrupt)
