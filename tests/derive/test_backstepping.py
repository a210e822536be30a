"""The law against the paper's own (25) and (29), and against what it is meant to achieve, in any order."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
import sympy as sp

from pmjoint_derive import Derivation, derive, real_symbol
from pmjoint_derive.compensator import compensator_rates
from pmjoint_derive.filters import filter_rates

S = real_symbol


def paper_law() -> tuple[sp.Expr, sp.Expr]:
    """Alpha_1 of (25) and v of (29), typed from the page; v_{0,3} = 0, bar-omega' Theta = Xi_21 d1."""
    c1, c2, e1, e2, ck1, ck2, k1, k2, b0, d1 = map(
        S, ["c1", "c2", "e1", "e2", "ck1", "ck2", "k1", "k2", "b0", "d1"]
    )
    y, y_r, dy_r, d2y_r, r1, r2 = map(S, ["y", "y_r", "dy_r", "d2y_r", "r1", "r2"])
    xi1, xi2, Xi1, Xi2, lam1, lam2 = map(S, ["xi1", "xi2", "Xi11", "Xi21", "lambda1", "lambda2"])
    z1 = y - y_r - r1
    alpha1 = (-c1 * z1 - e1 * z1 - xi2 - Xi2 * d1 - ck1 * r1) / b0
    z2 = lam2 - alpha1 - dy_r / b0 - r2 / b0
    D = sp.diff
    v = (
        -b0 * z1 - c2 * z2 - e2 * D(alpha1, y) ** 2 * z2 - 0 - ck2 / b0 * r2
        + D(alpha1, y) * (b0 * lam2 + xi2 + Xi2 * d1)
        + D(alpha1, xi1) * (-k1 * xi1 + xi2 + k1 * y) + D(alpha1, xi2) * (-k2 * xi1 + k2 * y)
        + D(alpha1, r1) * (r2 - ck1 * r1)
        + D(alpha1, Xi1) * (-k1 * Xi1 + Xi2) + D(alpha1, Xi2) * (-k2 * Xi1 + y)
        + k2 * lam1 + d2y_r / b0 + D(alpha1, y_r) * dy_r
    )  # fmt: skip
    return alpha1, v


def test_law_equals_25_and_29(paper: Derivation) -> None:
    alpha1, v = paper_law()
    assert sp.expand(paper.expanded("alpha1") - alpha1) == 0
    assert sp.expand(paper.expanded("v").subs(paper.signals.input_scale, 1) - v) == 0


def test_paper_partials_have_the_closed_forms(paper: Derivation) -> None:
    c1, e1, ck1, b0, d1 = map(S, ["c1", "e1", "ck1", "b0", "d1"])
    expected = {
        "dalpha1_dy": -(c1 + e1) / b0,
        "dalpha1_dy_r": (c1 + e1) / b0,
        "dalpha1_dr1": (c1 + e1 - ck1) / b0,
        "dalpha1_dxi2": -1 / b0,
        "dalpha1_dXi21": -d1 / b0,
    }
    found = {name: item.expression for name, item in paper.equations.items() if name.startswith("dalpha")}
    assert found.keys() == expected.keys()
    assert all(sp.simplify(found[name] - expected[name]) == 0 for name in expected)


def test_neither_input_nor_estimation_error_enters_the_law(derivation: Derivation) -> None:
    s = derivation.signals
    for symbol in (*s.alpha, s.v):
        assert not derivation.expanded(symbol.name).free_symbols & {s.u, s.du, *s.epsilon, *s.x[1:]}


