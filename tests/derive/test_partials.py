"""Partial derivatives by the chain rule: those of the whole expression, each by a name, and short."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Model, derive
from pmjoint_derive.signals import partial_name

from .conftest import S, build


def value(expression: sp.Expr, seed: int) -> sp.Float:
    """Evaluate at a drawn point, to 50 digits; a symbol's value follows from its name and the seed."""
    point = {
        symbol: sp.Rational(random.Random(f"{seed}{symbol.name}").randint(200, 1800), 1000)
        for symbol in expression.free_symbols
    }
    return sp.N(expression.xreplace(point), 50)


def names(derivation: Derivation, i: int) -> dict[sp.Symbol, str]:
    """The name that each partial derivative of alpha_i would have, by signal."""
    s = derivation.signals
    return {by: partial_name(s.alpha[i - 1], by) for by in s.measurable}


def test_every_partial_is_that_of_the_whole_expression(derivation: Derivation) -> None:
    """What has no equation is 0; what has one is the derivative of the expanded virtual control."""
    for i in range(1, derivation.plant.rho):
        whole = derivation.expanded(f"alpha{i}")
        for by, name in names(derivation, i).items():
            wanted = sp.diff(whole, by)
            found = derivation.expanded(name) if name in derivation.equations else sp.Integer(0)
            for seed in range(2):
                a, b = value(wanted, seed), value(found, seed)
                assert abs(a - b) <= sp.Float("1e-40", 50) * (1 + abs(a)), name


def test_names_of_higher_derivatives_are_those_of_their_signals(derivation: Derivation) -> None:
    """An equation ``d2alpha1_dy_dy`` is the second derivative, whatever way it was found."""
    s = derivation.signals
    higher = [
        name
        for name in derivation.equations
        if name.startswith(("d2alpha", "d3alpha")) and not name.endswith("_start")
    ]
    if derivation.plant.rho > 2:
        assert "d2alpha1_dy_dy" in higher
    for name in higher:
        of, *by = name[2:].split("_d", 1)[0], *name.split("_d")[1:]
        signals = [S(signal) for signal in by if S(signal) in s.measurable]
        if len(signals) != len(by):  # a signal with _d in its name; not in these models
            pytest.fail(f"{name} cannot be read")
        wanted = sp.diff(derivation.expanded(of), *signals)
        a, b = value(wanted, 0), value(derivation.expanded(name), 0)
        assert abs(a - b) <= sp.Float("1e-40", 50) * (1 + abs(a)), name


@pytest.mark.parametrize("order, most", [(3, 130), (4, 560)])
def test_partials_do_not_repeat_the_law(order: int, most: int) -> None:
    """Measured: 122 and 531 operations; written in signals alone they took 1082 and 33429."""
    derivation = derive(build(order, order))
    partials = [
        item.expression
        for item in derivation.equations.values()
        if item.section == "Backstepping" and item.name.startswith("d")
    ]
    assert len(partials) > 5 * order
    assert sum(sp.count_ops(expression) for expression in partials) < most


def test_a_vanishing_partial_has_no_equation() -> None:
    """alpha_2 of a linear model does not depend on Xi11 where Phi is 0."""
    model: Model = build(3, 3, nonlinear=False)
    derivation = derive(model)
    known = [item for item in derivation.equations.values() if item.name.startswith("dalpha")]
    assert known and all(sp.expand(derivation.expanded(item.name)) != 0 for item in known)
