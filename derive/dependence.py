"""Whether an expression depends on a symbol, decided by its values.

SymPy's own answer needs a simplification, whose time has no bound. Here an expression is evaluated with 60
digits at drawn points, two of which differ in that symbol alone. Values that agree to 30 digits at every pair
show, in all but contrived cases, that it is free of the symbol; it then equals itself with a number in the
symbol's place, exactly. An analytic function that is not free of it takes the same value on a set of
measure zero only.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import reduce
from operator import add, mul
from typing import Any

import mpmath
import sympy as sp

_DIGITS, _AGREE = 60, 30
_POINTS = 3
_LARGEST = 10**6  # binary digits before the point: towers of exponentials would never end


def settled(value: sp.Expr, moving: Iterable[sp.Symbol]) -> sp.Expr:
    """An expression without those of some symbols that only seem to be in it; 0 where it is 0.

    Args:
        value: of real symbols; analytic.
        moving: symbols to look at.
    """
    if not value.free_symbols:
        return value
    if vanishes(value):
        return sp.Integer(0)
    for symbol in sorted(value.free_symbols & set(moving), key=str):
        if symbol in value.free_symbols and not depends(value, symbol):
            value = _without(value, symbol)
    return value


def vanishes(value: sp.Expr) -> bool:
    """Whether an expression is 0 whatever its symbols are."""
    context, seen = _context(), False
    for point in _points(value, context):
        with suppress(ArithmeticError, ValueError):  # a pole, or a number too large to compute with
            found, size = _evaluated(value, point, context)
            seen = True
            if not abs(found) <= size * context.mpf(10) ** -_AGREE:
                return False
    return seen


def depends(value: sp.Expr, symbol: sp.Symbol) -> bool:
    """Whether an expression changes with a symbol."""
    if symbol not in value.free_symbols:
        return False
    context, seen = _context(), False
    for point in _points(value, context):
        moved = {**point, symbol: point[symbol] + context.mpf(1) / 3}
        with suppress(ArithmeticError, ValueError):
            (one, size), (other, more) = (_evaluated(value, place, context) for place in (point, moved))
            seen = True
            if not abs(one - other) <= max(size, more) * context.mpf(10) ** -_AGREE:
                return True
    return not seen


def _context() -> Any:
    context = mpmath.MPContext()  # its own, since mpmath's is everybody's
    context.dps = _DIGITS
    return context


def _points(value: sp.Expr, context: Any) -> Iterable[dict[sp.Symbol, Any]]:
    """Drawn values of every symbol, the same in every run."""
    draw = random.Random(1)
    symbols = sorted(value.free_symbols, key=str)
    for _ in range(_POINTS):
        yield {symbol: context.mpf(draw.randint(10**8, 10**9)) / 7**10 for symbol in symbols}


def _evaluated(value: sp.Expr, point: Mapping[sp.Symbol, Any], context: Any) -> tuple[Any, Any]:
    """The value, and the size of the largest number that a sum in it adds up."""
    known: dict[sp.Basic, Any] = dict(point)
    largest = context.mpf(1)

    def visit(part: sp.Basic) -> Any:
        nonlocal largest
        if part not in known:
            known[part] = found = _computed(part, [visit(entry) for entry in part.args], context)
            if context.mag(found) > _LARGEST:
                raise OverflowError
            largest = max(largest, abs(found))
        return known[part]

    return visit(value), largest


def _computed(part: sp.Basic, operands: list[Any], context: Any) -> Any:
    if part.is_Rational:
        return context.mpf(int(part.p)) / int(part.q)
    if part.is_Add:
        return reduce(add, operands)
    if part.is_Mul:
        return reduce(mul, operands)
    if part.is_Pow:
        return operands[0] ** (int(part.exp) if part.exp.is_Integer else operands[1])
    if part == sp.pi:
        return +context.pi
    if part == sp.E:
        return +context.e
    return getattr(context, {"Abs": "fabs"}.get(type(part).__name__, type(part).__name__))(*operands)


def _without(value: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """The same with a number in the place of a symbol that it is free of."""
    for number in map(sp.Integer, (0, 1, 2)):
        found = value.xreplace({symbol: number})
        if not found.has(sp.zoo, sp.nan, sp.oo, -sp.oo):
            return found
    return value