def true_rates(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """Rates of y, filters, compensator and reference with the true y', u arbitrary and du = u - v."""
    s, plant = derivation.signals, derivation.plant
    y_dot = plant.phi[0] + sum(a * b for a, b in zip(plant.Phi[0], plant.theta, strict=True))
    y_dot += derivation.expanded("D1")
    if plant.order > 1:
        y_dot += derivation.expanded("x_hat2") + s.epsilon[1]
    if plant.rho == 1:
        y_dot += plant.b[0] * plant.sigma * s.u
    rates = {s.y: y_dot, **filter_rates(derivation.design), **compensator_rates(derivation.design)}
    return rates | dict(zip(s.y_r, s.y_r[1:], strict=False))


def exact_point(expressions: list[sp.Expr], seed: int) -> dict[sp.Symbol, sp.Rational]:
    """Random rationals for every symbol."""
    generator = random.Random(seed)
    symbols = sorted(set().union(*(item.free_symbols for item in expressions)), key=str)
    return {
        symbol: sp.Rational(generator.randint(-99, 99) or 1, generator.randint(7, 40)) for symbol in symbols
    }


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_obey_the_wanted_dynamics_whatever_u_is(derivation: Derivation, seed: int) -> None:
    """The expanded z_i, differentiated along the true loop, give z_i' of (27), (28), for any u."""
    s = derivation.signals
    rates = true_rates(derivation)
    v = derivation.expanded("v")
    for z in s.z:
        expanded = derivation.expanded(z.name)
        actual = sum(sp.diff(expanded, by) * rate for by, rate in rates.items()).xreplace({s.du: s.u - s.v})
        wanted = derivation.expanded(f"{z.name}_dot")
        point = exact_point([actual, wanted, v], seed)
        point[s.v] = sp.N(v.xreplace(point), 60)
        difference = sp.N((actual - wanted).xreplace(point), 50)
        scale = 1 + abs(sp.N(wanted.xreplace(point), 20))
        assert abs(difference) < sp.Float("1e-40") * scale


def test_lyapunov_rate_is_minus_squares(derivation: Derivation) -> None:
    """Of V's sum of squares: couplings cancel, -sum (c + e s^2) z^2 - sum s z (eps_2 + D_1) remains.

    Here z_i and s_i are kappa times the law's from step 2 on.
    """
    s, plant = derivation.signals, derivation.plant
    eta = S("D1") + (s.epsilon[1] if plant.order > 1 else sp.Integer(0))
    kappa = [sp.Integer(1), *(S("input_scale"),) * (plant.rho - 1)]
    rate = sum(
        w**2 * z * derivation.equations[f"{z.name}_dot"].expression for w, z in zip(kappa, s.z, strict=True)
    )
    sensitivity = [sp.Integer(-1), *(S(f"d{alpha.name}_dy") for alpha in s.alpha)]
    wanted = -sum(
        c * (w * z) ** 2 + e * (w * s_i) ** 2 * (w * z) ** 2 + w * s_i * w * z * eta
        for w, c, e, z, s_i in zip(kappa, s.c, s.e, s.z, sensitivity, strict=True)
    )
    assert sp.expand(rate - wanted) == 0


def test_every_step_bears_the_papers_number(paper: Derivation) -> None:
    """A reader goes from a line to the page by it."""
    numbers = {
        "y": "(7)", "x1_dot": "(11)", "x2_dot": "(11)", "D2": "(37)", "u": "(10)",
        "xi1_dot": "(14)", "Xi21_dot": "(14)", "lambda2_dot": "(14)", "x_hat2": "(15)", "epsilon2": "(17)",
        "Omega": "(21)", "du": "(23)", "r1_dot": "(23)", "r2_dot": "(23)", "z1": "(24)", "z2": "(24)",
        "alpha1": "(25)", "dalpha1_dy": "(29)", "v": "(29)", "z1_dot": "(27)", "z2_dot": "(28)",
    }  # fmt: skip
    assert {name: paper.equations[name].number for name in numbers} == numbers


def test_only_the_papers_own_disturbance_is_37(paper: Derivation) -> None:
    model = paper.model
    other = derive(replace(model, plant=replace(model.plant, disturbance=(sp.Integer(0), S("x2") / 10))))
    assert [other.equations[name].number for name in ("D1", "D2")] == ["(12)", "(12)"]
    assert paper.equations["D1"].number == "(12)"
