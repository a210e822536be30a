"""The certificate's identities hold for every member of the class, and V' is what they say at any point."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import sympy as sp

from pmjoint_derive import Derivation, Model, derive, real_symbol
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.lyapunov import prove, squares
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.vanishing import expand_to_zero

S = real_symbol


def test_every_identity_expands_to_zero_in_every_order(derivation: Derivation) -> None:
    identities = (*prove(derivation), *consistency_identities(derivation))
    assert [item.name for item in identities if not item.holds] == []
    assert len({item.name for item in identities}) == len(identities)


def test_the_papers_lyapunov_matrix(paper: Derivation) -> None:
    P = lyapunov_matrix(paper.signals).subs({S("k1"): 6, S("k2"): 8})
    assert sp.Matrix([[sp.Rational(3, 2), -1], [-1, sp.Rational(15, 16)]]) == P


def test_what_the_certificate_gives_away_is_squares(paper: Derivation) -> None:
    s2 = S("dalpha1_dy")
    PD = lyapunov_matrix(paper.signals) * sp.Matrix([S("D1"), S("D2")])
    for square in squares(paper, PD, (sp.Integer(-1), s2)):
        root = sp.sqrt(square.subs({S("e1"): 1, S("e2"): 1, S("k1"): 6, S("k2"): 8}))
        assert sp.expand(root**2 - square.subs({S("e1"): 1, S("e2"): 1, S("k1"): 6, S("k2"): 8})) == 0
        assert root.is_real


def test_expansion_sees_through_quotients_by_sigma() -> None:
    y, a = S("y"), S("a")
    sigma = 1 + a * y**2
    assert expand_to_zero((a + y) / sigma * sigma - a - y, sigma) == 0
    assert expand_to_zero(1 / (1 + y) - (1 - y) / (1 - y**2), sp.Integer(1)) == 0
    assert expand_to_zero(1 / sigma - 1, sigma) != 0


def test_exponentials_of_sums_cancel_in_a_quotient_that_is_written_in_another_way() -> None:
    a, b, length, q, r, y = (S(name) for name in ("a", "b", "length", "q", "r", "y"))
    near = sp.exp(-a * (b + r * y / length) ** 2 / q**2)
    far = sp.exp(-a * (b - r * (y**2 / 8 + y) / length) ** 2 / q**2)
    gain = r * (1 + y / 4) * far / length + r * near / length
    other = r * y * far + 4 * r * far + 4 * r * near
    assert expand_to_zero(a * gain / other - a / (4 * length), gain) == 0
    assert expand_to_zero(a * gain / other - a / (5 * length), gain) != 0


@pytest.mark.parametrize("order", [(1, 1), (3, 3)])
def test_an_identity_that_fails_shows_what_is_left(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    derivation = derive(builder(*order))
    gain = derivation.signals.c[0]
    left = expand_to_zero(derivation.expanded("z1") * gain, sp.Integer(1))
    assert gain in left.free_symbols


@pytest.mark.parametrize("order", [(1, 1), (2, 1), (2, 2), (3, 2)])
def test_the_named_error_rates_are_those_of_the_loop_that_is_simulated(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    """Each model disturbs every state, x1 = y among them; (27), (28) must see it."""
    derivation = derive(builder(*order))
    s, equations = derivation.signals, derivation.equations
    states = (*s.x, *s.controller_state)
    applied = frozenset({s.u})
    rates = {x: equations.expand(S(derivative_name(x)), applied) for x in states} | {s.t: sp.Integer(1)}
    for z in s.z:
        value = derivation.equations.expand(z)
        along = sum((sp.diff(value, x) * rate for x, rate in rates.items()), sp.Integer(0))
        claim = equations.expand(S(derivative_name(z)), applied)
        symbols = sorted(along.free_symbols | claim.free_symbols, key=str)
        both = sp.lambdify(symbols, [along.subs(s.compensator, 1), claim], "mpmath")
        with mpmath.workdps(40):
            point = [mpmath.mpf(x) for x in np.random.default_rng(7).uniform(0.5, 2, len(symbols))]
            found, expected = both(*point)
        assert abs(found - expected) < 1e-30 * (1 + abs(found)), z


@pytest.mark.parametrize("order", [(1, 1), (2, 2)])
def test_the_residual_counts_a_disturbance_of_the_output_twice(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    """At z = 0, epsilon = 0 V is least, so V' = 0 there: the squares hold all of the residual."""
    derivation = derive(builder(*order))
    s = derivation.signals
    P, D = lyapunov_matrix(s), sp.Matrix([S(f"D{i + 1}") for i in range(derivation.plant.order)])
    s_ = (sp.Integer(-1), S("s2"))[: derivation.plant.rho]
    there = sum(squares(derivation, P * D, s_), sp.Integer(0)).subs(dict.fromkeys((*s.z, *s.epsilon), 0))
    residual = sum(((2 * (P * D).dot(P * D) + D[0] ** 2) / (2 * e) for e in s.e), sp.Integer(0))
    assert sp.simplify(there - residual) == 0


def test_a_parameter_sigma_is_not_the_function_sigma() -> None:
    y, sigma = real_symbol("y"), real_symbol("sigma")
    function = 1 + y**2
    assert expand_to_zero(sigma - function, function) != 0
    assert expand_to_zero(sigma / function - function / sigma, function) != 0
    assert expand_to_zero(function / sigma * function - (1 + 2 * y**2 + y**4) / sigma, function) == 0
