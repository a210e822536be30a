"""The zero-order-hold update against the continuous rates it discretises."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive import Derivation
from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.hold import Hold


def test_first_order_in_period_is_the_continuous_rate(derivation: Derivation) -> None:
    """With F = I + A T and G = I T, (s_next - s) / T is the rate of (14), (23) for held y, u and v."""
    s, T, hold = derivation.signals, sp.Symbol("T", positive=True), Hold.of(derivation.signals)
    euler: dict[sp.Expr, sp.Expr] = {}
    for F, G, A in ((hold.F0, hold.G0, filter_matrix(s)), (hold.Fr, hold.Gr, compensator_matrix(s))):
        size = A.shape[0]
        euler |= dict(zip(F, sp.eye(size) + A * T, strict=True)) | dict(zip(G, sp.eye(size) * T, strict=True))
    for state in s.controller_state:
        following = derivation.equations[f"{state.name}_next"].expression.xreplace(euler)
        rate = derivation.equations[f"{state.name}_dot"].expression
        assert sp.expand((following - state) / T - rate) == 0
