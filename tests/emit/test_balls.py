"""Rules of balls against the functions themselves, at complex points."""

from __future__ import annotations

import cmath
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit.balls import Ball, entire, fixed, leaf, power, rules
from pmjoint_codegen.emit.recurrences import recurrences

RIM = np.exp(2j * np.pi * np.arange(400) / 400)
ROUNDING = 64 * np.finfo(float).eps  # of sinh r and cosh r - 1 from one exponential; a quotient squares it

Complex = Callable[[complex], complex]

UNARY: dict[str, tuple[int, Complex, tuple[float, float]]] = {
    "negative": (ca.OP_NEG, lambda z: -z, (-3, 3)),
    "twice": (ca.OP_TWICE, lambda z: 2 * z, (-3, 3)),
    "square": (ca.OP_SQ, lambda z: z * z, (-3, 3)),
    "inverse": (ca.OP_INV, lambda z: 1 / z, (-3, 3)),
    "sine": (ca.OP_SIN, cmath.sin, (-7, 7)),
    "cosine": (ca.OP_COS, cmath.cos, (-7, 7)),
    "tangent": (ca.OP_TAN, cmath.tan, (-7, 7)),
    "hyperbolic tangent": (ca.OP_TANH, cmath.tanh, (-30, 30)),
    "exponential": (ca.OP_EXP, cmath.exp, (-30, 30)),
    "logarithm": (ca.OP_LOG, cmath.log, (1e-3, 9)),
    "root": (ca.OP_SQRT, cmath.sqrt, (1e-3, 9)),
}
BINARY: dict[str, tuple[int, Callable[[complex, complex], complex]]] = {
    "sum": (ca.OP_ADD, lambda a, b: a + b),
    "difference": (ca.OP_SUB, lambda a, b: a - b),
    "product": (ca.OP_MUL, lambda a, b: a * b),
    "quotient": (ca.OP_DIV, lambda a, b: a / b),
}


def radius_of(rule: Callable[..., Ball], *operands: tuple[float, float]) -> float:
    symbols = [(ca.SX.sym("c"), ca.SX.sym("r")) for _ in operands]
    ball = rule(*(leaf(c, r) for c, r in symbols))
    flat = [symbol for pair in symbols for symbol in pair]
    return float(ca.Function("radius", flat, [ball.radius])(*(value for pair in operands for value in pair)))


def swing(function: Complex, centre: float, radius: float) -> float:
    """The largest distance from the value in the middle; it stands on the rim."""
    return max(abs(function(centre + radius * turn) - function(centre)) for turn in RIM)


@pytest.mark.parametrize("name", UNARY)
def test_no_value_on_the_disc_is_farther_away_and_the_rule_is_no_giveaway(name: str) -> None:
    operation, function, (low, high) = UNARY[name]
    generator = np.random.default_rng(11)
    ratios = []
    for _ in range(300):
        centre, radius = generator.uniform(low, high), 10.0 ** generator.uniform(-6.0, 0.5)
        bound = radius_of(rules()[operation], (centre, radius))
        if not bound < 1e12:
            continue  # the disc reaches a singularity, or nearly
        size = 1.0 + abs(function(complex(centre))) ** 2 + bound
        found = swing(function, centre, radius)
        assert found <= bound + ROUNDING * size, (centre, radius)
        ratios.append(found / bound)
    assert len(ratios) > 100
    assert np.median(ratios) > 0.85


@pytest.mark.parametrize("name", BINARY)
def test_of_two_balls(name: str) -> None:
    operation, function = BINARY[name]
    generator = np.random.default_rng(12)
    for _ in range(200):
        (a, b), (r, s) = generator.uniform(-3, 3, 2), 10.0 ** generator.uniform(-5.0, 0.0, 2)
        bound = radius_of(rules()[operation], (a, r), (b, s))
        if not bound < 1e12:
            continue
        turns = np.exp(2j * np.pi * generator.uniform(size=(400, 2)))
        found = max(abs(function(a + r * one, b + s * two) - function(a, b)) for one, two in turns)
        assert found <= bound + ROUNDING * (abs(function(a, b)) + bound)


@pytest.mark.parametrize("exponent", [0.3, 1.7, 3.2, -0.5, -2.5])
def test_of_a_power(exponent: float) -> None:
    generator = np.random.default_rng(13)
    for _ in range(100):
        centre = generator.uniform(0.1, 5.0)
        radius = centre * generator.uniform(0.0, 0.98)
        bound = radius_of(lambda ball: power(ball, exponent), (centre, radius))
        found = swing(lambda z: z**exponent, centre, radius)
        assert found <= bound + ROUNDING * (centre**exponent + bound)


@pytest.mark.parametrize(
    ("operation", "centre", "radius"),
    [
        (ca.OP_INV, 1.0, 1.0),
        (ca.OP_INV, -1.0, 2.5),
        (ca.OP_LOG, 1.0, 1.0),
        (ca.OP_LOG, 0.5, 3.0),
        (ca.OP_SQRT, 1.0, 1.5),
        (ca.OP_TAN, 1.5, 0.1),
        (ca.OP_TAN, 1.0, 5.0),
        (ca.OP_TANH, 0.0, 1.6),
        (ca.OP_TANH, 3.0, 800.0),
        (ca.OP_EXP, 0.0, 1e4),
        (ca.OP_SIN, 0.0, 1e4),
    ],
)
def test_a_disc_that_reaches_a_singularity_or_overflows_has_no_bound(
    operation: int, centre: float, radius: float
) -> None:
    """What comes out passes no test `value <= limit`: infinite, no number, or larger than any limit."""
    assert not radius_of(rules()[operation], (centre, radius)) <= 1e15


def test_what_is_linear_leaves_no_rest_and_what_is_not_does() -> None:
    c, r, k = (ca.SX.sym(name) for name in "crk")
    known = rules()
    line = known[ca.OP_ADD](known[ca.OP_MUL](fixed(k), leaf(c, r)), known[ca.OP_DIV](leaf(c, r), fixed(k)))
    both = known[ca.OP_SUB](line, known[ca.OP_SQ](leaf(c, r)))
    f = ca.Function("f", [c, r, k], [line.rest, line.radius, both.rest, both.radius])
    rest, radius, bent, whole = (float(value) for value in f(2.0, 0.5, -4.0))
    assert (rest, radius) == (0.0, 4.0 * 0.5 + 0.5 / 4.0)
    assert bent == (2 * 2.0 + 0.5) * 0.5
    assert whole == radius + bent


def test_every_smooth_operation_that_has_a_recurrence_has_a_rule() -> None:
    kinks = {ca.OP_FABS, ca.OP_SIGN}
    assert set(recurrences()) - kinks - {ca.OP_CONSTPOW} == set(rules())
    assert entire() <= set(rules())
