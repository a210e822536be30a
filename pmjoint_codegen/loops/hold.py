"""Zero-order-hold matrices of filters and compensator, for the ``sampled_update`` kernel.

Many small matrices at once, in sums and products of whole arrays. No linear algebra library is called: its
threads would compete with each other, and its rounding differs from processor to processor.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.evaluator import Array, Evaluator

RADIUS: Final = 0.5  # of the matrix whose exponential is summed
DEGREE: Final = 14  # of that sum: 0.5^15 / 16! is 1.5e-18
BALANCING: Final = 4  # rounds

Exponents = npt.NDArray[np.int_]


def hold_matrices(evaluator: Evaluator, p: Array, sample_time: float) -> Array:
    """``expm(A0 T)`` and its integral over the hold, then the same for the compensator's matrix, row by row.

    Args:
        evaluator: for the kernels ``filter_matrix`` (14) and ``compensator_matrix`` (23).
        p: parameters.
        sample_time: T, s.

    Returns:
        Shape (2 n^2 + 2 rho^2,).
    """
    first, second = (evaluator.call(name, p)[0] for name in ("filter_matrix", "compensator_matrix"))
    if len(first) == len(second):
        return exponentials(np.stack([first, second]), sample_time).reshape(-1)
    return np.concatenate([exponentials(flat[np.newaxis], sample_time)[0] for flat in (first, second)])


def exponentials(flat: Array, sample_time: float) -> Array:
    """``E = expm(A T)`` and ``F = int_0^T expm(A s) ds`` of many matrices, each on its own.

    Taylor's series of F over ``h = T / 2^s``, then ``E(2h) = E(h)^2`` and ``F(2h) = F(h) + E(h) F(h)``.
    Rounding in sums and products commutes with diagonal scaling, so `_halvings` may use the balanced A.

    Args:
        flat: the matrices A, row by row, shape (count, size^2).
        sample_time: T, s.

    Returns:
        E and F of each, row by row, shape (count, 2 size^2).
    """
    count, size = len(flat), round(flat.shape[1] ** 0.5)
    A = np.ascontiguousarray(flat.T).reshape(size, size, count)
    identity = np.eye(size)[:, :, np.newaxis]
    with np.errstate(all="ignore"):  # gains near the largest float overflow here, and the run then reports it
        s = _halvings(A, sample_time)
        h = np.ldexp(sample_time, -s)
        step, total = A * h, identity / (DEGREE + 1)
        for k in range(DEGREE, 0, -1):
            total = (identity + _product(step, total)) / k
        E, F = identity + _product(step, total), total * h
        for done in range(int(s.max(initial=0))):
            more = done < s
            F = np.where(more, F + _product(E, F), F)
            E = np.where(more, _product(E, E), E)
    return np.ascontiguousarray(np.concatenate([E, F]).reshape(-1, count).T)


def _product(one: Array, other: Array) -> Array:
    """Products of matrices, shape (size, size, count), terms added from left to right."""
    total = one[:, 0, np.newaxis] * other[0]
    for j in range(1, len(one)):
        total = total + one[:, j, np.newaxis] * other[j]
    return np.asarray(total)


def _halvings(A: Array, sample_time: float) -> Exponents:
    """The least s >= 0 for which the balanced norm of ``A T / 2^s`` is below `RADIUS`, shape (count,)."""
    norm = np.max(_sums(_balanced(np.abs(A))), axis=0) * sample_time
    _, exponent = np.frexp(np.where(norm < np.inf, norm, 0.0) / RADIUS)
    return np.maximum(exponent, 0)


def _balanced(M: Array) -> Array:
    """Balance rows and columns of non-negative matrices by powers of two (Osborne 1960)."""
    for i in [*range(len(M))] * (BALANCING if len(M) > 1 else 0):
        row, column = _sums(M)[i] - M[i, i], _sums(M.swapaxes(0, 1))[i] - M[i, i]
        both = (row > 0) & (column > 0)
        _, exponent = np.frexp(np.where(both, row, 1.0) / np.where(both, column, 1.0))
        factor = np.ldexp(1.0, exponent // 2)
        M[i] /= factor
        M[:, i] *= factor
    return M


def _sums(M: Array) -> Array:
    """Of every row, shape (size, count)."""
    total = M[:, 0]
    for j in range(1, len(M)):
        total = total + M[:, j]
    return total
