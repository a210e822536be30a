"""Printed text as mathematics: what it means and how it looks."""

from __future__ import annotations

import pytest
import sympy as sp

from pmjoint_codegen.audit.notation import chain, latex, names, value

a, b = sp.symbols("a b", real=True)
column = sp.Matrix([a, b])


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("-b_v/J*dot(theta)", r"-\frac{b_{v}}{J} \dot{\theta}"),
        ("b - a", "b - a"),  # the printed order, which SymPy would change
        ("a - (b + a)", r"a - \left(b + a\right)"),
        ("2*(a + b)*l_0**-1", r"2 \left(a + b\right) l_{0}^{-1}"),
        ("dot(hat(x_1))", r"\dot{\hat{x}}_{1}"),
        ("dot(T(Xi_A))", r"\dot{\Xi}_{A}^T"),
        ("partial(alpha_1, y)**2", r"\left(\frac{\partial \alpha_{1}}{\partial y}\right)^{2}"),
        ("norm(P*D)**2", r"\| P D \|^{2}"),
        ("v_0_2", "v_{0,2}"),
        ("lamda_max(P)", r"\lambda_{\max}(P)"),
        ("[[0], [b_0]]*u", r"\begin{bmatrix} 0 \\ b_{0} \end{bmatrix} u"),
    ],
)
def test_it_looks_as_printed(text: str, printed: str) -> None:
    assert latex(text) == (printed,)


def test_a_chain_splits_at_its_relations_only() -> None:
    assert chain("u = cases(a, -a <= v <= a) <= b") == (("u", "cases(a, -a <= v <= a)", "b"), ("=", "<="))
    assert latex("a = b <= 2*b") == ("a", "= b", r"\le 2 b")


def test_names_are_whole_and_in_order() -> None:
    assert names("dot(V_2) <= -f*V_2(0) + norm(P*D)**2") == ("dot(V_2)", "f", "V_2(0)", "P", "D")


def test_values_are_exact() -> None:
    assert value("0.1*a", {"a": a}) == a / 10
    assert value("T(x)*x", {"x": column}) == a**2 + b**2
    assert value("norm(x)**2", {"x": column}) == a**2 + b**2
    assert value("cases(a, b > 0, -a, b <= 0)", {"a": a, "b": b}).subs(b, -1) == -a


def test_sizes_must_fit() -> None:
    with pytest.raises(TypeError, match="do not add up"):
        value("a + x", {"a": a, "x": column})
    with pytest.raises(TypeError, match="no column"):
        value("norm(M)", {"M": sp.eye(2)})


def test_unknown_names_and_syntax_are_refused() -> None:
    with pytest.raises(KeyError, match="q"):
        value("a + q", {"a": a})
    with pytest.raises(SyntaxError, match="not an expression"):
        value("lambda: 0", {})
    with pytest.raises(SyntaxError, match="not an expression"):
        latex("lambda: 0")
