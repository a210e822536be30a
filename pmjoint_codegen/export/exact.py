"""The same operations to many digits, and the exact hold to as many."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, Final

import mpmath

from pmjoint_codegen.export.tree import Tree

DIGITS: Final = 50


def exact_operations(context: Any) -> dict[str, Any]:
    """Every operation of a tree on numbers of an mpmath context."""

    def literal(tree: Tree) -> Any:
        value = tree.leaf
        assert value is not None
        return context.mpf(int(value.p)) / int(value.q) if value.is_Rational else context.mpf(float(value))

    named = (
        "sqrt",
        "sin",
        "cos",
        "tan",
        "exp",
        "expm1",
        "log",
        "tanh",
        "atan",
        "sinh",
        "cosh",
        "fabs",
        "sign",
    )
    return {
        "number": literal,
        "add": operator.add,
        "sub": operator.sub,
        "neg": operator.neg,
        "mul": operator.mul,
        "div": operator.truediv,
        "pow": operator.pow,
        "fmin": min,
        "fmax": max,
        "between": lambda value, low, high: max(low, min(value, high)),
        **{name: getattr(context, name) for name in named},
    }


def exact_hold(context: Any, A: Sequence[Sequence[Any]], T: Any) -> tuple[Any, Any]:
    """``expm(A T)`` and its integral from 0 to T: the blocks of one exponential (Van Loan 1978)."""
    n = len(A)
    whole = context.zeros(2 * n)
    for i in range(n):
        for j in range(n):
            whole[i, j] = A[i][j] * T
        whole[i, n + i] = T
    found = context.expm(whole, method="taylor")
    rows = range(n)
    return (
        [[found[i, j] for j in rows] for i in rows],
        [[found[i, n + j] for j in rows] for i in rows],
    )


def context() -> Any:
    """An mpmath context of its own, so that nobody else's precision changes."""
    made = mpmath.mp.clone()
    made.dps = DIGITS
    return made
