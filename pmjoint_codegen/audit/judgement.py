"""Verdicts by comparison: printed chains of equalities and inequalities, link by link.

An equality holds when the difference of its sides expands to zero; an inequality, when that difference
equals a given sum of squares with positive coefficients (or passes a test given for it). Nothing is
believed: a correction is put in the place of what is printed and judged the same way.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Any

import sympy as sp

from pmjoint_codegen.audit.notation import chain

Evaluate = Callable[[str], Any]
Proof = str | Callable[[sp.Expr], bool]
_SHORT = 40  # operations of a difference that is shown as it is
_MODERATE = 500  # operations of one that is worth simplifying first

Proofs = Mapping[tuple[int, int], Proof]  # (line, link) -> what shows that its right side is the larger one


def no_proofs() -> Proofs:
    """Proofs for a display without inequalities."""
    return MappingProxyType({})


class Verdict(StrEnum):
    """What became of a printed equation or claim."""

    FOLLOWS = "follows"
    DEFINITION = "definition"
    ASSUMPTION = "assumption"
    CORRECTED = "follows with a correction"
    FAILS = "does not follow"


@dataclass(frozen=True)
class Link:
    """One relation of a printed chain, judged.

    Attributes:
        holds: whether it was shown to hold.
        remark: why it does not.
    """

    holds: bool
    remark: str


def vanishes(gap: Any) -> bool:
    """Whether an expression, or every entry of a matrix, is identically zero."""
    entries = list(gap) if isinstance(gap, sp.MatrixBase) else [gap]
    return not any(_refuted(entry) for entry in entries) and all(
        sp.expand(sp.numer(sp.together(entry))) == 0 for entry in entries
    )


def _refuted(entry: sp.Expr) -> bool:
    """Whether an expression is a rational number other than zero at a point: this spares the expansion."""
    found = entry.xreplace(_point(entry.free_symbols))
    return bool(found.is_Rational and found != 0)


def _point(symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, sp.Integer]:
    """The first primes, one for each symbol in order of their names."""
    return {symbol: sp.Integer(sp.prime(i)) for i, symbol in enumerate(sorted(symbols, key=str), start=1)}


def judge_lines(lines: Sequence[str], evaluate: Evaluate, proofs: Proofs) -> tuple[Link, ...]:
    """Judge every link of every line.

    Args:
        lines: printed chains.
        evaluate: printed expression -> its value in primitive symbols.
        proofs: for the inequalities among them.
    """
    return tuple(
        link for number, line in enumerate(lines) for link in _judge_line(number, line, evaluate, proofs)
    )


def _judge_line(number: int, line: str, evaluate: Evaluate, proofs: Proofs) -> Iterator[Link]:
    expressions, relations = chain(line)
    for place, relation in enumerate(relations):
        left, right = expressions[place : place + 2]
        try:
            gap = difference(evaluate(right), evaluate(left))
        except TypeError as error:
            yield Link(False, str(error))
            continue
        proof = proofs.get((number, place))
        larger = proof is not None and _proves(proof, gap, evaluate)
        holds = vanishes(gap) or (relation == "<=" and larger)
        remark = (
            "" if holds else "it is an inequality: right - left is the sum below" if larger else shown(gap)
        )
        yield Link(holds, remark)


def difference(right: Any, left: Any) -> Any:
    """Right minus left; raises TypeError for a number and a matrix, but a printed 0 fits any size."""
    if isinstance(right, sp.MatrixBase) != isinstance(left, sp.MatrixBase):
        if right == 0:
            return -left
        raise TypeError("one side is a number, the other a column")
    return right - left


def _proves(proof: Proof, gap: sp.Expr, evaluate: Evaluate) -> bool:
    if not isinstance(proof, str):
        return proof(gap)
    return is_sum_of_squares(proof, evaluate) and vanishes(gap - evaluate(proof))


def is_sum_of_squares(text: str, evaluate: Evaluate) -> bool:
    """Whether a text is a sum of squares whose coefficients are positive for positive gains."""
    return all(_is_square(term, evaluate) for term in _terms(ast.parse(text, mode="eval").body))


def _terms(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield from _terms(node.left)
        yield from _terms(node.right)
    else:
        yield node


def _is_square(term: ast.expr, evaluate: Evaluate) -> bool:
    if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult):
        return _is_square(term.left, evaluate) and _is_square(term.right, evaluate)
    if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Pow) and ast.unparse(term.right) == "2":
        return True
    coefficient = evaluate(ast.unparse(term))
    positive = {symbol: sp.Dummy(symbol.name, positive=True) for symbol in coefficient.free_symbols}
    return bool(coefficient.xreplace(positive).is_positive)


def shown(gap: Any) -> str:
    """A difference in few words: itself where it is short, else its value at a point."""
    entries = list(gap) if isinstance(gap, sp.MatrixBase) else [gap]
    if sum(sp.count_ops(entry) for entry in entries) <= _MODERATE:
        entries = [sp.factor(sp.cancel(entry)) for entry in entries]
    if sum(sp.count_ops(entry) for entry in entries) <= _SHORT:
        return f"right - left = {', '.join(str(entry) for entry in entries)}"
    point = _point(set().union(*(entry.free_symbols for entry in entries)))
    values = ", ".join(f"{float(entry.xreplace(point)):.6g}" for entry in entries)
    return (
        f"right - left = {values} at {', '.join(f'{symbol} = {number}' for symbol, number in point.items())}"
    )


def verdict(
    printed: tuple[Link, ...], corrected: tuple[Link, ...], otherwise: Verdict = Verdict.FOLLOWS
) -> Verdict:
    """The verdict on a display.

    Args:
        printed: its links.
        corrected: the links of its correction; none when there is none.
        otherwise: what it is called when every printed link holds.
    """
    if all(link.holds for link in printed):
        return otherwise
    if corrected and all(link.holds for link in corrected):
        return Verdict.CORRECTED
    return Verdict.FAILS
