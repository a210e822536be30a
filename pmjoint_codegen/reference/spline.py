"""The interpolating spline of degree 2m - 1: 2m - 2 continuous derivatives.

Each piece is the Hermite polynomial of the values and the first m - 1 derivatives at its ends. Derivatives m
to 2m - 2 agree at the points in between. The first m pieces are one polynomial, and so are the last m: the
spline is accurate up to its ends ("not-a-knot"). With fewer than 2m points, derivatives m to 2m - 2 vanish at
both ends instead (the natural spline). See de Boor, A Practical Guide to Splines (1978).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int_]


def half_degree(continuous: int) -> int:
    """The least m >= 2 for which the spline has that many continuous derivatives."""
    return max(2, (continuous + 1) // 2 + 1)


def spline_pieces(t: Array, y: Array, m: int) -> Array:
    """Coefficients of every piece in powers of the time since its start.

    Args:
        t: ascending, shape (points,), at least m of them.
        y: values there.
        m: half of the degree plus one.

    Returns:
        Shape (points - 1, 2m), constant term first.
    """
    from scipy.linalg import solve_banded

    points, size = len(t), m - 1  # unknowns at a point: derivatives 1 to m - 1, in units of the mean spacing
    h = np.diff(t)
    unit = (t[-1] - t[0]) / len(h)
    r = h / unit
    order = np.arange(m)
    binomial = np.array([[math.comb(j, k) for j in range(2 * m)] for k in range(2 * m)], dtype=np.float64)
    upper = np.linalg.inv(binomial[:m, m:])
    # Coefficients m .. 2m - 1 in powers of s in [0, 1], from scaled derivatives at both ends.
    high = np.concatenate([-upper @ binomial[:m, :m], upper], axis=1)
    # Derivatives m .. 2m - 2 over q!, at the left and the right end, from the same; the last one is constant.
    left, right, top = high[:-1], binomial[m : 2 * m - 1, m:] @ high, high[-1:]
    band = (m + 1) * size  # how far the conditions of a point reach
    matrix = np.zeros((2 * band + 1, points * size))
    wanted = np.zeros(points * size)

    def add(terms: Array, q: int, row: Places, sign: float, pieces: Places) -> None:
        """Add a derivative of some pieces, of order q, to conditions."""
        weight = sign / r[pieces] ** q
        for k in range(2 * m):
            factor = weight * terms[k] * r[pieces] ** (k % m)
            at = pieces + (k >= m)
            if k % m == 0:
                np.subtract.at(wanted, row, factor * y[at])
            else:
                column = at * size + (k % m - 1)
                np.add.at(matrix, (band + row - column, column), factor)

    natural = points < 2 * m
    every = np.arange(points - 1)
    for i in range(size):
        starts, ends = (every, every) if natural else (every[1:], every[:-1])
        add(left[i], m + i, starts * size + i, 1.0, starts)
        add(right[i], m + i, (ends + 1) * size + i, -1.0, ends)
        if not natural:
            for row, piece in ((i, i), ((points - 1) * size + i, points - 2 - m + 1 + i)):
                add(top[0], 2 * m - 1, np.array([row]), 1.0, np.array([piece]))
                add(top[0], 2 * m - 1, np.array([row]), -1.0, np.array([piece + 1]))
    slopes = solve_banded((band, band), matrix, wanted).reshape(points, size)
    known = np.concatenate([y[:, np.newaxis], slopes], axis=1)
    low = known[:-1] * r[:, np.newaxis] ** order
    both = np.concatenate([low, known[1:] * r[:, np.newaxis] ** order], axis=1)
    pieces = np.concatenate([low, both @ high.T], axis=1)
    return np.asarray(pieces / h[:, np.newaxis] ** np.arange(2 * m))
