"""Complex balls with real centres: how far a function can go from its value on a disc of the complex plane.

A ball ``(c, r)`` encloses what a quantity takes where time is anywhere in a disc and every state anywhere in
a disc of its own. Beside the radius stands its nonlinear part ``rest``: what is left once everything linear
in time and states is taken away. A step's polynomials reproduce what is linear exactly, so that ``rest``
alone bounds what they can miss (docs/theory.md, "Steps that see what is inside them").

Each rule is a supremum over the operand's ball, or a bound on it; where an operand's ball reaches a
singularity the result is infinite or no number, which no test of a step passes. The rules use operations
that every dialect prints: exp, log, sqrt, sin, cos, fmin, fmax and arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Ball:
    """A quantity on the disc.

    Attributes:
        centre: its value in the middle.
        radius: bound on its distance from there.
        rest: bound on its nonlinear part.
        constant: whether it depends on parameters alone; radius and rest are then 0.
    """

    centre: ca.SX
    radius: ca.SX
    rest: ca.SX
    constant: bool = False


def fixed(value: ca.SX) -> Ball:
    """A parameter or a number."""
    return Ball(value, ca.SX(0), ca.SX(0), constant=True)


def leaf(centre: ca.SX, radius: ca.SX) -> Ball:
    """Time or a state: linear in itself."""
    return Ball(centre, radius, ca.SX(0))


def nonlinear(centre: ca.SX, radius: ca.SX) -> Ball:
    """The result of a nonlinear operation."""
    return Ball(centre, radius, radius)


def scaled(ball: Ball, factor: ca.SX) -> Ball:
    """Product with a constant."""
    size = ca.fabs(factor)
    return Ball(ball.centre * factor, ball.radius * size, ball.rest * size)


Rule = Callable[..., Ball]


def _add(a: Ball, b: Ball) -> Ball:
    return Ball(a.centre + b.centre, a.radius + b.radius, a.rest + b.rest)


def _subtract(a: Ball, b: Ball) -> Ball:
    return Ball(a.centre - b.centre, a.radius + b.radius, a.rest + b.rest)


def _multiply(a: Ball, b: Ball) -> Ball:
    if a.constant:
        return scaled(b, a.centre)
    if b.constant:
        return scaled(a, b.centre)
    radius = ca.fabs(a.centre) * b.radius + ca.fabs(b.centre) * a.radius + a.radius * b.radius
    return nonlinear(a.centre * b.centre, radius)


def _square(a: Ball) -> Ball:
    return nonlinear(a.centre * a.centre, (2.0 * ca.fabs(a.centre) + a.radius) * a.radius)


def _divide(a: Ball, b: Ball) -> Ball:
    if b.constant:
        return scaled(a, 1.0 / b.centre)
    quotient = a.centre / b.centre
    nearest = _positive(ca.fabs(b.centre) - b.radius)
    return nonlinear(quotient, (a.radius + ca.fabs(quotient) * b.radius) / nearest)


def _invert(a: Ball) -> Ball:
    return _divide(fixed(ca.SX(1)), a)


def _positive(distance: ca.SX) -> ca.SX:
    """A distance from a singularity, 0 where the ball reaches it: what is divided by it is then infinite."""
    return ca.fmax(distance, 0.0)


def _exponential(a: Ball) -> Ball:
    """``e^c (e^r - 1)``, as a difference: far below a pulse e^r alone would overflow."""
    value = ca.exp(a.centre)
    return nonlinear(value, ca.exp(a.centre + a.radius) - value)


def _logarithm(a: Ball) -> Ball:
    return nonlinear(ca.log(a.centre), _log_radius(a))


def _log_radius(a: Ball) -> ca.SX:
    """``-log(1 - r/c)``; of the logarithm about c > 0 the series' own bound."""
    return -ca.log(_positive(1.0 - a.radius / ca.fabs(a.centre)))


def _root(a: Ball) -> Ball:
    value = ca.sqrt(a.centre)
    return nonlinear(value, value * (1.0 - ca.sqrt(1.0 - a.radius / a.centre)))


