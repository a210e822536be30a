"""Where a long formula is broken into rows, and how wide rows are."""

from __future__ import annotations

import pytest
import sympy as sp

from pmjoint_codegen.report.notation import latex_expression
from pmjoint_codegen.report.rows import ROOM, equation_rows, too_wide
from pmjoint_codegen.report.width import width
from pmjoint_derive import real_symbol
from pmjoint_derive.equation import Equation

a, b, x, y = map(real_symbol, ("a", "b", "x", "y"))
MANY = tuple(real_symbol(f"w{i:02d}") for i in range(40))
LONG = sum(MANY, sp.Integer(0))  # 40 symbols with two digits: far more than a row


def rows_of(expression: sp.Expr) -> list[str]:
    """Return the rows of an equation for v."""
    equation = Equation(real_symbol("v"), expression, "Backstepping", "(29)", "law", None)
    rows = equation_rows(equation)
    assert not too_wide(equation, rows)
    return rows


@pytest.mark.parametrize(
    ("latex", "points"),  # measured: \the\wd of a box in a document of 11 pt
    [
        (r"x_{2,\mathrm{plant}}", 32.5),
        (r"\frac{\partial \alpha_1}{\partial \hat{b}_0}", 20.6),
        (r"v = \max\left(- u_{\max}, \min\left(u_{\max}, v\right)\right)", 148.7),
        (r"\left(\frac{\partial \alpha_1}{\partial y}\right)^{2} e_2 \kappa_u^{2} z_2", 74.7),
        (r"a + b - \frac{c_1 + e_1}{b_0} + k_1 \left(y - \xi_1\right)", 135.2),
    ],
)
def test_the_estimated_width_is_that_of_latex(latex: str, points: float) -> None:
    assert width(latex) == pytest.approx(points / 10.95, rel=0.12)  # ROOM leaves more


def test_a_script_above_another_takes_no_room_of_its_own() -> None:
    assert width("x_2^2") == width("x_2") < width("x_{22}")


def test_what_fits_stays_on_one_row() -> None:
    assert rows_of(a * (x + y) / b) == [rf"v = {latex_expression(a * (x + y) / b)}"]


@pytest.mark.parametrize(
    ("expression", "pieces"),
    [
        (LONG, ("v ={}& w_{00}", "+ w_{39}")),
        (LONG * a / b, (r"\frac{a}{b} \Bigl[ w_{00}", r"w_{39} \Bigr]")),
        (LONG * (a + b), (r"\left(a + b\right) \Bigl[ w_{00}", r"w_{39} \Bigr]")),
        (a / LONG, (r"a \Big/ \Bigl( w_{00}", r"w_{39} \Bigr)")),
        (a / LONG**2, (r"a \Big/ \Bigl( w_{00}", r"w_{39} \Bigr)^{2}")),
        (1 / LONG, (r"1 \Big/ \Bigl( w_{00}", r"w_{39} \Bigr)")),
        (LONG**3, (r"\Bigl( w_{00}", r"w_{39} \Bigr)^{3}")),
        (a * sp.tanh(LONG), (r"a \tanh \Bigl( w_{00}", r"w_{39} \Bigr)")),
        (sp.Max(*MANY), (r"\max \Bigl( w_{00}, w_{01},", r"w_{39} \Bigr)")),
        (a + sp.Min(b, LONG), (r"a + \min \Bigl( b, w_{00}", r"w_{39} \Bigr)")),
        (
            LONG / sp.Add(*MANY[:30], a),
            (r"\Bigl( w_{00}", r"\Bigr) \Big/ \Bigl( a + w_{00}", r"w_{29} \Bigr)"),
        ),
    ],
    ids=("sum", "product", "two", "quotient", "square", "one", "cube", "call", "extremum", "term", "both"),
)
def test_each_kind_is_broken_inside(expression: sp.Expr, pieces: tuple[str, ...]) -> None:
    text = " ".join(row.removeprefix(r"\\ & ") for row in rows_of(expression))
    places = [text.find(piece) for piece in pieces]
    assert -1 not in places and places == sorted(places)
    assert text.count(r"\Bigl") == text.count(r"\Bigr")


def test_what_cannot_be_broken_is_said_to_be_too_wide() -> None:
    product = sp.prod(MANY, start=sp.Integer(1))
    equation = Equation(real_symbol("v"), product, "Backstepping", "", "law", None)
    rows = equation_rows(equation)
    assert len(rows) == 1 and width(rows[0]) > ROOM
    assert too_wide(equation, rows)
