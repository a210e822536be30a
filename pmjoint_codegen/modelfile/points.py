"""Values of expressions at single points, to 40 digits and more, within the range of doubles.

SymPy's own substitution would raise exact numbers to any power that a parameter's value asks for; here every
intermediate result is a floating-point number whose size is checked before it is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mpmath
import sympy as sp

_DIGITS = 40
_LARGEST = 1.7e308  # the largest value of a double, and so of the generated code

Point = Mapping[sp.Symbol, float]


class NotFiniteError(ArithmeticError):
    """The expression, or a part of it, has no finite real value there."""


def value_at(expression: sp.Expr, point: Point) -> float:
    """Value of an expression at a point, 0.0 where it cancels; raises `NotFiniteError`.

    Computing twice distinguishes cancellation from a small value: rounding noise shrinks with precision.
    """
    coarse = _evaluate(expression, point, _context(_DIGITS))
    fine = _evaluate(expression, point, _context(2 * _DIGITS))
    return 0.0 if abs(fine) <= abs(coarse) / 2 else float(fine)


def _context(digits: int) -> Any:
    context = mpmath.MPContext()  # separate: the precision of mpmath's shared context is global state
    context.dps = digits
    return context


def _evaluate(expression: sp.Expr, point: Point, context: Any) -> Any:
    """Evaluate from the leaves up."""
    if not expression.args:
        leaf = point[expression] if expression.is_Symbol else expression.evalf(context.dps)
        return context.mpf(leaf)
    parts = [_evaluate(part, point, context) for part in expression.args]
    try:
        value = _combine(expression, parts, context)
    except (ArithmeticError, ValueError):
        raise NotFiniteError from None
    if not isinstance(value, context.mpf) or not abs(value) < _LARGEST:
        raise NotFiniteError
    return value


def _combine(expression: sp.Expr, parts: list[Any], context: Any) -> Any:
    if expression.is_Add:
        return context.fsum(parts)
    if expression.is_Mul:
        return context.fprod(parts)
    if expression.is_Pow:
        return parts[0] ** parts[1]
    name = type(expression).__name__
    return getattr(context, "fabs" if name == "Abs" else name)(*parts)
