"""The guard: what it promises of a whole step, against what happens there."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit.guard import guard_function, rule, rule_of
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.loops.guard import discs, factor
from pmjoint_codegen.manifest import GuardRule

ORDERS = (5, 8, 10, 12, 16)


def product(nodes: list[float], order: int, x: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(x**order * np.prod([x - node for node in nodes], axis=0)))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("samples", [1, 3])
def test_the_remainder_s_factor_is_its_largest_value_and_no_more(order: int, samples: int) -> None:
    found = rule(order, samples)
    x = np.linspace(0.0, 1.0, 1_000_003)
    largest = product([*found.inside, 1.0], order, x).max()
    assert largest <= found.remainder <= largest * (1 + 1e-4)


@pytest.mark.parametrize("order", ORDERS)
def test_two_points_inside_let_a_step_come_closer_to_a_singularity(order: int) -> None:
    """At the factor 1e-10 the disc is at most 0.75 of what it is with the end alone; 1.6 is the price."""
    one, three = rule(order, 1), rule(order, 3)
    assert three.lebesgue < 1.6
    ratios = [next(s for s in np.arange(1.05, 99.0, 0.01) if factor(r, s) < 1e-10) for r in (one, three)]
    assert ratios[1] < 0.75 * ratios[0]


FUNCTIONS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], float]] = {
    "sine": (np.sin, np.inf),
    "pulse": (lambda z: np.exp(-(((z - 0.4) / 0.3) ** 2)), np.inf),
    "pole": (lambda z: 1.0 / (1.0 + (z - 0.1) ** 2), abs(0.1 + 1j)),
    "window": (lambda z: np.tanh(3.0 * (z - 0.5)), abs(0.5 + 1j * np.pi / 6)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("order", [5, 12, 16])
@pytest.mark.parametrize("samples", [1, 3])
def test_the_bound_holds_at_hundreds_of_points(name: str, order: int, samples: int) -> None:
    """Of x' = F(t): the polynomial's slope is F's own Taylor polynomial of degree N - 1."""
    function, reach = FUNCTIONS[name]
    found = rule(order, samples)
    rim = np.exp(2j * np.pi * np.arange(1024) / 1024)
    small = 0.2
    coefficients = np.fft.fft(function(small * rim))[:order].real / 1024 / small ** np.arange(order)
    for h in (0.02, 0.08, 0.2, 0.4):
        x = np.linspace(0.0, 1.0, 601)
        points = np.array([*found.inside, 1.0])
        defect, at_points = (
            np.abs(function(h * part) - np.polynomial.polynomial.polyval(h * part, coefficients))
            for part in (x, points)
        )
        for ratio in (1.2, 1.6, 2.2, 3.0, 5.0):
            if ratio * h >= 0.999 * reach:
                continue
            swing = np.max(np.abs(function(ratio * h * rim) - function(np.zeros(1))))
            bound = found.lebesgue * at_points.max() + factor(found, ratio) * swing * 1.001
            assert np.all(defect <= bound + 1e-11 * (1 + (h / small) ** order)), (h, ratio)


def test_a_disc_no_larger_than_the_step_needs_no_points() -> None:
    """The last of the discs: N r bounds F less its Taylor polynomial, twice that with the end's."""
    found = discs(rule(12, 1), 1e-6)
    assert (found.ratios[-1], found.factors[-1]) == (1.0, 24.0)


@pytest.mark.parametrize("tolerance", [1e-14, 1e-10, 1e-6, 1e-3])
def test_discs_are_larger_than_the_step_and_their_factors_near_what_is_asked(tolerance: float) -> None:
    for order in ORDERS:
        for samples in (1, 3):
            found = discs(rule(order, samples), tolerance)
            assert all(ratio > 1.0 for ratio in found.ratios[:-1])
            assert found.factors[2] < found.factors[0]
            assert tolerance > 1e-6 or 0.1 * tolerance < found.factors[0] < 10 * tolerance


def test_the_guard_of_a_right_hand_side() -> None:
    """Linear rates have none; others that of their nonlinear nodes, on the discs given."""
    t, X, p = ca.SX.sym("t"), ca.SX.sym("X", 2), ca.SX.sym("p", 2)
    rates = ca.vertcat(p[0] * X[0] + t / p[1], ca.exp(X[0]) + 3 * X[1])
    f = ca.Function("f", [t, X, p], [rates, ca.sin(p[0]) + t], ["t", "X", "p"], ["X_dot", "v"])
    guard = guard_function("guard", f, state="X")
    assert guard.name_in() == ["t", "X", "p", "R", "P"]
    rest = np.array(guard(0.3, [0.5, 1.0], [2.0, 3.0], 0.1, [0.2, 7.0])).ravel()
    np.testing.assert_allclose(rest, [0.0, np.exp(0.5) * np.expm1(0.2), 0.0], rtol=1e-14)


def test_points_inside_only_where_there_are_singularities() -> None:
    t, X, p = ca.SX.sym("t"), ca.SX.sym("X"), ca.SX.sym("p")

    def of(rate: ca.SX) -> GuardRule:
        return rule_of(ca.Function("f", [t, X, p], [rate], ["t", "X", "p"], ["X_dot"]), 16)

    assert of(ca.sin(t) * X / p + ca.tanh(p)).inside == ()
    for rate in (ca.tanh(X), ca.exp(t), 1 / X, ca.sqrt(1 + t * t)):
        assert len(of(rate).inside) == 2


def test_an_operation_without_a_rule_is_refused() -> None:
    t, X = ca.SX.sym("t"), ca.SX.sym("X")
    f = ca.Function("f", [t, X], [ca.fabs(X)], ["t", "X"], ["X_dot"])
    with pytest.raises(ModelError, match="no bound on a disc"):
        guard_function("guard", f, state="X")
