"""Zero-order-hold matrices of filters and compensator, for the ``sampled_update`` kernel."""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator


def hold_matrices(evaluator: Evaluator, p: Array, sample_time: float) -> Array:
    """``expm(A0 T)`` and its integral over the hold, then the same of the compensator's matrix, row by row.

    Args:
        evaluator: for the kernels ``filter_matrix`` (14) and ``compensator_matrix`` (23).
        p: parameters.
        sample_time: T, s.

    Returns:
        Shape (2 n^2 + 2 rho^2,).
    """
    blocks = []
    for name in ("filter_matrix", "compensator_matrix"):
        (flat,) = evaluator.call(name, p)
        size = round(len(flat) ** 0.5)
        blocks += [matrix.ravel() for matrix in _exponential(flat.reshape(size, size), sample_time)]
    return np.concatenate(blocks)


def _exponential(A: Array, sample_time: float) -> tuple[Array, Array]:
    """``expm(A T)`` and ``int_0^T expm(A s) ds``, as blocks of one exponential (van Loan)."""
    from scipy.linalg import expm

    size = len(A)
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size] = A
    block[:size, size:] = np.eye(size)
    whole = np.asarray(expm(block * sample_time), dtype=np.float64)
    return whole[:size, :size], whole[:size, size:]
