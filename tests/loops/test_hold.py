"""Matrices of the zero-order hold: against 60 digits, against SciPy, and by what they must obey."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.hold import DEGREE, exponentials

ROUNDING = 2.0**-53


def split(flat: Array) -> tuple[Array, Array]:
    size = round((flat.shape[1] / 2) ** 0.5)
    E, F = np.split(flat, 2, axis=1)
    return E.reshape(-1, size, size), F.reshape(-1, size, size)


def filters(size: int, count: int, pole: float) -> Array:
    """A0 of (14) with random poles about -`pole`, shape (count, size, size)."""
    draw = np.random.default_rng(size)
    A = np.zeros((count, size, size))
    A[:, :-1, 1:] = np.eye(size - 1)
    A[:, :, 0] = [-np.poly(-pole * draw.uniform(0.7, 1.3, size))[1:] for _ in range(count)]
    return A


def compensators(size: int, count: int, pole: float) -> Array:
    """Ar of (23), shape (count, size, size)."""
    draw = np.random.default_rng(size)
    A = np.zeros((count, size, size))
    A[:, range(size - 1), range(1, size)] = 1.0
    A[:, range(size), range(size)] = -pole * draw.uniform(0.7, 1.3, (count, size))
    return A


def exactly(A: Array, T: float) -> tuple[Array, Array]:
    """E and F at 60 digits, rounded once."""
    size = len(A)
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size], block[:size, size:] = A, np.eye(size)
    with mpmath.workdps(60):
        whole = mpmath.expm(mpmath.matrix(block.tolist()) * mpmath.mpf(T), method="taylor")
        found = np.array([[float(entry) for entry in row] for row in whole.tolist()])
    return found[:size, :size], found[:size, size:]


@pytest.mark.parametrize("make", [filters, compensators])
@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize(("pole", "T"), [(4.0, 1e-4), (5.0, 1e-3), (70.0, 1e-3), (70.0, 0.02), (200.0, 0.01)])
def test_every_entry_is_as_exact_as_its_rounding_allows(
    make: object, size: int, pole: float, T: float
) -> None:
    A = make(size, 3, pole)  # type: ignore[operator]
    for one, E, F in zip(A, *split(exponentials(A.reshape(3, -1), T)), strict=True):
        largest = exactly(np.abs(one), T)  # what no sum or product on the way exceeds, entry by entry
        halvings = max(0.0, np.ceil(np.log2(size * pole * 1.3 * T / 0.25)))
        # A product of matrices rounds `size` times; every squaring doubles what was there before.
        bound = 2**halvings * (size + 2) * (DEGREE + 2) * ROUNDING
        for found, exact, scale in zip((E, F), exactly(one, T), largest, strict=True):
            assert np.all(np.abs(found - exact) <= bound * scale)


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize(("pole", "T"), [(4.0, 1e-4), (5.0, 1e-3), (70.0, 1e-3), (70.0, 0.02)])
def test_scipy_agrees(size: int, pole: float, T: float) -> None:
    A = filters(size, 20, pole)
    E, F = split(exponentials(A.reshape(20, -1), T))
    block = np.zeros((20, 2 * size, 2 * size))
    block[:, :size, :size], block[:, :size, size:] = A, np.eye(size)
    whole = expm(block * T)
    for found, theirs in ((E, whole[:, :size, :size]), (F, whole[:, :size, size:])):
        scale = np.max(np.abs(theirs), axis=(1, 2), keepdims=True)
        assert np.max(np.abs(found - theirs) / scale) <= 1e-14


def test_a_matrix_s_bits_do_not_depend_on_its_neighbours() -> None:
    A = np.concatenate([filters(2, 40, 5.0), filters(2, 40, 900.0), np.zeros((1, 2, 2))]).reshape(81, -1)
    together = exponentials(A, 0.01)
    np.testing.assert_array_equal(
        together, np.concatenate([exponentials(row[np.newaxis], 0.01) for row in A])
    )
    np.testing.assert_array_equal(together[::-1], exponentials(A[::-1], 0.01))
    np.testing.assert_array_equal(together[-1].reshape(2, 2, 2), [np.eye(2), 0.01 * np.eye(2)])


def test_gains_beyond_floating_point_give_no_number_and_no_warning() -> None:
    flat = np.array([[-1e308, 1.0, -1e308, 0.0], [-6.0, 1.0, -8.0, 0.0]])
    found = exponentials(flat, 1.0)
    assert not np.all(np.isfinite(found[0]))
    np.testing.assert_array_equal(found[1:], exponentials(flat[1:], 1.0))
