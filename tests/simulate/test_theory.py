"""What the theory says of every run: error dynamics, coordinates, saturation, orders of convergence."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.linalg import expm

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.polynomial import evaluate
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings

EPSILON = np.finfo(float).eps
TOLERANCE = 1e-10


def simulate(evaluator: Evaluator, **asked: Any) -> Run:
    return run(evaluator, make_settings(evaluator.manifest, **asked))


@pytest.fixture(scope="module")
def undisturbed(root: Path, cache: Path) -> Evaluator:
    """Give the paper's model with D = 0."""
    pytest.importorskip("sympy")
    pytest.importorskip("casadi")
    return ClosedLoop.load(
        root / "models" / "paper.toml", disturbance=["0", "0"], environment=os.environ
    ).evaluator


def estimation_error(found: Run) -> Array:
    """Give x - x_hat, shape (rows, n)."""
    return np.column_stack([found[f"x{i}"] - found[f"x_hat{i}"] for i in (1, 2)])


def filter_matrix(evaluator: Evaluator, found: Run) -> Array:
    return evaluator.call("filter_matrix", found.settings.p)[0].reshape(2, 2)


@pytest.mark.parametrize(
    "wrong", [{}, {"b0_plant": 2.6, "d1_plant": 0.5}], ids=["as believed", "another plant"]
)
def test_the_estimation_error_obeys_its_own_linear_equation(
    compiled_paper: Evaluator, wrong: dict[str, float]
) -> None:
    """Check eps' = A0 eps + D by variation of constants along the run; D is what the controller faces."""
    # Without saturation, so that D is smooth and Simpson's rule has its order.
    found = simulate(compiled_paper, horizon=2.0, output_step=0.0005, parameters={"u_max": 1e3, **wrong})
    A0, eps = filter_matrix(compiled_paper, found), estimation_error(found)
    t, x, u = found.t[:, np.newaxis], found.states[:, :2], found["u"][:, np.newaxis]
    (D,) = compiled_paper.call("disturbance", t, x, u, found.settings.p)
    for row in (108, 600, 4000):  # even, for Simpson
        until, times = found.t[row], found.t[: row + 1]
        driven = np.array([expm(A0 * (until - s)) @ d for s, d in zip(times, D, strict=False)])
        expected = expm(A0 * until) @ eps[0] + simpson(driven, x=times, axis=0)
        # Simpson's error is 1/180 times the integral of h^4 times the fourth derivative: the differences.
        bound = 0.0005 / 180 * np.sum(np.abs(np.diff(driven, 4, axis=0))) + TOLERANCE
        assert bound < 1e-8 * (1 + np.abs(D).max())
        np.testing.assert_allclose(eps[row], expected, rtol=0, atol=bound)


def test_without_disturbance_the_estimation_error_only_decays(undisturbed: Evaluator) -> None:
    found = simulate(undisturbed)
    A0, eps = filter_matrix(undisturbed, found), estimation_error(found)
    expected = np.array([expm(A0 * t) @ eps[0] for t in found.t])
    np.testing.assert_allclose(eps, expected, rtol=0, atol=TOLERANCE)


def test_tracking_error_is_z1_plus_r1(paper: Evaluator) -> None:
    for asked in (
        {},
        {"x0": [-3.0, 2.0], "parameters": {"c1": 3.0}},
        {"controller": "sampled", "horizon": 0.5},
    ):
        found = simulate(paper, **asked)
        size = np.abs(found["y"]) + np.abs(found["y_r"]) + np.abs(found["r1"])
        assert np.all(np.abs(found["e"] - found["z1"] - found["r1"]) <= 4 * EPSILON * size)


def test_without_disturbance_z_does_not_know_the_limit(undisturbed: Evaluator) -> None:
    runs = [simulate(undisturbed, parameters={"u_max": limit}, horizon=5.0) for limit in (3.0, 10.0, 1e4)]
    assert len(runs[0].switches) != len(runs[2].switches)
    for name in ("z1", "z2"):
        # z2 stands behind a gain of c1 + e1 over b0, so that it carries the states' error ten times.
        np.testing.assert_allclose(runs[0][name], runs[2][name], rtol=0, atol=100 * TOLERANCE)
        np.testing.assert_allclose(runs[1][name], runs[2][name], rtol=0, atol=100 * TOLERANCE)


