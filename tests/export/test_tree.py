"""Trees print C that C's grammar reads as the tree, and evaluate to SymPy's value."""

from __future__ import annotations

import struct

import pytest
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.export.exact import context, exact_operations
from pmjoint_codegen.export.tree import DOUBLE, FLOAT, c_text, evaluated, tree_of
from pmjoint_derive import real_symbol

a, b, c = (real_symbol(name) for name in "abc")
SPELLING = {a: "a", b: "b", c: "c"}
CASES = [
    (a - (b - c), "a + c - b"),
    (a * (b + c), "a * (b + c)"),
    (a / (b * c), "a / (b * c)"),
    (-a * b, "-a * b"),
    (-(a + b) / c, "(-a - b) / c"),
    (a**3, "a * a * a"),
    (1 / sp.sqrt(a), "1.0 / sqrt(a)"),
    (a ** sp.Rational(1, 4), "sqrt(sqrt(a))"),
    (3 * a / 10, "3.0 * a / 10.0"),
    (sp.Min(a, b), "fmin(a, b)"),
    (sp.sign(a) * sp.Abs(b), "fabs(b) * sign_of(a)"),
    (sp.exp(-a), "exp(-a)"),
]


@pytest.mark.parametrize(("expression", "text"), CASES)
def test_an_expression_prints_as_c(expression: sp.Expr, text: str) -> None:
    assert c_text(tree_of(expression), SPELLING, DOUBLE) == text


@pytest.mark.parametrize(("expression", "_"), CASES)
def test_a_tree_has_the_value_of_its_expression(expression: sp.Expr, _: str) -> None:
    mp = context()
    values = {a: mp.mpf("0.7"), b: mp.mpf("-1.3"), c: mp.mpf("2.1")}
    found = evaluated(tree_of(expression), values, exact_operations(mp))
    exact = expression.subs({a: sp.Rational(7, 10), b: sp.Rational(-13, 10), c: sp.Rational(21, 10)})
    assert abs(found - mp.mpf(str(sp.N(exact, 60)))) < mp.mpf(10) ** -45


def test_two_signs_in_a_row_are_no_decrement() -> None:
    text = c_text(tree_of(sp.Mul(-1, sp.Add(-a, -b, evaluate=False), evaluate=False)), SPELLING, DOUBLE)
    assert "--" not in text


@pytest.mark.parametrize("value", [0.1, 1e-300, 1e22, 123456789.0, 5e-324, 1 / 3])
def test_literals_round_trip(value: float) -> None:
    assert float(DOUBLE.literal(value)) == value
    text = FLOAT.literal(value)
    assert text.endswith("f")
    single = struct.unpack("f", struct.pack("f", value))[0]
    assert struct.unpack("f", struct.pack("f", float(text[:-1])))[0] == single


def test_a_function_without_a_spelling_is_refused() -> None:
    with pytest.raises(ModelError, match="besselj"):
        tree_of(sp.besselj(0, a))
