"""Algebra that leaves functions as written.

Multiplying out is exact for symbols and ruinous for doubles: SymPy's `expand` turns ``exp(-(y - 30)**2)``
into ``exp(-900) exp(60 y) exp(-y**2)``, which is 0 in double precision, and ``(y - 1000)**8`` into terms that
cancel. So every argument of a function, and every power of a sum of moving quantities, is replaced by a
symbol while the rest is rearranged.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import sympy as sp


def shielded(
    transform: Callable[[sp.Expr], sp.Expr], value: sp.Expr, moving: Collection[sp.Symbol]
) -> sp.Expr:
    """Rearrange an expression without changing functions and powers of sums.

    Args:
        transform: such as `sympy.expand` or `sympy.factor`.
        value: what to rearrange.
        moving: symbols whose values change along a run; sums without them, of gains, are no concern.
    """
    hidden: dict[sp.Expr, sp.Symbol] = {}
    moves = frozenset(moving)

    def hide(part: sp.Basic) -> sp.Basic:
        if _is_opaque(part, moves):
            return hidden.setdefault(part, sp.Symbol(f"opaque {len(hidden)}", real=True))
        return part.func(*map(hide, part.args)) if part.args else part

    rearranged = transform(hide(sp.sympify(value)))
    return rearranged.xreplace({name: part for part, name in hidden.items()})


def multiplied_out(value: sp.Expr, moving: Collection[sp.Symbol]) -> sp.Expr:
    """Sums and products multiplied out, functions and powers of sums as they are written."""
    return shielded(sp.expand, value, moving)


def _is_opaque(part: sp.Basic, moving: frozenset[sp.Symbol]) -> bool:
    if isinstance(part, sp.Function):
        return bool(part.free_symbols)
    if not isinstance(part, sp.Pow) or part.base.is_Symbol:
        return isinstance(part, sp.Pow) and bool(part.exp.free_symbols)
    return bool(part.free_symbols & moving) or not part.exp.is_Integer
