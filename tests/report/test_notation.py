"""Names, numbers, expressions and remarks in the paper's notation."""

from __future__ import annotations

import pytest
import sympy as sp

from pmjoint_codegen.report.notation import (
    escape,
    latex_expression,
    latex_name,
    latex_number,
    latex_prose,
    plain_text,
    text_expression,
)
from pmjoint_derive import real_symbol


@pytest.mark.parametrize(
    ("value", "latex"),
    [
        (15.0, "15"),
        (0.1, "0.1"),
        (-1e-6, r"-1 \cdot 10^{-6}"),
        (1e6, "10^{6}"),
        (0.1 + 0.2, "0.30000000000000004"),
    ],
)
def test_numbers_keep_their_digits(value: float, latex: str) -> None:
    assert latex_number(value) == latex


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("xi2", r"\xi_2"),
        ("Xi21", r"\Xi_{21}"),
        ("lambda1", r"\lambda_1"),
        ("lambda1_dot", r"\dot{\lambda}_1"),
        ("alpha1", r"\alpha_1"),
        ("dalpha1_dy", r"\frac{\partial \alpha_1}{\partial y}"),
        ("dalpha1_dXi21", r"\frac{\partial \alpha_1}{\partial \Xi_{21}}"),
        ("dalpha2_ddy_r", r"\frac{\partial \alpha_2}{\partial \dot{y}_r}"),
        ("x_hat2", r"\hat{x}_2"),
        ("x2_dot", r"\dot{x}_2"),
        ("x2_dot_plant", r"\dot{x}_{2,\mathrm{plant}}"),
        ("V_dot_max", r"\dot{V}_{\max}"),
        ("lambda_P", r"\lambda_P"),
        ("f_minus", "f_-"),
        ("Fr_11", r"\mathrm{Fr}_{11}"),
        ("d2y_r", r"\ddot{y}_r"),
        ("d3y_r", "y_r^{(3)}"),
        ("du", r"\Delta u"),
        ("ck1", "c_{k1}"),
        ("v0_2", "v_{0,2}"),
        ("d1", "d_1"),
        ("u_max", r"u_{\max}"),
        ("eps0", r"\varepsilon_0"),
        ("k_u", "k_u"),
        ("Omega", r"\Omega"),
        ("Inertia", r"\mathrm{Inertia}"),
    ],
)
def test_names_follow_the_papers_notation(name: str, latex: str) -> None:
    assert latex_name(name) == latex


def test_a_power_does_not_stick_to_a_partial_derivative() -> None:
    squared = real_symbol("dalpha1_dy") ** 2
    assert latex_expression(squared) == r"\left(\frac{\partial \alpha_1}{\partial y}\right)^{2}"
    assert latex_expression(real_symbol("d3y_r") ** 2) == r"\left(y_r^{(3)}\right)^{2}"


def test_eulers_number_is_no_parameter() -> None:
    e, E = real_symbol("e"), real_symbol("E")
    expression = e * E * sp.E + sp.exp(e)
    assert text_expression(expression) == "exp(1)*E*e + exp(e)"
    assert plain_text(expression) == "exp(1)*E*e + exp(e)"
    assert latex_expression(expression) == r"\mathrm{e} E e + \mathrm{e}^{e}"
    assert latex_expression(sp.exp(E) ** 2) == r"\mathrm{e}^{2 E}"


def test_minus_signs_come_after_plus_signs() -> None:
    a, b = real_symbol("a"), real_symbol("b")
    assert text_expression(b - a) == "b - a"


def test_escaped_text_survives_latex() -> None:
    assert escape("50 % of θ & ϑ_1 ≤ 2²") == r"50 \% of $\theta$ \& ?\_1 $\le$ 2²"
    assert latex_prose("rate of x1 by y_r, a unit") == "rate of $x_1$ by $y_r$, a unit"


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("52 N at most", "52 N at most"),
        ("a 0-10 V, 0-5 bar pressure valve", "a 0-10 V, 0-5 bar pressure valve"),
        ("0.05-0.2 s (bench)", "0.05-0.2 s (bench)"),
        ("2 rad/s^2 and 3 N m", "2 rad/s$^{2}$ and 3 N m"),
        ("20 1/s", "20 1/s"),
        ("4 rad/(s^2 V)", "4 rad/(s$^{2}$ V)"),
        ("order 2 m1 and J", "order 2 $m_1$ and $J$"),  # an index makes a symbol
        ("by V, s and N", "by $V$, $s$ and $N$"),  # no number before it
    ],
)
def test_units_in_prose_stand_upright(text: str, latex: str) -> None:
    assert latex_prose(text) == latex
