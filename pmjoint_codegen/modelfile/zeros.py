"""Whether a function of y vanishes somewhere in a range, decided by interval arithmetic and bisection.

An interval's image without 0 proves that there is no zero in it; two signs at its ends show that there is
one, or a pole. An undecided interval is halved. So None is a proof; an undecided range counts as one with a
zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mpmath
import sympy as sp

from pmjoint_codegen.modelfile.points import NotFiniteError, value_at
from pmjoint_codegen.operations import Operation, by_sympy

_MOST_INTERVALS = 4000
_DIGITS = 30


def find_zero(
    expression: sp.Expr, variable: sp.Symbol, values: Mapping[sp.Symbol, float], low: float, high: float
) -> float | None:
    """Give a place in [low, high] at or near which an expression vanishes or is not finite, or None.

    Args:
        expression: of `variable` and the symbols in `values`.
        variable: what runs over the range.
        values: of all other symbols.
        low: lower end, inclusive.
        high: upper end, inclusive.
    """
    context = mpmath.ctx_iv.MPIntervalContext()  # separate, for the same reason as in `points`
    context.dps = _DIGITS
    pending = [(low, high)]
    for _ in range(_MOST_INTERVALS):
        if not pending:
            return None
        left, right = pending.pop()
        if _excludes_zero(expression, {**values, variable: (left, right)}, context):
            continue
        middle = left + (right - left) / 2
        if _changes_sign(expression, variable, values, left, right) or not left < middle < right:
            return _narrowed(expression, variable, values, left, right)
        pending += [(middle, right), (left, middle)]
    return pending[-1][0] if pending else None


def _excludes_zero(
    expression: sp.Expr, point: Mapping[sp.Symbol, float | tuple[float, float]], context: Any
) -> bool:
    try:
        image = _image(expression, point, context)
    except (ArithmeticError, ValueError, NotImplementedError):
        return False
    return bool(image.a > 0 or image.b < 0) and not (mpmath.isinf(image.a) or mpmath.isinf(image.b))


def _image(expression: sp.Expr, point: Mapping[sp.Symbol, Any], context: Any) -> Any:
    """An interval that holds every value of the expression."""
    if expression.is_Symbol:
        value = point[expression]
        return context.mpf(list(value) if isinstance(value, tuple) else value)
    if expression.is_Rational:
        return context.mpf(int(expression.p)) / context.mpf(int(expression.q))
    if not expression.args:
        return context.pi if expression == sp.pi else context.e
    parts = [_image(part, point, context) for part in expression.args]
    if expression.is_Add or expression.is_Mul:
        total = parts[0]
        for part in parts[1:]:
            total = total + part if expression.is_Add else total * part
        return total
    if expression.is_Pow:
        exponent = expression.exp
        return parts[0] ** int(exponent) if exponent.is_Integer else _real_power(parts, context)
    operation = by_sympy()[type(expression).__name__]
    if operation.enclosure:
        return operation.enclosure(context, parts[0])
    if operation.rises:
        return _between_ends(operation, parts[0], context)
    return operation.of(context)(*parts)


def _between_ends(operation: Operation, interval: Any, context: Any) -> Any:
    """The image of an interval under an increasing function: from end to end, rounded outwards."""
    numbers = mpmath.MPContext()
    numbers.dps = 2 * _DIGITS
    ends = [operation.of(numbers)(numbers.mpf(end)) for end in (interval.a.a, interval.b.b)]
    rounding = context.mpf([-1, 1]) * context.mpf(10) ** -_DIGITS
    return context.mpf(ends) * (1 + rounding) + rounding


def _real_power(parts: list[Any], context: Any) -> Any:
    """``base ** exponent`` for a positive base."""
    base, exponent = parts
    if not base.a > 0:
        raise ValueError("the base may be negative")
    return context.exp(exponent * context.log(base))


def _changes_sign(
    expression: sp.Expr, variable: sp.Symbol, values: Mapping[sp.Symbol, float], left: float, right: float
) -> bool:
    try:
        ends = [value_at(expression, {**values, variable: place}) for place in (left, right)]
    except NotFiniteError:
        return False
    return min(ends) <= 0 <= max(ends)


def _narrowed(
    expression: sp.Expr, variable: sp.Symbol, values: Mapping[sp.Symbol, float], left: float, right: float
) -> float:
    """Where in an interval the expression is 0 or changes sign, to six digits; its middle, if nowhere."""
    while right - left > 1e-7 * max(abs(left), abs(right), 1e-3):
        middle = left + (right - left) / 2
        if _changes_sign(expression, variable, values, left, middle):
            right = middle
        elif _changes_sign(expression, variable, values, middle, right):
            left = middle
        else:
            return middle
    return right if _changes_sign(expression, variable, values, right, right) else left
