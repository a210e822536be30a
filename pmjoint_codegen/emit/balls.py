"""Complex balls with real centres: how far a function can deviate from its value on a disc.

A ball ``(c, r)`` encloses the values of a quantity while time is anywhere in a disc and every state anywhere
in its own disc. Besides the radius there is the nonlinear part ``rest``: the remainder without everything
linear in time and states. A step's polynomials reproduce the linear part exactly, so ``rest`` alone bounds
their error (docs/theory.md, "Steps that see what is inside them").

The table of operations assigns the rules (`operations`). Each rule is a supremum over the operand's ball, or
a bound on it; if an operand's ball reaches a singularity the result is infinite or NaN, and the step is
rejected.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Ball:
    """A quantity on the disc.

    Attributes:
        centre: its value at the centre.
        radius: bound on its distance from there.
        rest: bound on its nonlinear part.
        constant: whether it depends only on parameters; radius and rest are then 0.
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


def linear(apply: Callable[[ca.SX, ca.SX], ca.SX]) -> Rule:
    """``a + b`` or ``a - b``."""
    return lambda a, b: Ball(apply(a.centre, b.centre), a.radius + b.radius, a.rest + b.rest)


def multiply(a: Ball, b: Ball) -> Ball:
    """``a b``."""
    if a.constant:
        return scaled(b, a.centre)
    if b.constant:
        return scaled(a, b.centre)
    radius = ca.fabs(a.centre) * b.radius + ca.fabs(b.centre) * a.radius + a.radius * b.radius
    return nonlinear(a.centre * b.centre, radius)


def square(a: Ball) -> Ball:
    """``a^2``."""
    return nonlinear(a.centre * a.centre, (2.0 * ca.fabs(a.centre) + a.radius) * a.radius)


def divide(a: Ball, b: Ball) -> Ball:
    """``a / b``."""
    if b.constant:
        return scaled(a, 1.0 / b.centre)
    quotient = a.centre / b.centre
    nearest = positive(ca.fabs(b.centre) - b.radius)
    return nonlinear(quotient, (a.radius + ca.fabs(quotient) * b.radius) / nearest)


def positive(distance: ca.SX) -> ca.SX:
    """A distance from a singularity, 0 where the ball reaches it: what is divided by it is then infinite."""
    return ca.fmax(distance, 0.0)


def log_radius(c: ca.SX, r: ca.SX) -> ca.SX:
    """``-log(1 - r/c)``; of the logarithm about c > 0 the series' own bound."""
    return -ca.log(positive(1.0 - r / ca.fabs(c)))


def power(a: Ball, b: Ball) -> Ball:
    """``a^e`` with a number e, about c > 0: the binomial series of ``(1 - r/c)^(-|e|)``."""
    exponent = float(b.centre)
    value = a.centre**exponent
    return nonlinear(value, ca.fabs(value) * (ca.exp(abs(exponent) * log_radius(a.centre, a.radius)) - 1.0))


def _hyperbolic(radius: ca.SX) -> tuple[ca.SX, ca.SX]:
    """``sinh r`` and ``cosh r - 1``, or a little more, from one bound of e^r.

    ``(1 + x)/(1 - x)`` exceeds ``e^(2x)`` for 0 < x < 1; with x = r/16 its eighth power is 1 % above e^r at
    r = 2, and costs a division.
    """
    x = radius / 16.0
    root = (1.0 + x) / positive(1.0 - x)
    square = root * root
    fourth = square * square
    grown = fourth * fourth
    shrunk = 1.0 / grown
    return 0.5 * (grown - shrunk), 0.5 * (grown + shrunk) - 1.0


def pair(name: str, companion: str) -> Rule:
    """Sine or cosine: ``f(c + w)`` is ``f(c) cos w + f'(c) sin w``, and ``|sin w| <= sinh r``.

    Args:
        name: CasADi's name of f.
        companion: that of its derivative, but for the sign.
    """

    def rule(a: Ball) -> Ball:
        value, slope = getattr(ca, name)(a.centre), getattr(ca, companion)(a.centre)
        sinh, above_one = _hyperbolic(a.radius)
        return nonlinear(value, ca.fabs(slope) * sinh + ca.fabs(value) * above_one)

    return rule


def tangent(a: Ball) -> Ball:
    """``|sin z / (cos c cos(c + z))|``."""
    cosine = pair("cos", "sin")(a)
    size = ca.fabs(cosine.centre)
    sinh, _ = _hyperbolic(a.radius)
    return nonlinear(ca.tan(a.centre), sinh / (size * positive(size - cosine.radius)))


def hyperbolic_tangent(a: Ball) -> Ball:
    """``|sinh z / (cosh c cosh(c + z))|`` ; ``|cosh(u + iv)|^2`` is ``sinh^2 u + cos^2 v``."""
    u, r = ca.fabs(a.centre), a.radius
    # sinh r / cosh u, where neither of the two overflows
    quotient = ca.exp(r - u) * (1.0 - ca.exp(-2.0 * r)) / (1.0 + ca.exp(-2.0 * u))
    grown = ca.exp(ca.fmax(u - r, 0.0))
    sinh = 0.5 * (grown - 1.0 / grown)
    cosine = ca.cos(ca.fmin(r, math.pi / 2))
    return nonlinear(ca.tanh(a.centre), quotient / ca.sqrt(sinh * sinh + cosine * cosine))


def bounded(name: str, radius: Callable[[ca.SX, ca.SX], ca.SX]) -> Rule:
    """A function by its name in CasADi; `radius` bounds how far it goes, from the operand's ball."""
    return lambda a: nonlinear(getattr(ca, name)(a.centre), radius(a.centre, a.radius))


def inverse_hyperbolic(q: ca.SX) -> ca.SX:
    """``atanh q`` or a little more, for q >= 0; infinite or no number from 1 on.

    ``q + q^3/3 + q^5/5 + ...`` is less than ``q + q^3/3 (1 + q^2 + ...)``, and no difference cancels in it.
    """
    return q + q * q * q / (3.0 * positive(1.0 - q * q))
