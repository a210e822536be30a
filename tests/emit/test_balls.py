"""Rules of balls against the functions themselves, at complex points."""

from __future__ import annotations

import cmath
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from pmjoint_codegen.emit import balls
from pmjoint_codegen.emit.balls import Ball, fixed, leaf, power
from pmjoint_codegen.operations import OPERATIONS, by_name

RIM = np.exp(2j * np.pi * np.arange(400) / 400)
ROUNDING = 64 * np.finfo(float).eps  # of sinh r and cosh r - 1 from one exponential; a quotient squares it

Complex = Callable[[complex], complex]

UNARY: dict[str, tuple[str, Complex, tuple[float, float]]] = {
    "negative": ("neg", lambda z: -z, (-3, 3)),
    "twice": ("twice", lambda z: 2 * z, (-3, 3)),
    "square": ("sq", lambda z: z * z, (-3, 3)),
    "inverse": ("inv", lambda z: 1 / z, (-3, 3)),
    "sine": ("sin", cmath.sin, (-7, 7)),
    "cosine": ("cos", cmath.cos, (-7, 7)),
    "tangent": ("tan", cmath.tan, (-7, 7)),
    "hyperbolic tangent": ("tanh", cmath.tanh, (-30, 30)),
    "exponential": ("exp", cmath.exp, (-30, 30)),
    "logarithm": ("log", cmath.log, (1e-3, 9)),
    "root": ("sqrt", cmath.sqrt, (1e-3, 9)),
    "inverse tangent": ("atan", cmath.atan, (-9, 9)),
    "hyperbolic sine": ("sinh", cmath.sinh, (-9, 9)),
    "hyperbolic cosine": ("cosh", cmath.cosh, (-9, 9)),
}
BINARY: dict[str, tuple[str, Callable[[complex, complex], complex]]] = {
    "sum": ("add", lambda a, b: a + b),
    "difference": ("sub", lambda a, b: a - b),
    "product": ("mul", lambda a, b: a * b),
    "quotient": ("div", lambda a, b: a / b),
}
TESTED = (*UNARY.values(), *BINARY.values())


def rule(operation: str) -> Callable[..., Ball]:
    """The rule of an operation by its name."""
    found = by_name()[operation].ball
    assert found is not None
    given: Callable[..., Ball] = found(balls)
    return given


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
        bound = radius_of(rule(operation), (centre, radius))
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
        bound = radius_of(rule(operation), (a, r), (b, s))
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
        bound = radius_of(lambda ball: power(ball, fixed(ca.SX(exponent))), (centre, radius))
        found = swing(lambda z: z**exponent, centre, radius)
        assert found <= bound + ROUNDING * (centre**exponent + bound)


@pytest.mark.parametrize(
    ("operation", "centre", "radius"),
    [
        ("inv", 1.0, 1.0),
        ("inv", -1.0, 2.5),
        ("log", 1.0, 1.0),
        ("log", 0.5, 3.0),
        ("sqrt", 1.0, 1.5),
        ("tan", 1.5, 0.1),
        ("tan", 1.0, 5.0),
        ("tanh", 0.0, 1.6),
        ("tanh", 3.0, 800.0),
        ("exp", 0.0, 1e4),
        ("sin", 0.0, 1e4),
        ("atan", 0.0, 1.0),
        ("atan", 1.0, 1.5),
        ("atan", -30.0, 40.0),
        ("sinh", 0.0, 1e4),
        ("cosh", 800.0, 0.1),
    ],
)
def test_a_disc_that_reaches_a_singularity_or_overflows_has_no_bound(
    operation: str, centre: float, radius: float
) -> None:
    """What comes out passes no test `value <= limit`: infinite, no number, or larger than any limit."""
    assert not radius_of(rule(operation), (centre, radius)) <= 1e15


def test_what_is_linear_leaves_no_rest_and_what_is_not_does() -> None:
    c, r, k = (ca.SX.sym(name) for name in "crk")
    line = rule("add")(rule("mul")(fixed(k), leaf(c, r)), rule("div")(leaf(c, r), fixed(k)))
    both = rule("sub")(line, rule("sq")(leaf(c, r)))
    f = ca.Function("f", [c, r, k], [line.rest, line.radius, both.rest, both.radius])
    rest, radius, bent, whole = (float(value) for value in f(2.0, 0.5, -4.0))
    assert (rest, radius) == (0.0, 4.0 * 0.5 + 0.5 / 4.0)
    assert bent == (2 * 2.0 + 0.5) * 0.5
    assert whole == radius + bent


def test_every_smooth_operation_that_has_a_recurrence_has_a_rule() -> None:
    kinks = {"fabs", "sign"}
    assert {item.name for item in OPERATIONS if item.recurrence} - kinks == {
        item.name for item in OPERATIONS if item.ball
    }
    assert all(item.ball for item in OPERATIONS if item.entire)


def test_every_function_of_a_model_file_is_tested_here() -> None:
    assert {item.name for item in OPERATIONS if item.ball} == {name for name, *_ in TESTED} | {"pow"}