def power(a: Ball, exponent: float) -> Ball:
    """``a^e`` with a number e, about c > 0: the binomial series of ``(1 - r/c)^(-|e|)``."""
    value = a.centre**exponent
    return nonlinear(value, ca.fabs(value) * (ca.exp(abs(exponent) * _log_radius(a)) - 1.0))


def _hyperbolic(radius: ca.SX) -> tuple[ca.SX, ca.SX]:
    """``sinh r`` and ``cosh r - 1``, or a little more, from one bound of e^r.

    ``(1 + x)/(1 - x)`` exceeds ``e^(2x)`` for 0 < x < 1; with x = r/16 its eighth power is 1 % above e^r at
    r = 2, and costs a division.
    """
    x = radius / 16.0
    root = (1.0 + x) / _positive(1.0 - x)
    square = root * root
    fourth = square * square
    grown = fourth * fourth
    shrunk = 1.0 / grown
    return 0.5 * (grown - shrunk), 0.5 * (grown + shrunk) - 1.0


def _sine(a: Ball) -> Ball:
    sine, cosine = ca.sin(a.centre), ca.cos(a.centre)
    sinh, above_one = _hyperbolic(a.radius)
    return nonlinear(sine, ca.fabs(cosine) * sinh + ca.fabs(sine) * above_one)


def _cosine(a: Ball) -> Ball:
    sine, cosine = ca.sin(a.centre), ca.cos(a.centre)
    sinh, above_one = _hyperbolic(a.radius)
    return nonlinear(cosine, ca.fabs(sine) * sinh + ca.fabs(cosine) * above_one)


def _tangent(a: Ball) -> Ball:
    """``|sin z / (cos c cos(c + z))|``."""
    cosine = _cosine(a)
    size = ca.fabs(cosine.centre)
    sinh, _ = _hyperbolic(a.radius)
    return nonlinear(ca.tan(a.centre), sinh / (size * _positive(size - cosine.radius)))


def _hyperbolic_tangent(a: Ball) -> Ball:
    """``|sinh z / (cosh c cosh(c + z))|`` ; ``|cosh(u + iv)|^2`` is ``sinh^2 u + cos^2 v``."""
    u, r = ca.fabs(a.centre), a.radius
    # sinh r / cosh u, where neither of the two overflows
    quotient = ca.exp(r - u) * (1.0 - ca.exp(-2.0 * r)) / (1.0 + ca.exp(-2.0 * u))
    grown = ca.exp(ca.fmax(u - r, 0.0))
    sinh = 0.5 * (grown - 1.0 / grown)
    cosine = ca.cos(ca.fmin(r, math.pi / 2))
    return nonlinear(ca.tanh(a.centre), quotient / ca.sqrt(sinh * sinh + cosine * cosine))


def rules() -> Mapping[int, Rule]:
    """The rule of each operation, by CasADi's number of it; powers have one of their own."""
    return {
        ca.OP_ASSIGN: lambda a: a,
        ca.OP_ADD: _add,
        ca.OP_SUB: _subtract,
        ca.OP_NEG: lambda a: Ball(-a.centre, a.radius, a.rest, a.constant),
        ca.OP_TWICE: lambda a: scaled(a, ca.SX(2)),
        ca.OP_MUL: _multiply,
        ca.OP_SQ: _square,
        ca.OP_DIV: _divide,
        ca.OP_INV: _invert,
        ca.OP_SIN: _sine,
        ca.OP_COS: _cosine,
        ca.OP_TAN: _tangent,
        ca.OP_TANH: _hyperbolic_tangent,
        ca.OP_EXP: _exponential,
        ca.OP_LOG: _logarithm,
        ca.OP_SQRT: _root,
    }


def entire() -> frozenset[int]:
    """Operations without a singularity in the complex plane that grow no faster than exp."""
    return frozenset(
        (
            ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_MUL, ca.OP_SQ,
            ca.OP_SIN, ca.OP_COS,
        )
    )  # fmt: skip
