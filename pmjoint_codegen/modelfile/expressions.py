"""Expressions of a model file, from text to SymPy, through a whitelist.

Python's own parser gives the syntax tree; each of its nodes is then built by hand or refused, so nothing is
ever evaluated as code. Size, depth and powers are bounded *before* SymPy sees them, since ``9**9**9**9`` is a
short text and an endless number: each constant part must first be finite and real in doubles.
Decimal literals become exact fractions (0.1 is 1/10), so that identities of the derivation hold exactly.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import sympy as sp

from pmjoint_codegen.errors import ModelError, did_you_mean, quoted
from pmjoint_codegen.modelfile.bounds import (
    LARGEST_EXPONENT,
    expansion_too_large,
    exponential_too_large,
    exponents_too_long,
    power_too_large,
)
from pmjoint_codegen.modelfile.points import NotFiniteError, value_at
from pmjoint_codegen.operations import by_name, functions
from pmjoint_codegen.values import OPERATORS

_LONGEST = 2000  # characters
_DEEPEST = 60  # brackets or operators inside each other
_MOST_NODES = 2000
_LEVELS = ((ast.Add, ast.Sub), (ast.Mult, ast.Div))  # operators that follow one another without nesting

_NOT_REAL = (sp.zoo, sp.oo, -sp.oo, sp.nan, sp.I)
_SIGNAL = re.compile(r"t|y|x\d+")  # reserved: no parameter may have this name
_KINKED: Mapping[str, tuple[Callable[..., Any], Callable[..., Any]]] = MappingProxyType(
    {
        "abs": (math.fabs, sp.Abs),
        "sign": (lambda value: float(value > 0) - float(value < 0), sp.sign),
        # By way of sign, so that the loops know one kind of kink; what is not chosen counts 0 times, exactly.
        "min": (min, lambda a, b: a * (1 - sp.sign(a - b)) / 2 + b * (1 + sp.sign(a - b)) / 2),
        "max": (max, lambda a, b: a * (1 + sp.sign(a - b)) / 2 + b * (1 - sp.sign(a - b)) / 2),
    }
)
_OF_TWO = ("min", "max")


@dataclass(frozen=True)
class _Place:
    """The place of an expression: its text, and the names and functions that are allowed there."""

    source: str
    symbols: Mapping[str, sp.Symbol]
    functions: tuple[str, ...]


@dataclass(frozen=True)
class _Term:
    """A built part of an expression, with its value in double precision where it is constant."""

    expression: sp.Expr
    value: float | None


class _Refused(Exception):  # noqa: N818 - caught in this module, where it reads as a sentence
    """The error in an expression, and what is allowed instead."""

    def __init__(self, what: str, allowed: str = "") -> None:
        super().__init__(what)
        self.what = what
        rule = f"allowed: numbers, names, brackets, + - * / ** and {' '.join(functions())}"
        self.allowed = allowed or rule


def parse(
    text: str,
    symbols: Mapping[str, sp.Symbol],
    where: str,
    *,
    kinks: bool = False,
    signals: Collection[str] = (),
) -> sp.Expr:
    """Turn an expression of a model file into SymPy.

    Args:
        text: such as ``0.1*sin(x2)*cos(t)``.
        symbols: name -> symbol, for every name allowed in this place; ``pi`` is always allowed.
        where: file and key at the start of a message.
        kinks: whether abs, sign, min and max are allowed too, as in a disturbance.
        signals: names that move along a run besides t, y and x1, x2, ...

    Raises:
        ModelError: anything that is not on the whitelist, too large, or not finite and real.
    """
    try:
        allowed = (*functions(), *_KINKED) if kinks else functions()
        place = _Place(_source(text), symbols, allowed)
        expression = _checked(_build(_tree(place.source), place, _DEEPEST).expression)
        return expression if kinks else _smooth(expression, signals)
    except _Refused as refused:
        raise ModelError(f"{quoted(text)}: {refused.what}", where=where, remedy=refused.allowed) from None


def _source(text: str) -> str:
    """Refuse by length and by character; give the text on one line."""
    if len(text) > _LONGEST:
        raise _Refused(f"has {len(text)} characters", f"allowed: {_LONGEST}")
    source = " ".join(text.split())
    if not source:
        raise _Refused("is empty", 'write "0" for nothing')
    if "^" in source:
        raise _Refused("^ is not a power here", "write **")
    # Python's parser would fold look-alike letters to Latin ones, and silently drop what follows a #.
    strange = next((c for c in source if c in "#\\" or not (c.isascii() and c.isprintable())), None)
    if strange is not None:
        raise _Refused(f"has the character {strange!r} (U+{ord(strange):04X})")
    return source


def _tree(source: str) -> ast.expr:
    """Parse with Python's grammar, within bounds."""
    depth = deepest = 0
    for character in source:  # before the parser, which has its own, ruder, limit
        depth += (character in "([{") - (character in ")]}")
        deepest = max(deepest, depth)
    if deepest > _DEEPEST:
        raise _too_deep()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a mere warning of Python, as for 1if, is an error here
            tree = ast.parse(source, mode="eval")
    except SyntaxError as error:
        near = f" near character {error.offset}" if error.offset else ""
        raise _Refused(f"is not an expression{near}, or a * is missing") from None
    except (ValueError, RecursionError, MemoryError):
        raise _too_deep() from None
    if sum(1 for _ in ast.walk(tree)) > _MOST_NODES:
        raise _Refused("has too many terms", "split it into parameters and entries of theta")
    return tree.body