def test_with_an_unlimited_actuator_the_compensator_rests(paper: Evaluator) -> None:
    found = simulate(paper, parameters={"u_max": 1e6})
    assert found.switches == ()
    assert found.initial_mode == 0
    assert not found["r1"].any()
    assert not found["r2"].any()
    plain = simulate(paper, parameters={"u_max": 1e6}, compensator=False)
    np.testing.assert_array_equal(found.states, plain.states)


def test_global_error_is_proportional_to_the_tolerance(compiled_paper: Evaluator) -> None:
    best = simulate(compiled_paper, tolerance=1e-14)
    tolerances = 10.0 ** np.arange(-10, -2)
    runs = [simulate(compiled_paper, tolerance=tolerance) for tolerance in tolerances]
    errors = [np.max(np.abs(found.states - best.states)) for found in runs]
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    # The steps' number hardly changes, as stability bounds them here: the errors go as the last terms do.
    assert slope == pytest.approx(1.0, abs=0.2)
    assert np.all(np.array(errors) < 10 * tolerances)


def test_one_step_has_the_order_of_its_polynomial(compiled_paper: Evaluator) -> None:
    """The first term that a step leaves out is of order N + 1."""
    manifest = compiled_paper.manifest
    asked = {"x0": [0.5, 1.0], "parameters": {"u_max": 1e3}, "tolerance": 1e-14}
    sizes = 0.12 * 2.0 ** -np.arange(3)
    start = simulate(compiled_paper, **asked)
    g = np.array([0.0, 1.0])
    (flat,) = compiled_paper.call("taylor", [0.0], start.states[0], g, start.settings.p)
    c = flat.reshape(manifest.order + 1, -1)[:, : manifest.nX]
    ends = [simulate(compiled_paper, **asked, horizon=h, output_step=h).states[-1] for h in sizes]
    errors = [np.max(np.abs(evaluate(c, h) - end)) for h, end in zip(sizes, ends, strict=True)]
    assert min(errors) > 1e-13  # not rounding
    slopes = np.diff(np.log(errors)) / np.diff(np.log(sizes))
    np.testing.assert_allclose(slopes, manifest.order + 1, rtol=0.05)


@pytest.mark.parametrize("column", ["x1", "x2", "lambda1", "r1"])
def test_the_sampled_loop_converges_to_the_continuous_one_at_first_order(
    compiled_paper: Evaluator, column: str
) -> None:
    asked = {"horizon": 1.0, "output_step": 0.1}
    continuous = simulate(compiled_paper, **asked)
    periods = [1e-3, 5e-4, 2.5e-4, 1.25e-4]
    runs = [simulate(compiled_paper, controller="sampled", sample_time=period, **asked) for period in periods]
    errors = [np.max(np.abs(found[column] - continuous[column])) for found in runs]
    slopes = np.diff(np.log(errors)) / np.diff(np.log(periods))
    np.testing.assert_allclose(slopes, 1.0, rtol=0, atol=0.1)


def test_between_samples_the_plant_moves_and_the_controller_holds(paper: Evaluator) -> None:
    asked = {"controller": "sampled", "sample_time": 0.02, "horizon": 0.21, "output_step": 0.005}
    found = simulate(paper, **asked)
    assert found.t[-1] == 0.21  # inside a hold: 10 samples and a half
    sample = np.floor(found.t / 0.02 + 1e-9).astype(int)
    for name in ("v", "u", "z1", "alpha1", "lambda1", "r2", "x_hat1"):
        for k in range(11):
            assert len(set(found[name][sample == k])) == 1
    assert len(set(found["x1"])) == len(found.t)
    np.testing.assert_array_equal(found["y"], found["x1"])
    np.testing.assert_allclose(found["y_r"], np.sin(found.t), rtol=0, atol=2 * EPSILON)
    on_samples = simulate(paper, **{**asked, "output_step": 0.02})
    np.testing.assert_allclose(on_samples["x1"][:-1], found["x1"][::4][:11], rtol=0, atol=1e-14)


def test_a_sampled_switch_is_reported_at_its_sample(paper: Evaluator) -> None:
    found = simulate(paper, controller="sampled", sample_time=0.001, horizon=0.3, output_step=0.001)
    assert found.initial_mode == -1
    for t, label in found.switches:
        row = round(t / 0.001)
        assert np.sign(found["v"][row] - found["u"][row]) == label
        assert np.sign(found["v"][row - 1] - found["u"][row - 1]) != label
    assert [label for _, label in found.switches] == [0, 1, 0]
