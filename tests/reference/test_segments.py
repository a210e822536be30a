"""Segments: a filter's closed form against its differential equation, and what holds between points."""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.reference.command import Command
from pmjoint_codegen.reference.reader import command_of
from pmjoint_codegen.reference.segments import Segments, degrees, inside, make_segments

STEPS = {"steps": [[0.0, 0.2], [1.0, 1.0], [1.5, -1.0], [3.0, 0.5]]}
RAMPS = {"ramps": [[-0.5, 0.2], [1.0, 1.0], [1.5, -1.0], [3.0, 0.5]]}


def command(given: object) -> Command:
    return command_of(given, instants=lambda: np.linspace(0.0, 4.0, 401), unit="rad")


def reference(found: Segments, t: np.ndarray, rho: int) -> np.ndarray:
    """y_r of the rows, as the kernels evaluate it."""
    p, q = degrees(rho)
    rows = found.rows[found.places(t)]
    tau = t - rows[:, 0]
    first = sum(rows[:, 2 + k] * tau**k for k in range(p + 1))
    return np.asarray(
        first + np.exp(-rows[:, 1] * tau) * sum(rows[:, 3 + p + k] * tau**k for k in range(q + 1))
    )


@pytest.mark.parametrize("rho", [1, 2, 3])
@pytest.mark.parametrize("given", [STEPS, RAMPS])
@pytest.mark.parametrize("a", [0.7, 8.0, 300.0])
def test_the_filter_is_its_differential_equation(given: dict[str, Any], a: float, rho: int) -> None:
    found = make_segments(command({**given, "filter": a}), rho)
    # Stages, then the command and its slope: one linear system, stepped exactly from instant to instant.
    size, points = rho + 1, next(iter(given.values()))
    A = np.zeros((size + 2, size + 2))
    A[0, size] = a
    for i in range(size):
        A[i, i] = -a
        A[i, i - 1] = a if i else 0.0
    A[size, size + 1] = 1.0
    state, now = np.array([points[0][1]] * size + [points[0][1], 0.0]), points[0][0]
    slopes = (
        np.diff([y for _, y in points]) / np.diff([t for t, _ in points]) if "ramps" in given else [0.0] * 3
    )
    edges = [t for t, _ in points] + [5.0]
    for (_, y), slope, end in zip(points, [*slopes, 0.0], edges[1:], strict=True):
        state[size:] = y, slope
        for t in np.linspace(now, end, 7)[1:]:
            state, now = expm(A * (t - now)) @ state, float(t)
            if t > 0.0 and t < end:
                assert reference(found, np.array([t]), rho)[0] == pytest.approx(state[size - 1], abs=2e-12)


@pytest.mark.parametrize("rho", [1, 2, 3])
def test_a_filtered_step_has_rho_continuous_derivatives_and_one_more_jumps(rho: int) -> None:
    a = 5.0
    found = make_segments(command({**STEPS, "filter": a}), rho)
    p, _ = degrees(rho)

    def derivative(row: np.ndarray, tau: float, order: int) -> float:
        first, second = np.polynomial.Polynomial(row[2 : 3 + p]), np.polynomial.Polynomial(row[3 + p :])
        for _ in range(order):
            first, second = first.deriv(), second.deriv() - row[1] * second
        return float(first(tau) + np.exp(-row[1] * tau) * second(tau))

    for before, after in zip(found.rows, found.rows[1:], strict=False):
        for order in range(rho + 1):
            left, right = derivative(before, after[0] - before[0], order), derivative(after, 0.0, order)
            assert left == pytest.approx(right, abs=1e-12 * a**order * factorial(order + 1))
        left, right = (
            derivative(before, after[0] - before[0], rho + 1),
            derivative(after, 0.0, rho + 1),
        )
        assert abs(left - right) > 0.1 * a ** (rho + 1)


def test_what_holds_between_points_and_beyond() -> None:
    t = np.array([0.0, 0.999, 1.0, 1.25, 2.0, 3.5])
    np.testing.assert_array_equal(make_segments(command(STEPS), 2).values(t), [0.2, 0.2, 1.0, 1.0, -1.0, 0.5])
    late = make_segments(command({"ramps": [[1.0, 0.2], [1.5, 1.0]]}), 2)
    np.testing.assert_allclose(late.values(t), [0.2, 0.2, 0.2, 0.6, 1.0, 1.0], atol=1e-15)
    np.testing.assert_array_equal(late.breaks, [1.0, 1.5])
    early = make_segments(command({"steps": [[-2.0, 5.0], [-1.0, 0.2], [1.0, 1.0]]}), 2)
    np.testing.assert_array_equal(early.breaks, [1.0])
    assert early.values(np.array([0.0]))[0] == 0.2


def test_break_points_inside_a_horizon() -> None:
    breaks, rows = inside(make_segments(command(STEPS), 2), 1.5)
    np.testing.assert_array_equal(breaks, [1.0])
    assert len(rows) == 2
    assert inside(None, 1.0)[1].shape == (0, 0)


def test_too_few_points_for_a_smooth_spline() -> None:
    with pytest.raises(UsageError, match="too few for 3 continuous derivatives; allowed: at least 3 points"):
        make_segments(command({"table": [[0.0, 0.0], [1.0, 1.0]]}), 3)
    assert len(make_segments(command({"table": [[0.0, 0.0], [1.0, 1.0]], "filter": 5.0}), 3).breaks) == 1


def test_numbers_that_overflow_are_refused() -> None:
    with pytest.raises(UsageError, match="no finite coefficients"):
        make_segments(command({"ramps": [[0.0, -1e308], [1e-300, 1e308]]}), 2)
