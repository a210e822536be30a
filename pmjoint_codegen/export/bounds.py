"""Values with bounds on their rounding errors, for any floating-point type and any sound library.

With unit roundoff u, each operation adds ``u |c|`` to the propagated error; a fused multiplication and
addition rounds less often. A function of the C library is taken to be within `ULPS` units in the last place.
So a bound holds whatever the compiler contracts, on host and target. It is computed in double precision from
positive terms; `INFLATION` covers its own roundings. See Higham, Accuracy and Stability of Numerical
Algorithms (2002), 3.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pmjoint_codegen.export.tree import Precision, Tree, number

INFLATION: Final = 1.0 + 2.0**-40
ULPS: Final = 4.0  # of sin, exp and their like
FLAT: Final = 300.0  # beyond, cosh^2 would overflow
EXACT_WHOLE: Final = 2.0**24  # whole numbers up to here are numbers of every type


@dataclass(frozen=True)
class Bounded:
    """What is computed, and how far from the exact value it may be.

    Attributes:
        value: a number or an array, in double precision.
        error: bound, of the same shape.
    """

    value: Any
    error: Any


def relative(error: Any, bound: Any) -> Any:
    """Errors over their bounds: 0 where there is no error, infinite where one is not a number."""
    with np.errstate(all="ignore"):  # 0/0 is a value that both sides have exactly
        ratio = np.where(error > 0.0, error / bound, 0.0)
    return np.where(np.isnan(error) | np.isnan(ratio), np.inf, ratio)


Operation = Callable[..., Any]


def bounded_operations(precision: Precision) -> dict[str, Operation]:
    """Every operation of a tree on `Bounded` values."""
    u, least = precision.roundoff, precision.smallest

    def rounded(value: Any, propagated: Any) -> Bounded:
        error = propagated + u * (abs(value) + 2.0 * propagated) + least
        return Bounded(value, np.where(np.isfinite(value), error * INFLATION, np.inf))

    def called(value: Any, propagated: Any) -> Bounded:
        error = propagated + 2.0 * ULPS * u * (abs(value) + 2.0 * propagated) + least
        return Bounded(value, np.where(np.isfinite(value), error * INFLATION, np.inf))

    def literal(tree: Tree) -> Bounded:
        value = number(tree)
        exact = value.is_integer() and abs(value) <= EXACT_WHOLE
        return Bounded(value, 0.0 if exact else u * abs(value) * INFLATION)

    def product(a: Bounded, b: Bounded) -> Bounded:
        spread = abs(a.value) * b.error + abs(b.value) * a.error + a.error * b.error
        return rounded(a.value * b.value, spread)

    def quotient(a: Bounded, b: Bounded) -> Bounded:
        value, room = a.value / b.value, abs(b.value) - b.error
        spread = np.where(room > 0, (a.error + abs(value) * b.error) / np.where(room > 0, room, 1.0), np.inf)
        return rounded(value, spread)

    def root(a: Bounded) -> Bounded:
        value = np.sqrt(a.value)
        steep = np.where(value > 0, a.error / np.where(value > 0, value, 1.0), np.inf)
        return rounded(value, np.minimum(steep, np.sqrt(a.error)))

    def flat(function: Operation) -> Operation:
        return lambda a: called(function(a.value), a.error)

    def tangent(a: Bounded) -> Bounded:
        cosine = abs(np.cos(a.value))
        steep = np.where(cosine > a.error, a.error / (cosine * (cosine - a.error)), np.inf)
        return called(np.tan(a.value), steep)

    def hyperbolic_tangent(a: Bounded) -> Bounded:
        nearest = np.maximum(abs(a.value) - a.error, 0.0)  # where within the error the slope is greatest
        spread = np.minimum(a.error / np.cosh(np.minimum(nearest, FLAT)) ** 2, 2.0)
        return called(np.tanh(a.value), spread)

    def logarithm(a: Bounded) -> Bounded:
        return called(np.log(a.value), -np.log1p(-np.minimum(a.error / abs(a.value), 1.0)))

    def power(a: Bounded, b: Bounded) -> Bounded:
        value = a.value**b.value
        spread = abs(b.value) * -np.log1p(-np.minimum(a.error / abs(a.value), 1.0))
        spread = spread + b.error * abs(np.log(abs(a.value)))
        return called(value, abs(value) * np.expm1(spread))

    def sign(a: Bounded) -> Bounded:
        return Bounded(np.sign(a.value), np.where((abs(a.value) <= a.error) & (a.error > 0), 2.0, 0.0))

    def between(a: Bounded, low: Bounded, high: Bounded) -> Bounded:
        error = np.maximum(a.error, np.maximum(low.error, high.error))
        return Bounded(np.clip(a.value, low.value, high.value), error)

    return {
        "number": literal,
        "add": lambda a, b: rounded(a.value + b.value, a.error + b.error),
        "sub": lambda a, b: rounded(a.value - b.value, a.error + b.error),
        "neg": lambda a: Bounded(-a.value, a.error),
        "mul": product,
        "div": quotient,
        "sqrt": root,
        "sin": flat(np.sin),
        "cos": flat(np.cos),
        "tanh": hyperbolic_tangent,
        "atan": flat(np.arctan),
        "tan": tangent,
        "exp": lambda a: called(np.exp(a.value), np.exp(a.value) * np.expm1(a.error)),
        "expm1": lambda a: called(np.expm1(a.value), np.exp(a.value) * np.expm1(a.error)),
        "log": logarithm,
        "sinh": lambda a: called(np.sinh(a.value), a.error * np.cosh(abs(a.value) + a.error)),
        "cosh": lambda a: called(np.cosh(a.value), a.error * np.sinh(abs(a.value) + a.error)),
        "pow": power,
        "fmin": lambda a, b: Bounded(np.fmin(a.value, b.value), np.maximum(a.error, b.error)),
        "fmax": lambda a, b: Bounded(np.fmax(a.value, b.value), np.maximum(a.error, b.error)),
        "fabs": lambda a: Bounded(abs(a.value), a.error),
        "between": between,
        "sign": sign,
    }