def _too_deep() -> _Refused:
    return _Refused("is nested too deeply", f"allowed: {_DEEPEST} brackets or operators inside each other")


def _build(node: ast.expr, place: _Place, depth: int) -> _Term:
    """Build one node of the syntax tree, or refuse it."""
    if depth == 0:
        raise _too_deep()

    def build(part: ast.expr) -> _Term:
        return _build(part, place, depth - 1)

    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return _literal(place.source[node.col_offset : node.end_col_offset], value)
        case ast.Name(id=name):
            return _name(name, place)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _apply(operator.neg, operator.neg, build(operand))
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return build(operand)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return _power(build(left), build(right))
        case ast.BinOp(op=op) if type(op) in OPERATORS:
            return _chain(node, place, depth)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in place.functions and len(
            arguments
        ) == _arity(name):
            return _call(name, *(build(argument) for argument in arguments))
    raise _refused_node(node, place)


def _chain(node: ast.BinOp, place: _Place, depth: int) -> _Term:
    """Build a sum or a product of any length: it counts as one level, though Python's grammar nests it."""
    level = next(kinds for kinds in _LEVELS if isinstance(node.op, kinds))
    parts: list[tuple[ast.operator, ast.expr]] = []
    first: ast.expr = node
    while isinstance(first, ast.BinOp) and isinstance(first.op, level):
        parts.append((first.op, first.right))
        first = first.left
    term = _build(first, place, depth - 1)
    for op, part in reversed(parts):
        combine = OPERATORS[type(op)]
        term = _apply(combine, combine, term, _build(part, place, depth - 1))
    return term


def _literal(text: str, value: float) -> _Term:
    """Read a number exactly as it is written."""
    if isinstance(value, int):
        return _Term(sp.Integer(value), _number(float, value))
    mantissa = text.lower().partition("e")[0]
    if value == 0:
        if mantissa.strip("0._"):  # 1e-999 is not zero, but no double is nearer
            raise _Refused(f"{quoted(text)} is too small for a number")
        return _Term(sp.Integer(0), 0.0)
    return _Term(sp.Rational(text.replace("_", "")) if math.isfinite(value) else sp.oo, _number(float, value))


def _name(name: str, place: _Place) -> _Term:
    symbols = place.symbols
    if name in symbols:
        return _Term(symbols[name], None)
    if name == "pi":
        return _Term(sp.pi, math.pi)
    if name in place.functions:
        raise _Refused(f"{name} is a function", f"write {name}(...)")
    guess = did_you_mean(name, symbols)
    raise _Refused(f"unknown symbol {quoted(name)}", f"{guess}allowed here: {', '.join((*symbols, 'pi'))}")


def _arity(name: str) -> int:
    return 2 if name in _OF_TWO else 1


