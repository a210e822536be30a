"""Kinks: where the plant's rates are not smooth. Their arguments become events of the loops."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_derive import Equations

_INNER = 6  # kinks inside a sign whose sides are all tried


def kink_arguments(
    rates: Iterable[sp.Symbol], equations: Equations, given: Iterable[sp.Symbol] = ()
) -> tuple[sp.Expr, ...]:
    """Arguments of ``abs`` and ``sign`` in rates and in the equations that define them, inner ones first.

    Args:
        rates: names of the rates.
        equations: the named equations.
        given: names whose equations the rates do not see, since the loops give their values: the actuator's.

    Raises:
        ModelError: a ``sign`` whose argument is 0 over an interval: the loops know two sides.
    """
    found: dict[sp.Expr, None] = {}
    seen: set[sp.Basic] = set(given)

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
        if isinstance(expression, sp.sign) and _vanishes(expression.args[0]):
            raise ModelError(
                f"{expression} is 0 over an interval",
                where="disturbance",
                remedy="write a step at t0 as (1 + sign(t - t0))/2",
            )
        if isinstance(expression, sp.Abs | sp.sign):
            found.setdefault(expression.args[0])

    for rate in rates:
        visit(rate)
    return tuple(found)


def _vanishes(argument: sp.Expr) -> bool:
    """Whether some sides of the kinks inside make an expression 0 everywhere."""
    inner = sorted(argument.atoms(sp.Abs, sp.sign), key=lambda kink: (sp.count_ops(kink), str(kink)))
    arguments = list(dict.fromkeys(kink.args[0] for kink in inner))
    if not arguments or len(arguments) > _INNER:
        return False
    for sides in product((1, -1), repeat=len(arguments)):
        side = dict(zip(arguments, sides, strict=True))
        plain = {
            kink: side[kink.args[0]] * (kink.args[0] if isinstance(kink, sp.Abs) else 1) for kink in inner
        }
        found = argument
        for kink in reversed(inner):  # outer ones first, as inner ones stand in their arguments
            found = found.subs(kink, plain[kink])
        if sp.expand(found) == 0:
            return True
    return False
