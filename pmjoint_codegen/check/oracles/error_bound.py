"""How far a kernel's result can be from the exact value: a running error bound, derived, not guessed.

The emitted instruction list is walked at a point. With hats for computed values and ``e`` for bounds on their
errors, each operation adds what its own rounding can do (unit roundoff ``u = 2^-53``; underflow ``2^-1074``)
to what its operands' errors become:

    a + b      e_a + e_b + u |c^|                        a b     |a^| e_b + |b^| e_a + e_a e_b + u |c^|
    a / b      (e_a + |c^| e_b) / (|b^| - e_b) + u |c^|  sqrt a  min(e_a / c^, sqrt e_a) + u |c^|
    sin, cos   e_a + ULP                                 tanh    e_a + ULP
    exp        c^ (exp(e_a) - 1) + ULP                   log     -log(1 - e_a/|a^|) + ULP
    tan        e_a / (|cos a^| (|cos a^| - e_a)) + ULP   min, max  max(e_a, e_b)

Inputs are exact. A literal of the code is a rounded exact number, unless it is a whole number that every
double near it could have been (up to 2^53; beyond, rounded ones are whole too). ULP is the
accuracy that the C library documents for the function. The bound is computed in double precision itself; all
its terms are positive, so its own roundings are covered by one small factor an operation. See Higham,
Accuracy and Stability of Numerical Algorithms (2002), 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.tape import Tape

Array = npt.NDArray[np.float64]

ROUNDOFF = 2.0**-53
SMALLEST = 2.0**-1074
INFLATION = 1 + 32 * ROUNDOFF  # each rule below rounds fewer than 16 times
LITERAL_ROUNDINGS = (
    4  # a literal may be a quotient of rounded numbers that were folded when the code was made
)

# Largest known errors in ULP of the GNU C Library (2.36: sysdeps/x86_64/fpu/libm-test-ulps, and the same for
# aarch64): 1, of tanh 2; of tan none is listed. And 1/2 more: the list counts from the rounded value.
LIBRARY_ULP: Mapping[str, float] = {
    "sin": 1.5,
    "cos": 1.5,
    "tan": 1.5,
    "exp": 1.5,
    "log": 1.5,
    "pow": 1.5,
    "tanh": 2.5,
}


@dataclass(frozen=True)
class Bounded:
    """Computed values with bounds on their errors; one row a point.

    Attributes:
        value: what the code computes.
        error: how far that can be from the exact value; infinite where the walk cannot tell.
    """

    value: Array
    error: Array


def walk(tape: Tape, arguments: Sequence[Array], literal_roundings: int = LITERAL_ROUNDINGS) -> list[Bounded]:
    """Evaluate an instruction list with bounds.

    Args:
        tape: the kernel's instructions.
        arguments: one for each input, shape (points, size); exact.
        literal_roundings: how many roundings a literal may hold; a Taylor kernel's ``1/k!`` is folded factor
            by factor.

    Returns:
        One for each output, arrays of shape (points, size).
    """
    points = len(arguments[0])
    outputs = [Bounded(np.zeros((points, size)), np.zeros((points, size))) for _, size in tape.outputs]
    values: list[Bounded] = []
    rules = _rules()
    with np.errstate(all="ignore"):
        for item in tape.instructions:
            if item.operation == "output":
                result, entry, place = item.operands
                outputs[result].value[:, entry] = values[place].value
                outputs[result].error[:, entry] = values[place].error
            elif item.operation == "input":
                block, entry = item.operands
                values.append(Bounded(arguments[block][:, entry], np.zeros(points)))
            elif item.operation == "const":
                values.append(_literal(item.value, points, literal_roundings))
            else:
                values.append(_operate(rules[item.operation], [values[place] for place in item.operands]))
    return outputs


Rule = Callable[..., tuple[Array, Array]]


def _operate(rule: Rule, operands: list[Bounded]) -> Bounded:
    value, error = rule(*operands)
    finite = np.isfinite(value) & ~np.isnan(error)
    return Bounded(value, np.where(finite, error * INFLATION, np.inf))


def _literal(value: float, points: int, roundings: int) -> Bounded:
    exact = float(value).is_integer() and abs(value) <= 2.0**53  # beyond, a rounded number is whole as well
    error = 0.0 if exact else roundings * ROUNDOFF * abs(value) * INFLATION
    return Bounded(np.full(points, float(value)), np.full(points, error))


def _sum(a: Bounded, b: Bounded, sign: float) -> tuple[Array, Array]:
    value = a.value + sign * b.value
    return value, a.error + b.error + ROUNDOFF * np.abs(value)  # a sum that underflows is exact


def _product(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    value = a.value * b.value
    propagated = np.abs(a.value) * b.error + np.abs(b.value) * a.error + a.error * b.error
    exactly_zero = ((a.value == 0) & (a.error == 0)) | ((b.value == 0) & (b.error == 0))
    rounding = ROUNDOFF * np.abs(value) + SMALLEST
    return value, np.where(exactly_zero, 0.0, propagated + rounding)


def _quotient(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    value = a.value / b.value
    room = np.abs(b.value) - b.error
    propagated = np.where(
        room > 0, (a.error + (np.abs(value) * (1 + ROUNDOFF) + SMALLEST) * b.error) / room, np.inf
    )
    exactly_zero = (a.value == 0) & (a.error == 0) & (room > 0)
    return value, np.where(exactly_zero, 0.0, propagated + ROUNDOFF * np.abs(value) + SMALLEST)


def _root(a: Bounded) -> tuple[Array, Array]:
    value = np.sqrt(a.value)
    propagated = np.minimum(np.where(value > 0, a.error / (value * (1 - ROUNDOFF)), np.inf), np.sqrt(a.error))
    return value, np.where(a.value >= a.error, propagated + ROUNDOFF * value, np.inf)


def _by_library(name: str, a: Array) -> Array:
    """The C library's function, which Python's ``math`` calls too; NaN where it has no value."""
    function: Callable[[float], float] = getattr(math, name)

    def evaluate(x: float) -> float:
        try:
            return function(x)
        except (ValueError, OverflowError):
            return math.nan

    return np.array([evaluate(x) for x in a.tolist()])


def _library(name: str, propagate: Callable[[Array, Array, Array], Array]) -> Rule:
    """A function of the C library; ``propagate`` takes operand, its error and the value."""

    def rule(a: Bounded) -> tuple[Array, Array]:
        value = _by_library(name, a.value)
        ulp = 2 * ROUNDOFF * np.abs(value) * (1 + 8 * ROUNDOFF) + SMALLEST
        exact_zero = (value == 0) & (a.value == 0) & (a.error == 0)
        return value, np.where(exact_zero, 0.0, propagate(a.value, a.error, value) + LIBRARY_ULP[name] * ulp)

    return rule


def _lipschitz_error(x: Array, e: Array, value: Array) -> Array:
    """Of functions whose slope is at most 1."""
    return e


def _tangent_error(x: Array, e: Array, value: Array) -> Array:
    cosine = np.abs(np.cos(x)) * (1 - 8 * ROUNDOFF)
    return np.where(cosine > e, e / (cosine * (cosine - e)), np.inf)


def _logarithm_error(x: Array, e: Array, value: Array) -> Array:
    return np.where(x > e, -np.log1p(-e / np.abs(x)) * (1 + 8 * ROUNDOFF), np.inf)


def _exponential_error(x: Array, e: Array, value: Array) -> Array:
    return value * (1 + 8 * ROUNDOFF) * np.expm1(e) * (1 + 8 * ROUNDOFF)


def _power(a: Bounded, b: Bounded) -> tuple[Array, Array]:
    """``a^b`` for a > 0 and an exponent that is a literal."""
    value = np.array([_safe_power(x, y) for x, y in zip(a.value.tolist(), b.value.tolist(), strict=True)])
    logarithm = np.abs(np.log(a.value)) * (1 + 8 * ROUNDOFF)
    spread = (np.abs(b.value) + b.error) * -np.log1p(-a.error / np.abs(a.value)) + b.error * logarithm
    ulp = 2 * ROUNDOFF * np.abs(value) * (1 + 8 * ROUNDOFF) + SMALLEST
    error = (
        np.abs(value) * np.expm1(spread * (1 + 8 * ROUNDOFF)) * (1 + 8 * ROUNDOFF) + LIBRARY_ULP["pow"] * ulp
    )
    return value, np.where(a.value > a.error, error, np.inf)


def _safe_power(x: float, y: float) -> float:
    try:
        return math.pow(x, y)
    except (ValueError, OverflowError):
        return math.nan


def _one(like: Bounded) -> Bounded:
    return Bounded(np.ones_like(like.value), np.zeros_like(like.value))


def _largest_error(a: Bounded, b: Bounded) -> Array:
    return np.maximum(a.error, b.error)


def _rules() -> Mapping[str, Rule]:
    """A rule for every operation of a tape."""
    return {
        "neg": lambda a: (-a.value, a.error),
        "twice": lambda a: (2 * a.value, 2 * a.error),
        "add": lambda a, b: _sum(a, b, 1.0),
        "sub": lambda a, b: _sum(a, b, -1.0),
        "mul": _product,
        "sq": lambda a: _product(a, a),
        "div": _quotient,
        "inv": lambda a: _quotient(_one(a), a),
        "sqrt": _root,
        "sin": _library("sin", _lipschitz_error),
        "cos": _library("cos", _lipschitz_error),
        "tanh": _library("tanh", _lipschitz_error),
        "tan": _library("tan", _tangent_error),
        "exp": _library("exp", _exponential_error),
        "log": _library("log", _logarithm_error),
        "pow": _power,
        "fabs": lambda a: (np.abs(a.value), a.error),
        "sign": lambda a: (np.sign(a.value), np.where(np.abs(a.value) <= a.error, 2.0, 0.0)),
        "fmin": lambda a, b: (np.fmin(a.value, b.value), _largest_error(a, b)),
        "fmax": lambda a, b: (np.fmax(a.value, b.value), _largest_error(a, b)),
    }
