r"""An equation's LaTeX in as many rows as it needs: broken between terms, or inside one too long for a row.

What cannot be broken, such as a fraction with a long half, stays on a row that is too wide.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import sympy as sp

from pmjoint_codegen.report.notation import latex_expression, latex_name, ordered_terms
from pmjoint_codegen.report.width import width
from pmjoint_derive.equation import Equation

ROOM = 37.0  # em that a row may have by the estimate: 16.6 cm less the number, and less the estimate's error

_EQUALS = 1.4  # em
_SQUARE, _ROUND = (r"\Bigl[", r"\Bigr]"), (r"\Bigl(", r"\Bigr)")
_ARGUMENT = sp.Symbol("x")
_CALL = re.compile(r"(.*)\{\\left\(x \\right\)\}")  # a function of it
_EXTREMA = {sp.Max: r"\max", sp.Min: r"\min"}


def equation_rows(equation: Equation, *, fill: bool = True) -> list[str]:
    """Give an equation on one line, or broken where the line would be too long.

    Args:
        equation: what to print.
        fill: put as many terms into a line as it holds. Without it, each term has its own, and a change of
            one leaves the others where they were.
    """
    left, expression = latex_name(equation.name), equation.expression
    room = ROOM - width(left) - _EQUALS
    pieces = _pieces(expression, room, _SQUARE)
    if len(pieces) == 1:
        return [f"{left} = {pieces[0]}"]
    first, *rest = _filled(pieces, room) if fill else pieces
    return [r"\begin{aligned}", f"{left} ={{}}& {first}", *(rf"\\ & {row}" for row in rest), r"\end{aligned}"]


def too_wide(equation: Equation, rows: Iterable[str]) -> bool:
    """Whether a row of an equation may not find room beside the number."""
    room = ROOM - width(latex_name(equation.name)) - _EQUALS
    return any(width(re.sub(r"^.*?=(\{\})?&?|^\\\\ &", "", row)) > room for row in rows)


def _pieces(expression: sp.Expr, room: float, brackets: tuple[str, str] = _ROUND) -> list[str]:
    """Give an expression whole or, where it is too long for a row, what may stand on rows of its own."""
    whole = latex_expression(expression)
    if width(whole) <= room:
        return [whole]
    breakable = [factor for factor in sp.Mul.make_args(expression) if _inside(factor, room) is not None]
    if not breakable:
        return [whole]
    longest = max(breakable, key=lambda factor: _urgency(factor, room))
    rest, inside = expression / longest, _inside(longest, room)
    assert inside is not None  # as it is breakable
    before, pieces, after = inside
    if rest == 1 and isinstance(longest, sp.Add):
        return pieces
    opening, closing = brackets if isinstance(longest, sp.Add) else _ROUND
    *rows, beside = [""] if rest == 1 and not isinstance(longest, sp.Pow) else _factor(rest, room)
    bracket = " ".join(filter(None, (before, opening)))
    head = f"{beside} {bracket}" if beside else bracket
    if width(head) > room:
        rows, head = [*rows, beside], bracket
    first, *middle, last = _joined(head, pieces, room)
    return [*rows, first, *middle, f"{last} {closing}{after}"]


def _urgency(factor: sp.Expr, room: float) -> tuple[bool, float]:
    """Rank what can be broken: a long denominator, which must come last, before the longest factor."""
    wide = width(latex_expression(factor))
    return factor.is_Pow and factor.exp.is_negative and wide > room / 2, wide


def _factor(expression: sp.Expr, room: float) -> list[str]:
    """Give what stands before a bracket, itself in brackets where it is a sum."""
    pieces = _pieces(expression, room)
    if not isinstance(expression, sp.Add):
        return pieces
    if len(pieces) == 1:
        return [rf"\left({pieces[0]}\right)"]
    first, *middle, last = pieces
    return [f"{_ROUND[0]} {first}", *middle, f"{last} {_ROUND[1]}"]


def _inside(factor: sp.Expr, room: float) -> tuple[str, list[str], str] | None:
    """Give what can be broken in a factor: what is before its bracket, the pieces in it, what is after it."""
    if isinstance(factor, sp.Add):
        return "", list(_signed(ordered_terms(factor), room)), ""
    if isinstance(factor, tuple(_EXTREMA)):
        return _EXTREMA[type(factor)], list(_listed(factor, room)), ""
    if isinstance(factor, sp.Pow) and factor.base.is_Add and factor.exp.is_Integer:
        over, power = (r"\Big/", -factor.exp) if factor.exp < 0 else ("", factor.exp)
        pieces = list(_signed(ordered_terms(factor.base), room))
        return over, pieces, "" if power == 1 else f"^{{{power}}}"
    if isinstance(factor, sp.Function) and len(factor.args) == 1:
        call = _CALL.fullmatch(latex_expression(factor.func(_ARGUMENT)))
        pieces = _pieces(factor.args[0], room)
        return (call[1], pieces, "") if call and len(pieces) > 1 else None
    return None


def _joined(opening: str, pieces: list[str], room: float) -> list[str]:
    """Put what opens a bracket before its first piece, or on a row of its own where none holds both."""
    first, *rest = pieces
    return [f"{opening} {first}", *rest] if width(f"{opening} {first}") <= room else [opening, *pieces]


def _signed(terms: Iterable[sp.Expr], room: float) -> Iterator[str]:
    """Give the terms of a sum, each but the first with its sign; a term that no row holds, in pieces."""
    for i, term in enumerate(terms):
        first, *rest = _pieces(term, room)
        yield first if i == 0 or first[0] in "-+" else f"+ {first}"
        yield from rest


def _listed(extremum: sp.Expr, room: float) -> Iterator[str]:
    """Give the arguments of a largest or smallest value, each but the last with its comma."""
    arguments = sorted(extremum.args, key=sp.default_sort_key)
    for argument in arguments:
        *before, last = _pieces(argument, room)
        yield from before
        yield last if argument is arguments[-1] else f"{last},"


def _filled(pieces: Iterable[str], room: float) -> Iterator[str]:
    """Fill rows with pieces."""
    row = ""
    for piece in pieces:
        if row and width(f"{row} {piece}") > room:
            yield row
            row = piece
        else:
            row = f"{row} {piece}" if row else piece
    yield row
