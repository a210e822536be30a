"""Whether an expression vanishes identically, decided by algebra."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.equation import real_symbol

_SIGMA = real_symbol("sigma(y)")  # with brackets: a parameter may be called sigma


def expand_to_zero(expression: sp.Expr, sigma: sp.Expr) -> sp.Expr:
    """Expand polynomials and quotients of functions of y; 0 exactly when the expression vanishes identically.

    Args:
        expression: what should vanish.
        sigma: the input nonlinearity. Where it is a sum, it stands for itself as one symbol first, as
            products by it and quotients of it then cancel without a common denominator.

    Returns:
        0, or the remainder.
    """
    whole = expression.xreplace({sigma: _SIGMA}) if sigma.is_Add else expression
    rest = sp.expand(whole)
    if rest == 0:
        return sp.Integer(0)
    for closed in (_closed(whole.xreplace({_SIGMA: sigma})), rest.xreplace({_SIGMA: sigma})):
        if sp.expand(sp.fraction(sp.together(closed))[0]) == 0:
            return sp.Integer(0)
    return rest


def _closed(value: sp.Expr) -> sp.Expr:
    """The same with a symbol for each function: exponentials that `expand` splits do not all meet again."""
    found = sorted(value.atoms(sp.Function), key=lambda part: (-part.count_ops(), str(part)))
    for number, part in enumerate(found):
        value = value.xreplace({part: real_symbol(f"function({number})")})
    return value
