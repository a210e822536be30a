"""SymPy to CasADi: same value, exact literals, and every missing symbol named at specification time."""

from __future__ import annotations

import math

import casadi as ca
import pytest
import sympy as sp

from pmjoint_codegen.emit.translate import Translator
from pmjoint_codegen.errors import ModelError
from pmjoint_derive import Equation, Equations, real_symbol

S = real_symbol
A, B = S("a"), S("b")


def evaluate(expression: sp.Expr, a: float = 0.7, b: float = 1.3) -> float:
    nodes = {A: ca.SX.sym("a"), B: ca.SX.sym("b")}
    result = Translator("k", nodes, {}, Equations([]))(expression)
    return float(ca.Function("k", list(nodes.values()), [result])(a, b))


@pytest.mark.parametrize(
    "expression",
    [
        A + B - 3,
        A * B / 7,
        -(A**2) * B,
        A / B,
        A**3 - B**-2,
        sp.sqrt(A) + B ** sp.Rational(-3, 2),
        A ** sp.Rational(5, 3),
        sp.exp(A) * sp.log(B),
        A**B,
        sp.sin(A) * sp.cos(B) - sp.tan(A),
        sp.tanh(A * B),
        sp.Max(A, B) + sp.Min(A, B, 1),
        sp.pi * A,
        sp.E**A,
        (A + B) ** 7,
        -A - B,
        sp.Float("0.125") * A,
    ],
    ids=str,
)
def test_values(expression: sp.Expr) -> None:
    expected = float(expression.subs({A: sp.Float(0.7, 40), B: sp.Float(1.3, 40)}).evalf(30))
    assert math.isclose(evaluate(expression), expected, rel_tol=20 * 2**-53)  # at most 20 roundings in each


@pytest.mark.parametrize(("p", "q"), [(1, 10), (1, 3), (10**18 + 1, 3 * 10**17), (-7, 9)])
def test_rational_literals_are_the_nearest_double(p: int, q: int) -> None:
    assert evaluate(sp.Rational(p, q) + 0 * A) == p / q


def test_a_decaying_exponential_is_not_turned_into_a_growing_denominator() -> None:
    """exp(-a^2) underflows to 0 where exp(a^2) would overflow, and the product is then 0, not inf/inf."""
    assert evaluate(A**3 * sp.exp(-(A**2)) / B, a=40.0) == 0.0


def test_a_sum_in_a_product_keeps_its_own_quotients() -> None:
    nodes = {A: ca.SX.sym("a"), B: ca.SX.sym("b")}
    node = Translator("k", nodes, {}, Equations([]))((1 + A / B) * A)
    function = ca.Function("k", list(nodes.values()), [node])
    operations = [function.instruction_id(i) for i in range(function.n_instructions())]
    assert (operations.count(ca.OP_MUL), operations.count(ca.OP_DIV)) == (1, 1)


def test_equal_subexpressions_become_one_node() -> None:
    shared = sp.sin(A + B)
    nodes = {A: ca.SX.sym("a"), B: ca.SX.sym("b")}
    translate = Translator("k", nodes, {}, Equations([]))
    function = ca.Function("k", list(nodes.values()), [translate(shared**2 + sp.exp(shared) * shared)])
    sines = sum(function.instruction_id(i) == ca.OP_SIN for i in range(function.n_instructions()))
    assert sines == 1


def test_names_are_followed_and_given_definitions_go_first() -> None:
    table = Equations([Equation(S("c"), A + 1, "", "", "", None)])
    node = ca.SX.sym("a")
    plain = Translator("k", {A: node}, {}, table)(2 * S("c"))
    given = Translator("k", {A: node}, {S("c"): A - 1}, table)(2 * S("c"))
    assert [float(ca.Function("k", [node], [item])(3)) for item in (plain, given)] == [8, 4]


def test_a_missing_symbol_is_named_with_its_kernel() -> None:
    with pytest.raises(ModelError, match="kernel law: q is neither an input of the kernel nor defined"):
        Translator("law", {}, {}, Equations([]))(S("q"))


def test_an_unknown_function_is_refused() -> None:
    with pytest.raises(ModelError, match="no kernel can evaluate gamma"):
        evaluate(sp.gamma(A))


@pytest.mark.parametrize("number", [sp.Integer(10) ** 5000, sp.Rational(1, 10**320)])
def test_a_number_beyond_floating_point_is_refused(number: sp.Rational) -> None:
    with pytest.raises(ModelError, match="kernel k: a number, or its inverse, overflows"):
        evaluate(number * A)
