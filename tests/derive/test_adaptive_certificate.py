"""What a reader is told of V of the adaptive design: V_dot is its rate, and V_dot_max bounds it."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Gains, Model, derive, real_symbol
from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.certificate import certificate_equations as of_the_known_design
from pmjoint_derive.equation import Equation, Equations
from pmjoint_derive.filters import filter_matrix
from tests.derive.adaptive_models import adaptive

S = real_symbol
BOUND = {"D_max", "Y", "V_dot_max"}
DECAY = {"lambda_P", "f"}


def printed(derivation: Derivation) -> tuple[Equation, ...]:
    """Return what the reader is told."""
    return derivation.design.certificate(derivation)


def names(derivation: Derivation) -> set[str]:
    """Return the names of it."""
    return {item.name for item in printed(derivation)}


def whole(derivation: Derivation) -> Equations:
    """Return the printed equations with the named ones that they use, less what stays free."""
    free = {symbol.name for symbol in (*derivation.signals.z, *derivation.signals.epsilon)}
    free |= {f"d{alpha}_dy" for alpha in derivation.signals.alpha}
    free |= {f"D{i + 1}" for i in range(derivation.plant.order)}
    free |= {f"omega_{hat.name.removesuffix('_hat')}" for hat in derivation.signals.estimates}
    of_v = ("Adaptation", "Certificate")
    used = (item for item in derivation.equations.values() if item.section in of_v and item.name not in free)
    return Equations([*used, *printed(derivation)])


def drawn(symbols: set[sp.Symbol], seed: int) -> dict[sp.Symbol, sp.Rational]:
    """Draw rational values: ends of ranges beyond all else, so that estimates and truth are within."""
    draw = random.Random(seed)
    ends = {"low": sp.Integer(-20), "high": sp.Integer(20)}
    return {
        symbol: ends.get(symbol.name.rpartition("_")[2], sp.Rational(draw.randint(1, 99), 10))
        for symbol in sorted(symbols, key=str)
    }


@pytest.mark.parametrize(
    ("order", "variant"),
    [
        ((1, 1), {}),
        ((2, 2), {}),
        ((2, 1), {"inverse": True, "ranged": False}),
        ((3, 3), {"unknown": (0,), "ranged": False}),
        ((2, 2), {"unknown": (1,), "guessed": (2,)}),
    ],
)
def test_the_printed_rate_is_that_of_v(
    builder: Callable[..., Model], order: tuple[int, int], variant: dict[str, Any]
) -> None:
    """At random rational points: exactly or, where logits bring tanh with them, to 40 digits."""
    derivation = derive(adaptive(builder(*order), **variant))
    s, known = derivation.signals, whole(derivation)
    D = sp.Matrix([S(f"D{i + 1}") for i in range(derivation.plant.order)])
    rates = dict(zip(s.epsilon, filter_matrix(s) * sp.Matrix(s.epsilon) + D, strict=True))
    rates |= {symbol: derivation.equations[f"{symbol}_dot"].expression for symbol in (*s.z, *s.learnt)}
    rates |= {hat: derivation.equations[f"{hat}_dot"].expression for hat in s.inverse}
    V, first = known.expand(S("V")), S("rho_hat") * S("alpha_bar")
    law = {S("alpha1"): first, s.v: first / derivation.plant.sigma}  # form "inverse": the rates use it
    along = sum((sp.diff(V, symbol) * rate for symbol, rate in rates.items()), sp.Integer(0))
    difference = known.expand(along - S("V_dot")).xreplace(law)
    assert difference.free_symbols
    for seed in range(3):
        assert abs(sp.N(difference.xreplace(drawn(difference.free_symbols, seed)), 60)) < 1e-40


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_printed_bound_holds(builder: Callable[..., Model], inverse: bool, sign: int) -> None:
    """What V_dot leaves to V_dot_max is not negative, for a disturbance as large as its bound."""
    derivation = derive(adaptive(builder(2, 2), ranged=False, inverse=inverse, sign=sign))
    known, s, gains = whole(derivation), derivation.signals, derivation.model.gains
    assert names(derivation) >= BOUND | DECAY
    values = {symbol: sp.Rational(repr(value)) for symbol, value in zip(s.k, gains.k, strict=True)}
    gap = known.expand(S("V_dot_max") - S("V_dot"))
    lost = known.expand(S("V_lost"))
    for seed in range(8):
        point = drawn(gap.free_symbols | lost.free_symbols, seed)
        angle = sp.Rational(seed, 3)
        largest = known["D_max"].expression
        point |= values | {S("D1"): largest * sp.cos(angle), S("D2"): largest * sp.sin(angle)}
        point[S("b0")] *= sign
        assert sp.N(gap.xreplace(point)) >= 0
        assert sp.N(lost.xreplace(point)) >= 0


@pytest.mark.parametrize(
    ("share", "moved"),
    [
        ("errors", {"z2": 1000, "c2": sp.Rational(1, 10)}),
        ("estimates", {"d1_hat": 1000, "d1_prior": 1000, "leakage": sp.Rational(1, 100)}),
        ("inverse", {"rho_hat": 1000, "rho_prior": 1000, "rho_leakage": sp.Rational(1, 100)}),
        ("priors", {"d1_hat": 500, "d1_prior": 1000}),
    ],
)
def test_no_share_of_v_decays_slower_than_printed(
    builder: Callable[..., Model], share: str, moved: dict[str, sp.Expr]
) -> None:
    """One share is large, all else is at rest and would decay fast: the bound is then almost reached."""
    derivation = derive(adaptive(builder(2, 2), ranged=False, inverse=True))
    s, known = derivation.signals, whole(derivation)
    rest = {S("b0"): 2, S("b0_hat"): 2, S("b0_prior"): 2}
    rest |= dict.fromkeys((S("rho_hat"), S("rho_prior")), sp.Rational(1, 2))
    rest |= dict.fromkeys((S("Theta2_hat"), S("Theta2_prior")), sp.Rational(1, 3))
    still = (*s.z, *s.epsilon, *map(S, ("dalpha1_dy", "D1", "D2", "d1", "d1_hat", "d1_prior")))
    rest |= dict.fromkeys(still, 0)
    rest |= {symbol: sp.Rational(str(k)) for symbol, k in zip(s.k, derivation.model.gains.k, strict=True)}
    gap = known.expand(S("V_dot_max") - S("V_dot"))
    point = {symbol: sp.Integer(10) for symbol in gap.free_symbols} | rest
    assert gap.xreplace(point | {S(name): sp.sympify(value) for name, value in moved.items()}) >= 0


def changed(model: Model, **values: Any) -> Model:
    """Return the model with another adaptation."""
    assert isinstance(model.adaptation, Adaptation)
    return replace(model, adaptation=replace(model.adaptation, **values))


def test_no_decay_is_printed_where_none_is_proved(builder: Callable[..., Model]) -> None:
    model = builder(2, 2)
    constant = adaptive(model, ranged=False, inverse=True)
    assert constant.adaptation is not None and constant.adaptation.inverse is not None
    still = replace(constant.adaptation.inverse, leakage=0.0)
    for other in (adaptive(model), changed(constant, leakage=0.0), changed(constant, inverse=still)):
        assert "V_dot" in names(derive(other))
        assert not names(derive(other)) & (BOUND | DECAY)


def test_a_guess_that_stays_is_a_disturbance_without_a_bound(builder: Callable[..., Model]) -> None:
    model = adaptive(builder(2, 2), unknown=(1,), guessed=(0,), ranged=False)
    assert names(derive(model)) & (BOUND | DECAY) == DECAY
    frozen = derive(replace(adaptive(builder(2, 2), unknown=(), guessed=(0,)), design="backstepping"))
    assert not {item.name for item in of_the_known_design(frozen)} & BOUND


def test_nothing_is_printed_of_a_gain_of_zero(builder: Callable[..., Model]) -> None:
    assert printed(derive(adaptive(builder(2, 2), gain=0.0))) == ()


def test_of_least_squares_the_errors_alone_are_printed(builder: Callable[..., Model]) -> None:
    assert names(derive(adaptive(builder(2, 2), squares=True))) == {"V_z", "V_z_dot"}


def test_of_a_high_order_v_is_printed_with_p_in_numbers(builder: Callable[..., Model]) -> None:
    model = builder(4, 1)
    zero, y = sp.Integer(0), S("y")
    plant = replace(
        model.plant,
        order=5,
        phi=(zero,) * 5,
        Phi=((zero, zero),) * 4 + ((y, zero),),
        b=(*model.plant.b, sp.Integer(9)),
        disturbance=(zero,) * 4 + (sp.cos(S("t")),),
    )
    gains = Gains((1.0,), (1.0,), (1.0,), (10.0, 40.0, 80.0, 80.0, 32.0))
    derivation = derive(adaptive(replace(model, plant=plant, gains=gains)))
    told = Equations(printed(derivation))
    assert "V" not in derivation.equations
    assert told["P_12"].expression == -1 and told["P_55"].expression.is_Rational
    assert {"V_z", "V_Theta", "V_epsilon", "V", "V_dot"} <= set(told)
    assert [item.name for item in derivation.design.prove(derivation) if not item.holds] == []
