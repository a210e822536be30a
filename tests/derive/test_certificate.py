"""The printed certificate: V_dot is the rate of V, and V_dot_max bounds it."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import sympy as sp

from pmjoint_derive import Derivation, Gains, Model, Parameter, derive, real_symbol
from pmjoint_derive.certificate import certificate_equations
from pmjoint_derive.equation import Equations
from pmjoint_derive.filters import filter_matrix

S = real_symbol


def drawn(symbols: set[sp.Symbol], seed: int) -> dict[sp.Symbol, sp.Rational]:
    """Positive rational values."""
    draw = random.Random(seed)
    return {symbol: sp.Rational(draw.randint(1, 99), 10) for symbol in sorted(symbols, key=str)}


def differentiated(derivation: Derivation, V: sp.Expr) -> sp.Expr:
    """V' by the chain rule: z' of the derivation, epsilon' = A0 epsilon + D."""
    s = derivation.signals
    D = sp.Matrix([S(f"D{i + 1}") if rate != 0 else 0 for i, rate in enumerate(derivation.plant.disturbance)])
    rates = dict(zip(s.epsilon, filter_matrix(s) * sp.Matrix(s.epsilon) + D, strict=True))
    rates |= {z: derivation.equations[f"{z}_dot"].expression for z in s.z}
    return sum((sp.diff(V, symbol) * rate for symbol, rate in rates.items()), sp.Integer(0))


def test_the_printed_rate_is_that_of_the_printed_function(derivation: Derivation) -> None:
    """At random rational points, exactly."""
    printed = Equations(certificate_equations(derivation))
    V, rate = (printed.expand(S(name)) for name in ("V", "V_dot"))
    difference = differentiated(derivation, V) - rate
    assert difference.free_symbols
    for seed in range(3):
        assert difference.xreplace(drawn(difference.free_symbols, seed)) == 0


def test_the_printed_bound_holds_for_every_disturbance_within_its_own(paper: Derivation) -> None:
    """What V_dot leaves to V_dot_max is not negative, and what is given away is squares."""
    printed, s, gains = Equations(certificate_equations(paper)), paper.signals, paper.model.gains
    values = {
        symbol: sp.Rational(repr(value))
        for symbols, row in ((s.c, gains.c), (s.e, gains.e), (s.k, gains.k))
        for symbol, value in zip(symbols, row, strict=True)
    }
    for sign in (1, -1):
        for seed in range(5):
            point = values | {S("D2"): sign * printed["D_max"].expression}
            gap = printed.expand(S("V_dot_max") - S("V_dot")).xreplace(point)
            assert gap.xreplace(drawn(gap.free_symbols, seed)) >= 0
            assert printed.expand(S("V_lost")).xreplace(point | drawn(gap.free_symbols, seed)) >= 0


def test_the_papers_printed_constants(paper: Derivation) -> None:
    printed = Equations(certificate_equations(paper))
    gains = paper.model.gains
    values = {S(f"{stem}{i}"): row[i - 1] for stem, row in (("c", gains.c), ("e", gains.e)) for i in (1, 2)}
    found = {name: float(printed.expand(S(name)).subs(values)) for name in ("lambda_P", "f_minus", "f", "Y")}
    rounded = {name: round(value, 4) for name, value in found.items()}
    assert rounded == {"lambda_P": 2.2575, "f_minus": 2.5, "f": 0.2215, "Y": 0.5097}  # (33)-(35) by hand
    numbers = {"V_epsilon": "(19)", "V": "(30)", "V_dot": "(32)", "Y": "(33)", "f_minus": "(34)", "f": "(35)"}
    assert {name: printed[name].number for name in numbers} == numbers


def test_without_a_bound_of_the_disturbance_nothing_is_printed_of_it(paper: Derivation) -> None:
    names = {
        item.name for item in certificate_equations(derive(replace(paper.model, disturbance_bound=None)))
    }
    assert {"V", "V_dot", "f"} <= names
    assert not {"D_max", "Y", "V_dot_max"} & names


def test_of_a_high_order_p_is_printed_in_numbers(builder: Callable[..., Model]) -> None:
    model = builder(4, 4)
    zero, y = sp.Integer(0), S("y")
    plant = replace(
        model.plant,
        order=5,
        phi=(zero,) * 5,
        Phi=((zero, zero),) * 4 + ((y, zero),),
        disturbance=(zero,) * 4 + (sp.cos(S("t")),),
    )
    gains = Gains((1.0,) * 4, (1.0,) * 4, (1.0,) * 4, (10.0, 40.0, 80.0, 80.0, 32.0))
    plant = replace(plant, b=(S("b0"), sp.Integer(1)))
    printed = Equations(certificate_equations(derive(replace(model, plant=plant, gains=gains))))
    assert printed["P_55"].expression.is_Rational
    assert printed["P_12"].expression == -1


def test_a_parameter_keeps_its_name(paper: Derivation) -> None:
    """The model file came first: f of (35) gives way to the frequency f."""
    model = paper.model
    plant = replace(model.plant, disturbance=(sp.Integer(0), sp.sin(S("f") * S("t")) / 10))
    named = replace(model, plant=plant, parameters=(*model.parameters, Parameter("f", 3.0, "1/s", "")))
    printed = Equations(certificate_equations(derive(named)))
    assert "f" not in printed
    assert printed["V_dot_max"].expression == S("Y") - S("f_of_V") * S("V")
