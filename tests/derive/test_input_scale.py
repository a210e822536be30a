"""The input scale: the law of the input kappa u, in every order, and the paper's law at 1."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Model, derive, real_symbol
from pmjoint_derive.signals import Signals

S = real_symbol
KAPPA = S("input_scale")


def in_other_unit(derivation: Derivation, point: dict[sp.Symbol, sp.Rational]) -> dict[sp.Symbol, sp.Expr]:
    """The point in a loop whose input is ``kappa u``: b/kappa, kappa lambda; its own scale is 1."""
    kappa = point[KAPPA]
    other = {entry: kappa * point[entry] for entry in derivation.signals.lambda_}
    return {**point, **other, S("b0"): point[S("b0")] / kappa, KAPPA: sp.Integer(1)}


@pytest.mark.parametrize("order", [(1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 4)])
@pytest.mark.parametrize("b0", [-3, 2])
def test_the_law_is_that_of_the_scaled_input(
    builder: Callable[..., Model], order: tuple[int, int], b0: int
) -> None:
    """``kappa v`` is v of the design in the other unit, at random points, to 50 digits."""
    model = builder(*order, nonlinear=order[1] < 4)
    b = tuple(S("b0") * (1 + i) for i in range(len(model.plant.b)))  # so b0 alone carries u's unit
    derivation = derive(replace(model, plant=replace(model.plant, b=b)))
    s = derivation.signals
    draw = random.Random(order[0] + 10 * order[1])
    symbols = (*s.measurable, *s.gains, *(item.symbol for item in model.parameters))
    for _ in range(3):
        point = {symbol: sp.Rational(draw.randint(1, 40), 10) for symbol in symbols} | {
            S("b0"): sp.Integer(b0)
        }
        v, other = (evaluated(derivation, at) for at in (point, in_other_unit(derivation, point)))
        assert abs(point[KAPPA] * v - other) < sp.Float("1e-50") * (1 + abs(other))
    assert (KAPPA in derivation.expanded("v").free_symbols) == (order[1] > 1)


def evaluated(derivation: Derivation, point: dict[sp.Symbol, sp.Expr]) -> sp.Expr:
    """V at a point, equation by equation."""
    known = dict(point)
    for item in derivation.equations.values():
        if item.expression.free_symbols <= known.keys():
            known[item.symbol] = sp.N(item.expression.xreplace(known), 70)
    return known[derivation.signals.v]


@pytest.mark.parametrize("order", [(1, 1), (2, 2), (3, 2), (3, 3)])
def test_a_scale_of_one_is_the_law_without_it(
    builder: Callable[..., Model], order: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = derive(builder(*order))
    with monkeypatch.context() as patch:
        patch.setattr(Signals, "weights", property(lambda s: (sp.Integer(1),) * len(s.z)))
        plain = derive(builder(*order))
    for item in scaled.equations.values():
        former = plain.equations[item.name].expression
        assert item.expression.xreplace({KAPPA: sp.Integer(1)}) == former, item.name
