"""Rounding errors of single operations: error bounds of a result from those of its operands.

With hats for computed values, ``e`` for bounds on their errors, unit roundoff ``u = 2^-53`` and underflow
``2^-1074``:

    a + b      e_a + e_b + u |c^|                        a b     |a^| e_b + |b^| e_a + e_a e_b + u |c^|
    a / b      (e_a + |c^| e_b) / (|b^| - e_b) + u |c^|  sqrt a  min(e_a / c^, sqrt e_a) + u |c^|
    exp        c^ (exp(e_a) - 1) + ULP                   log     -log(1 - e_a/|a^|) + ULP
    tan        e_a / (|cos a^| (|cos a^| - e_a)) + ULP   min, max  max(e_a, e_b), or that of the one
    tanh       min(e_a / cosh^2(|a^| - e_a), 2) + ULP
    others     e_a times the largest slope + ULP                   chosen, where the bounds leave no doubt

ULP is the accuracy that the C library documents for the function; it and the slope are in the function's row
of the table of operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ROUNDOFF = 2.0**-53
SMALLEST = 2.0**-1074
POWER_ULPS = 1.5  # as of `library`


@dataclass(frozen=True)
class Bounded:
    """Computed values with bounds on their errors; one row per point.

    Attributes:
        value: the code's result.
        error: bound on its distance from the exact value; infinite if none is known.
    """

    value: Array
    error: Array


Rule = Callable[..., tuple[Array, Array]]


def linear(apply: Callable[[Array, Array], Array]) -> Rule:
    """``a + b`` or ``a - b``; exact on underflow."""

    def rule(a: Bounded, b: Bounded) -> tuple[Array, Array]:
        value = apply(a.value, b.value)
        return value, a.error + b.error + ROUNDOFF * np.abs(value)

    return rule


def multiply(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    """``a b``."""
    value = a.value * b.value
    propagated = np.abs(a.value) * b.error + np.abs(b.value) * a.error + a.error * b.error
    exactly_zero = ((a.value == 0) & (a.error == 0)) | ((b.value == 0) & (b.error == 0))
    rounding = ROUNDOFF * np.abs(value) + SMALLEST
    return value, np.where(exactly_zero, 0.0, propagated + rounding)


def divide(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    """``a / b``."""
    value = a.value / b.value
    room = np.abs(b.value) - b.error
    propagated = np.where(
        room > 0, (a.error + (np.abs(value) * (1 + ROUNDOFF) + SMALLEST) * b.error) / room, np.inf
    )
    exactly_zero = (a.value == 0) & (a.error == 0) & (room > 0)
    return value, np.where(exactly_zero, 0.0, propagated + ROUNDOFF * np.abs(value) + SMALLEST)


def root(a: Bounded) -> tuple[Array, Array]:
    """``sqrt a``."""
    value = np.sqrt(a.value)
    propagated = np.minimum(np.where(value > 0, a.error / (value * (1 - ROUNDOFF)), np.inf), np.sqrt(a.error))
    return value, np.where(a.value >= a.error, propagated + ROUNDOFF * value, np.inf)


def extreme(least: bool) -> Rule:
    """The less or the greater of two: a limit far below v passes on nothing of v's error."""

    def rule(a: Bounded, b: Bounded) -> tuple[Array, Array]:
        value = np.fmin(a.value, b.value) if least else np.fmax(a.value, b.value)
        with np.errstate(invalid="ignore"):  # of two infinities; that is a doubt
            ahead = b.value - a.value if least else a.value - b.value
            doubt = (a.error + b.error) * (1 + 8 * ROUNDOFF)
        unclear = np.maximum(a.error, b.error)
        return value, np.where(ahead > doubt, a.error, np.where(-ahead > doubt, b.error, unclear))

    return rule


def _by_library(name: str, *operands: Array) -> Array:
    """The C library's function, which Python's ``math`` calls too; NaN where it is undefined."""
    function: Callable[..., float] = getattr(math, name)

    def evaluate(*numbers: float) -> float:
        try:
            return function(*numbers)
        except (ValueError, OverflowError):
            return math.nan

    return np.array([evaluate(*row) for row in zip(*(array.tolist() for array in operands), strict=True)])


def library(name: str, ulps: float, propagate: Callable[[Array, Array, Array], Array]) -> Rule:
    """A function of the C library.

    Args:
        name: in C and in Python's ``math``.
        ulps: largest error in units in the last place. Of the GNU C Library (2.36:
            sysdeps/x86_64/fpu/libm-test-ulps, and the same for aarch64) it is the listed one plus
            1/2, as the list counts from the rounded value; 1 if none is listed.
        propagate: the propagated error, from the operand, its error and the value.
    """

    def rule(a: Bounded) -> tuple[Array, Array]:
        value = _by_library(name, a.value)
        ulp = 2 * ROUNDOFF * np.abs(value) * (1 + 8 * ROUNDOFF) + SMALLEST
        exact_zero = (value == 0) & (a.value == 0) & (a.error == 0)
        return value, np.where(exact_zero, 0.0, propagate(a.value, a.error, value) + ulps * ulp)

    return rule


def of_tangent(x: Array, e: Array, value: Array) -> Array:
    """Error of tan from that of its operand, without its own rounding."""
    cosine = np.abs(np.cos(x)) * (1 - 8 * ROUNDOFF)
    return np.where(cosine > e, e / (cosine * (cosine - e)), np.inf)


def of_hyperbolic_tangent(x: Array, e: Array, value: Array) -> Array:
    """Error of tanh from that of its operand, without its own rounding: little where tanh is flat."""
    nearest = np.maximum(np.abs(x) * (1 - 8 * ROUNDOFF) - e, 0.0)
    slope = np.square(1 / np.cosh(nearest)) * (1 + 32 * ROUNDOFF)
    return np.minimum(e * slope, 2.0)


def of_logarithm(x: Array, e: Array, value: Array) -> Array:
    """Error of log from that of its operand, without its own rounding."""
    return np.where(x > e, -np.log1p(-e / np.abs(x)) * (1 + 8 * ROUNDOFF), np.inf)


def of_exponential(x: Array, e: Array, value: Array) -> Array:
    """Error of exp from that of its operand, without its own rounding."""
    return value * (1 + 8 * ROUNDOFF) * np.expm1(e) * (1 + 8 * ROUNDOFF)


def power(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    """``a^b`` for a > 0 and an exponent that is a literal."""
    value = _by_library("pow", a.value, b.value)
    logarithm = np.abs(np.log(a.value)) * (1 + 8 * ROUNDOFF)
    spread = (np.abs(b.value) + b.error) * -np.log1p(-a.error / np.abs(a.value)) + b.error * logarithm
    ulp = 2 * ROUNDOFF * np.abs(value) * (1 + 8 * ROUNDOFF) + SMALLEST
    error = np.abs(value) * np.expm1(spread * (1 + 8 * ROUNDOFF)) * (1 + 8 * ROUNDOFF) + POWER_ULPS * ulp
    return value, np.where(a.value > a.error, error, np.inf)


def invert(a: Bounded) -> tuple[Array, Array]:
    """``1 / a``."""
    return divide(Bounded(np.ones_like(a.value), np.zeros_like(a.value)), a)


def above(name: str, x: Array) -> Array:
    """A non-negative function of NumPy's, rounded up."""
    found: Array = getattr(np, name)(x)
    return found * (1 + 16 * ROUNDOFF)
