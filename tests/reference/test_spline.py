"""The spline against SciPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from pmjoint_codegen.reference.spline import half_degree, spline_pieces


@pytest.mark.parametrize(
    ("m", "points", "allowed"), [(2, 4, 1e-13), (2, 40, 1e-13), (3, 6, 1e-12), (3, 40, 1e-12), (4, 40, 1e-11)]
)
def test_the_spline_is_scipy_s(m: int, points: int, allowed: float) -> None:
    """Up to the conditioning of the system, which grows with the degree and with uneven spacing."""
    random = np.random.default_rng([m, points])
    t, y = np.cumsum(random.uniform(0.5, 1.0, points)), random.normal(size=points)
    expected = make_interp_spline(t, y, k=2 * m - 1)
    compare(t, spline_pieces(t, y, m), expected, allowed)


@pytest.mark.parametrize(("m", "points"), [(2, 2), (2, 3), (3, 3), (3, 5)])
def test_few_points_give_the_natural_spline(m: int, points: int) -> None:
    random = np.random.default_rng([m, points])
    t, y = np.cumsum(random.uniform(0.1, 1.0, points)), random.normal(size=points)
    ends = [(order, 0.0) for order in range(m, 2 * m - 1)]
    compare(t, spline_pieces(t, y, m), make_interp_spline(t, y, k=2 * m - 1, bc_type=(ends, ends)), 1e-12)


def compare(t: np.ndarray, pieces: np.ndarray, expected: Any, allowed: float) -> None:
    at = np.linspace(t[0], t[-1], 400, endpoint=False)
    place = np.searchsorted(t, at, side="right") - 1
    found = sum(pieces[place, k] * (at - t[place]) ** k for k in range(pieces.shape[1]))
    np.testing.assert_allclose(found, expected(at), rtol=0, atol=allowed * np.max(np.abs(found)))


@pytest.mark.parametrize("rho", [1, 2, 3, 4, 5])
def test_derivatives_up_to_rho_are_continuous(rho: int) -> None:
    m = half_degree(rho)
    random = np.random.default_rng(rho)
    t, y = np.cumsum(random.uniform(0.5, 1.0, 20)), random.normal(size=20)
    pieces, h = spline_pieces(t, y, m), np.diff(t)
    for order in range(rho + 1):
        ends = [np.polynomial.Polynomial(row).deriv(order)(step) for row, step in zip(pieces, h, strict=True)]
        starts = [np.polynomial.Polynomial(row).deriv(order)(0.0) for row in pieces]
        scale = max(1.0, float(np.max(np.abs(starts))))
        np.testing.assert_allclose(ends[:-1], starts[1:], rtol=0, atol=1e-8 * scale)
    jumps = pieces[1:, -1] - pieces[:-1, -1]
    assert np.max(np.abs(jumps[m:-m])) > 1e-3, "else it would be one polynomial"
