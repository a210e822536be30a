"""The reference arithmetic: numbers against mpmath, series against derivatives that SymPy takes."""

from __future__ import annotations

import mpmath
import pytest
import sympy as sp

from pmjoint_codegen.check.oracles.precise import DIGITS, Numbers, PowerSeries
from pmjoint_codegen.check.oracles.program import compile_program
from pmjoint_derive import Equation, Equations, real_symbol

x, a = real_symbol("x"), real_symbol("a")
NAMELESS = Equations([])
EXPRESSIONS = [
    sp.sin(x), sp.cos(2 * x), sp.tan(x / 3), sp.tanh(x), sp.exp(-x), sp.log(2 + x), sp.sqrt(1 + x),
    (1 + x) ** -3,
    sp.atan(2 * x - 1), sp.sinh(x / 2), sp.cosh(1 - x),
    sp.Abs(x - 2) * sp.sin(x), sp.sign(x - 2) * x,
    (1 + x**2) ** sp.Rational(5, 3), x**4 / (1 + x), sp.pi * x, a**x, sp.exp(sp.sin(x) ** 2) / (x - 5),
]  # fmt: skip


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_numbers_agree_with_sympys_own_evaluation(expression: sp.Expr) -> None:
    numbers = Numbers()
    program = compile_program([expression], [x, a], NAMELESS)
    (found,) = program.run(numbers, {x: numbers.exactly(0.75), a: numbers.exactly(1.5)})
    wanted = expression.subs({x: sp.Rational(3, 4), a: sp.Rational(3, 2)}).evalf(DIGITS + 5)
    assert abs(found - numbers.context.mpf(str(wanted))) <= abs(found) * mpmath.mpf(10) ** (3 - DIGITS)


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_series_hold_the_derivatives(expression: sp.Expr) -> None:
    order, numbers = 6, Numbers()
    program = compile_program([expression], [x, a], NAMELESS)
    at = {x: [numbers.exactly(0.75), numbers.context.one], a: [numbers.exactly(1.5)]}
    (found,) = program.run(PowerSeries(numbers, order), at)
    for k in range(order + 1):
        derivative = sp.diff(expression, x, k).subs({x: sp.Rational(3, 4), a: sp.Rational(3, 2)})
        wanted = numbers.context.mpf(str((derivative / sp.factorial(k)).evalf(DIGITS + 5)))
        coefficient = found[k] if k < len(found) else 0
        assert abs(coefficient - wanted) <= max(abs(wanted), 1) * mpmath.mpf(10) ** (8 - DIGITS)


def test_names_are_followed_and_shared() -> None:
    b, c = real_symbol("b"), real_symbol("c")
    equations = Equations([Equation(b, x + 1, "", "", "", None), Equation(c, b * b, "", "", "", None)])
    program = compile_program([c, b, sp.Max(x, 2), sp.Min(x, 2)], [x], equations)
    numbers = Numbers()
    assert [int(value) for value in program.run(numbers, {x: numbers.exactly(4.0)})] == [25, 5, 4, 2]
    assert sum(step.kind == "input" for step in program.operations) == 1
    with pytest.raises(KeyError):
        compile_program([a], [x], equations)


def test_given_definitions_go_first() -> None:
    b = real_symbol("b")
    equations = Equations([Equation(b, x + 1, "", "", "", None)])
    (found,) = compile_program([b], [x], equations, {b: 2 * x}).run(Numbers(), {x: Numbers().exactly(3.0)})
    assert found == 6


@pytest.mark.parametrize("function", ["sin", "cos", "tan"])
def test_an_angle_beyond_all_doubles_is_none(function: str) -> None:
    """Its reduction would take pi to a thousand million digits; such an angle is infinite in a kernel."""
    numbers = Numbers()
    large = numbers.context.mpf(10) ** (10**9)
    assert numbers.context.isnan(numbers.apply(function, large))
    series = PowerSeries(numbers, 2).apply(function, [large, numbers.context.one])
    assert all(numbers.context.isnan(entry) for entry in series)
    assert numbers.context.isfinite(numbers.apply(function, numbers.context.mpf(10) ** 300))
