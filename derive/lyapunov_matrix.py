"""The matrix P of the certificate: ``P A0 + A0' P = -2 I`` (18)."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.equation import real_symbol
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.signals import Signals


def lyapunov_matrix(signals: Signals) -> sp.ImmutableMatrix:
    """``P`` of ``P A0 + A0' P = -2 I`` (18), n x n, as rational functions of the gains k."""
    n = len(signals.k)
    P = symmetric_matrix(n)
    unknowns = sorted(P.free_symbols, key=str)
    residual = lyapunov_residual(P, signals)
    upper = [residual[i, j] for i in range(n) for j in range(i, n)]
    solution = sp.linsolve(upper, *unknowns)
    values = dict(zip(unknowns, next(iter(solution)), strict=True))
    return sp.ImmutableMatrix(P.xreplace(values).applyfunc(sp.factor))


def lyapunov_residual(P: sp.ImmutableMatrix, signals: Signals) -> sp.ImmutableMatrix:
    """``P A0 + A0' P + 2 I``, n x n: zero for the P of the certificate."""
    A0 = filter_matrix(signals)
    return sp.ImmutableMatrix(P * A0 + A0.T * P + 2 * sp.eye(len(signals.k)))


def symmetric_matrix(n: int) -> sp.ImmutableMatrix:
    """``P`` as symbols ``P_11``, ``P_12``, ..., n x n."""
    return sp.ImmutableMatrix(n, n, lambda i, j: real_symbol(f"P_{min(i, j) + 1}{max(i, j) + 1}"))
