"""Values of expressions at a point: right, or refused, and always soon."""

from __future__ import annotations

import math

import pytest
import sympy as sp

from pmjoint_codegen.modelfile.points import NotFiniteError, value_at

y, a = sp.symbols("y a", real=True)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (sp.sin(y) * sp.exp(a) + sp.Rational(1, 3), math.sin(0.5) * math.exp(2) + 1 / 3),
        (sp.sqrt(y) / a + sp.pi, math.sqrt(0.5) / 2 + math.pi),
        (sp.log(a) * sp.cos(y) - sp.tan(y) ** 3, math.log(2) * math.cos(0.5) - math.tan(0.5) ** 3),
        (sp.tanh(y * sp.E), math.tanh(0.5 * math.e)),
    ],
)
def test_agrees_with_the_math_module(expression: sp.Expr, value: float) -> None:
    assert value_at(expression, {y: 0.5, a: 2.0}) == pytest.approx(value, rel=4e-16)


def test_cancellation_is_zero_and_smallness_is_not() -> None:
    assert value_at(sp.sin(y) ** 2 + sp.cos(y) ** 2 - 1, {y: 0.3}) == 0
    assert value_at(sp.sqrt(a) ** 2 * sp.sqrt(3) * sp.sqrt(a) / sp.sqrt(3 * a) - a, {a: 2.0}) == 0
    assert value_at(y * sp.Rational(1, 10**200), {y: 1e-100}) == pytest.approx(1e-300)
    assert value_at((1 + y) - 1 - y / 2, {y: 1e-30}) == pytest.approx(5e-31)


@pytest.mark.parametrize(
    ("expression", "point"),
    [
        (1 / y, {y: 0.0}),
        (sp.log(y), {y: -1.0}),
        (sp.log(y), {y: 0.0}),
        (sp.sqrt(y), {y: -1.0}),
        (y**a, {y: 0.2, a: -1e9}),
        (y**a, {y: 1e300, a: 1e300}),
        (sp.exp(sp.exp(sp.exp(sp.exp(y)))), {y: 100.0}),
    ],
)
def test_what_a_double_cannot_hold_is_refused_at_once(
    expression: sp.Expr, point: dict[sp.Symbol, float]
) -> None:
    with pytest.raises(NotFiniteError):
        value_at(expression, point)
