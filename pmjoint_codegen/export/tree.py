"""Expressions as trees of elementary operations, in the order in which the exported C computes them.

A tree is made from a SymPy expression once. C text, error bounds and exact values all come from it, so they
speak of the same operations. Nothing here uses CasADi: exported C and emitted kernels share the equations
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.operations import by_sympy, remedy


@dataclass(frozen=True)
class Tree:
    """One operation, or a leaf.

    Attributes:
        operation: a name of `pmjoint_codegen.operations`, or ``number``, ``name`` or ``between``.
        parts: operands.
        leaf: the number or the symbol.
    """

    operation: str
    parts: tuple[Tree, ...] = ()
    leaf: sp.Expr | None = None


@dataclass(frozen=True)
class Precision:
    """The floating-point type of the exported code.

    Attributes:
        name: in C.
        suffix: of literals and of functions of the C library.
        roundoff: unit roundoff.
        smallest: the least positive number.
    """

    name: str
    suffix: str
    roundoff: float
    smallest: float

    def literal(self, value: float) -> str:
        """A literal that reads back as the number of this type nearest to ``value``.

        Raises:
            ModelError: it is too large for this type, or no number.
        """
        with np.errstate(over="ignore"):
            nearest = np.float32(value) if self.suffix else np.float64(value)
        if not np.isfinite(nearest):
            raise ModelError(
                f"{value:g} is no finite number of the C type {self.name}",
                where="export",
                remedy="give --precision double" if np.isfinite(value) else "give finite parameters",
            )
        text = str(nearest)
        return (text if "." in text or "e" in text else f"{text}.0") + self.suffix


DOUBLE: Final = Precision("double", "", 2.0**-53, 2.0**-1074)
FLOAT: Final = Precision("float", "f", 2.0**-24, 2.0**-149)
_LEVEL: Final = {"add": 1, "sub": 1, "mul": 2, "div": 2, "neg": 3}  # how tightly each binds in C
_SIGNS: Final = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_ATOM: Final = 4
_OWN: Final = {"sign": "sign_of", "between": "between"}  # functions that the exported C has itself


class Between(sp.Function):  # type: ignore[misc]  # SymPy carries no types
    """``Between(x, low, high)``: x, within two numbers; a NaN stays."""

    nargs = 3


def bounded_from_both_sides(value: sp.Expr) -> sp.Expr:
    """``Max(low, Min(x, high))`` of two numbers as `Between`, which costs no call of the C library."""
    if not (value.func is sp.Max and len(value.args) == 2):
        return value
    low, inner = sorted(value.args, key=lambda part: not part.is_number)
    if not (low.is_number and inner.func is sp.Min and len(inner.args) == 2):
        return value
    high, x = sorted(inner.args, key=lambda part: not part.is_number)
    return Between(x, low, high) if high.is_number and not x.is_number else value


def name(symbol: sp.Symbol) -> Tree:
    """A leaf that is a symbol."""
    return Tree("name", leaf=symbol)


def tree_of(value: sp.Expr) -> Tree:
    """The tree of an expression: integer powers become products, quotients stay quotients.

    Raises:
        ModelError: for a function that C has no spelling for.
    """
    if value.is_Symbol:
        return name(value)
    if value.is_number and (value.is_Rational or value.is_Float or value.is_NumberSymbol):
        return Tree("neg", (tree_of(-value),)) if value.is_negative else Tree("number", leaf=value)
    if value.is_Add:
        return joined(ordered(value))
    if value.is_Mul:
        return _product(value)
    if value.is_Pow:
        return _power(value.base, value.exp)
    if value.func is Between:
        return Tree("between", tuple(tree_of(part) for part in value.args))
    operation = by_sympy().get(value.func.__name__)
    if operation is None:
        raise ModelError(f"no C can evaluate {value.func.__name__}(...)", where="export", remedy=remedy())
    parts = [tree_of(part) for part in value.args]
    if operation.arity == 1:
        return Tree(operation.name, (parts[0],))
    return _chain(operation.name, parts)


def ordered(value: sp.Expr) -> list[sp.Expr]:
    """The terms of a sum in the order in which they are added: those with a minus sign come last."""
    return sorted(value.as_ordered_terms(), key=lambda term: bool(term.could_extract_minus_sign()))


def joined(terms: list[sp.Expr]) -> Tree:
    """A sum of terms, added from left to right."""
    total = tree_of(terms[0])
    for term in terms[1:]:
        if term.could_extract_minus_sign():
            total = Tree("sub", (total, tree_of(-term)))
        else:
            total = Tree("add", (total, tree_of(term)))
    return total


def _chain(operation: str, parts: list[Tree]) -> Tree:
    total = parts[0]
    for part in parts[1:]:
        total = Tree(operation, (total, part))
    return total


def _product(value: sp.Expr) -> Tree:
    """Numerator factors over denominator factors."""
    if value.could_extract_minus_sign():
        return Tree("neg", (tree_of(-value),))
    above: list[sp.Expr] = []
    below: list[sp.Expr] = []
    for factor in value.as_ordered_factors():
        if factor.is_Rational:
            above += [sp.Integer(factor.p)] if factor.p != 1 else []
            below += [sp.Integer(factor.q)] if factor.q != 1 else []
        elif factor.is_Pow and factor.base != sp.E and factor.exp.is_Rational and factor.exp < 0:
            below.append(factor.base**-factor.exp)
        else:
            above.append(factor)
    numerator = _chain("mul", [tree_of(factor) for factor in above or [sp.Integer(1)]])
    if not below:
        return numerator
    return Tree("div", (numerator, _chain("mul", [tree_of(factor) for factor in below])))


def _power(base: sp.Expr, exponent: sp.Expr) -> Tree:
    one = tree_of(sp.Integer(1))
    if base == sp.E:
        return Tree("exp", (tree_of(exponent),))
    if exponent.is_Rational and exponent.q in (1, 2, 4):
        root = tree_of(base)
        for _ in range({1: 0, 2: 1, 4: 2}[int(exponent.q)]):
            root = Tree("sqrt", (root,))
        magnitude = _integer_power(root, abs(int(exponent.p)))
        return magnitude if exponent > 0 else Tree("div", (one, magnitude))
    return Tree("pow", (tree_of(base), tree_of(exponent)))


def _integer_power(base: Tree, exponent: int) -> Tree:
    if exponent == 1:
        return base
    half = _integer_power(base, exponent // 2)
    square = Tree("mul", (half, half))
    return square if exponent % 2 == 0 else Tree("mul", (square, base))


def c_text(tree: Tree, spelling: Mapping[sp.Symbol, str], precision: Precision) -> str:
    """The tree in C.

    Args:
        tree: what to print.
        spelling: of each symbol, such as ``s->xi1``.
        precision: type of literals and functions.

    Raises:
        KeyError: for a symbol without a spelling.
    """
    text, _ = _printed(tree, spelling, precision)
    return text


def _printed(tree: Tree, spelling: Mapping[sp.Symbol, str], precision: Precision) -> tuple[str, int]:
    """Text and how tightly it binds."""
    if tree.operation == "number":
        return precision.literal(number(tree)), _ATOM
    if tree.operation == "name":
        return spelling[tree.leaf], _ATOM
    printed = [_printed(part, spelling, precision) for part in tree.parts]
    level = _LEVEL.get(tree.operation)
    if level is None:
        function = _OWN.get(tree.operation, tree.operation + precision.suffix)
        return f"{function}({', '.join(text for text, _ in printed)})", _ATOM
    if tree.operation == "neg":
        inner, binds = printed[0]
        # The sign of a product is that of its first factor, to the bit; two signs in a row would decrement.
        return (f"-{inner}", binds) if binds in (_LEVEL["mul"], _ATOM) else (f"-({inner})", level)
    # C groups a - b - c from the left; what stands on the right must bind more tightly. A product in a sum is
    # bracketed although C does not need it: reviewers of embedded code do (MISRA C:2012, rule 12.1).
    mixed = _ATOM if level == _LEVEL["add"] else level
    left = _bracketed(printed[0], mixed if printed[0][1] == _LEVEL["mul"] else level)
    return f"{left} {_SIGNS[tree.operation]} {_bracketed(printed[1], max(mixed, level + 1))}", level


def _bracketed(printed: tuple[str, int], least: int) -> str:
    text, level = printed
    return text if level >= least else f"({text})"


def number(tree: Tree) -> float:
    """The double nearest to a leaf that is a number.

    Raises:
        ModelError: it overflows.
    """
    value: Any = tree.leaf
    try:
        return float(value.p / value.q) if value.is_Rational else float(value)
    except OverflowError:
        raise ModelError(
            "a number, or its inverse, overflows floating point",
            where="export",
            remedy="allowed: magnitudes from 1e-300 to 1e300",
        ) from None


def evaluated(tree: Tree, values: Mapping[sp.Symbol, Any], table: Mapping[str, Callable[..., Any]]) -> Any:
    """The tree's value in some arithmetic.

    Args:
        tree: what to evaluate.
        values: of its symbols.
        table: the operations by name; ``number`` makes one from a leaf.
    """
    if tree.operation == "name":
        return values[tree.leaf]
    if tree.operation == "number":
        return table["number"](tree)
    return table[tree.operation](*(evaluated(part, values, table) for part in tree.parts))


def operations_in(tree: Tree) -> set[str]:
    """Names of the operations in a tree."""
    return {tree.operation}.union(*(operations_in(part) for part in tree.parts))