def _call(name: str, *arguments: _Term) -> _Term:
    if name in _KINKED:
        return _apply(*_KINKED[name], *arguments)
    operation, argument = by_name()[name], arguments[0].expression
    _bound(expansion_too_large(name, argument) if operation.expands else None)
    _bound(exponential_too_large(argument) if name == "exp" else None)
    return _apply(operation.of(math), getattr(sp, name), *arguments)


def _power(base: _Term, exponent: _Term) -> _Term:
    _bound(power_too_large(base.expression, exponent.expression, exponent.value))
    return _apply(operator.pow, operator.pow, base, exponent)


def _bound(reason: str | None) -> None:
    if reason is not None:
        raise _Refused(
            reason, f"allowed: exponents up to {LARGEST_EXPONENT} of few digits, or make it a parameter"
        )


def _apply(numeric: Callable[..., Any], symbolic: Callable[..., Any], *terms: _Term) -> _Term:
    """Apply an operation, to the numbers first: they show whether SymPy may be asked at all."""
    values = [term.value for term in terms]
    value = None if None in values else _number(numeric, *values)
    try:
        expression = symbolic(*(term.expression for term in terms))
    except (
        Exception
    ):  # SymPy's own slips over extreme numbers, of many kinds, are the expression's fault here
        raise _not_finite() from None
    if expression.has(*_NOT_REAL):
        raise _not_finite()
    _bound(exponents_too_long(expression))
    if value is None and not expression.free_symbols:  # y/y and 1**y are constants that only SymPy sees
        value = _collapsed(expression)
    return _Term(expression, value)


def _number(numeric: Callable[..., Any], *values: float | None) -> float:
    try:
        value = numeric(*values)
    except (ArithmeticError, ValueError):
        raise _not_finite() from None
    if isinstance(value, float) and math.isfinite(value):
        return value
    raise _not_finite()  # complex, where a root of a negative number is taken


def _collapsed(expression: sp.Expr) -> float:
    try:
        return value_at(expression, {})
    except NotFiniteError:
        raise _not_finite() from None


def _not_finite() -> _Refused:
    return _Refused("has a part without a finite real value", "check divisions, roots and logarithms")


def _checked(expression: sp.Expr) -> sp.Expr:
    """Refuse numbers that have grown together beyond what a double holds."""
    for number in expression.atoms(sp.Rational):
        _number(operator.truediv, number.p, number.q)
    return expression


def _smooth(expression: sp.Expr, signals: Collection[str]) -> sp.Expr:
    """Refuse abs and sign of a signal in other words, such as sqrt(t*t); of a parameter they are numbers."""
    for part in sorted(expression.atoms(sp.Abs, sp.sign), key=str):
        names = [symbol.name for symbol in part.free_symbols]
        if any(_SIGNAL.fullmatch(name) or name in signals for name in names):
            raise _kinked(str(part).lower().partition("(")[0])
    return expression


def _kinked(name: str) -> _Refused:
    return _Refused(f"{name} has a kink", "allowed in a disturbance only")


def _refused_node(node: ast.expr, place: _Place) -> _Refused:
    """Name what is not on the whitelist, as the author wrote it."""
    match node:
        case ast.Call(func=ast.Name(id=name)) if name in place.functions:
            if name in _OF_TWO:
                return _Refused(f"{name} takes two arguments", f"write {name}(a, b)")
            return _Refused(f"{name} takes one argument", f"write {name}(...)")
        case ast.Call(func=ast.Name(id=name)) if name in place.symbols:
            return _Refused(f"{name} is not a function", f"write {name}*(...) for a product")
        case ast.Call(func=ast.Name(id=name)):
            if name in _KINKED:
                return _kinked(name)
            guess = did_you_mean(name, place.functions)
            return _Refused(
                f"unknown function {quoted(name)}", f"{guess}allowed: {' '.join(place.functions)}"
            )
        case ast.Call(func=ast.Constant() | ast.BinOp()):
            return _Refused("no function stands before a bracket", "write * for a product")
    return _Refused(f"{quoted(place.source[node.col_offset : node.end_col_offset])} is not allowed")
