"""Kinks: where the plant's rates are not smooth. Their arguments become events of the loops."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

from pmjoint_derive import Equations


def kink_arguments(rates: Iterable[sp.Symbol], equations: Equations) -> tuple[sp.Expr, ...]:
    """Arguments of ``abs`` and ``sign`` in rates and in what these are defined by, inner ones first."""
    found: dict[sp.Expr, None] = {}
    seen: set[sp.Basic] = set()

    def visit(expression: sp.Basic) -> None:
        if expression in seen:
            return
        seen.add(expression)
        if expression.is_Symbol:
            if expression.name in equations:
                visit(equations[expression.name].expression)
            return
        for argument in expression.args:
            visit(argument)
        if isinstance(expression, sp.Abs | sp.sign):
            found.setdefault(expression.args[0])

    for rate in rates:
        visit(rate)
    return tuple(found)
