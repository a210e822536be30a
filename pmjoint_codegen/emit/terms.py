"""Coefficients as printed: an expression, and how soon a processor can compute it.

A Taylor kernel is one straight line of some thousand dependent operations; its time is set less by their
number than by the longest chain of them. So a sum adds the earliest terms first: its last addend is the one
with the longest chain. That choice is made here, once, when a model is generated; the C, the interpreter and
the lanes then do the same operations in the same order.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import casadi as ca

# Steps until a result is known, in units of one addition or product.
QUOTIENT: Final = 4
FUNCTION: Final = 12


@dataclass(frozen=True, eq=False)
class Term:
    """One coefficient.

    Attributes:
        value: the expression.
        ready: length of the longest chain of operations behind it.
        neutral: whether it is a parameter that is 1 unless it is set (`affine`), or made of such: a product
            or quotient by it counts as no step, so that it changes no order of additions.
    """

    value: ca.SX
    ready: int = 0
    neutral: bool = False

    @property
    def zero(self) -> bool:
        """Whether it is nothing but 0."""
        return bool(self.value.is_zero())

    def __add__(self, other: Term) -> Term:
        """Sum."""
        return self._with(other, self.value + other.value, 1)

    def __sub__(self, other: Term) -> Term:
        """Difference."""
        return self._with(other, self.value - other.value, 1)

    def __mul__(self, other: Term) -> Term:
        """Product."""
        value = self.value * other.value
        if other.neutral:
            return self._scaled(value)
        return other._scaled(value) if self.neutral else self._with(other, value, 1)

    def __truediv__(self, other: Term) -> Term:
        """Quotient."""
        value = self.value / other.value
        return self._scaled(value) if other.neutral else self._with(other, value, QUOTIENT)

    def __neg__(self) -> Term:
        """Negative."""
        return Term(-self.value, self.ready)

    def times(self, number: float) -> Term:
        """Product with a number."""
        return self * Term(ca.SX(number))

    def over(self, other: Term) -> Term:
        """Product with the inverse: for quotients by one divisor, which is inverted once."""
        return self * (Term(ca.SX(1)) / other)

    def apply(self, function: Callable[[ca.SX], ca.SX]) -> Term:
        """An elementary function of it."""
        return Term(function(self.value), self.ready + FUNCTION)

    def _with(self, other: Term, value: ca.SX, steps: int) -> Term:
        if value.is_constant():
            return Term(value)
        return Term(value, max(self.ready, other.ready) + steps)

    def _scaled(self, value: ca.SX) -> Term:
        """This term times or over a neutral one."""
        return Term(value, self.ready, self.neutral or bool(self.value.is_one()))


def number(value: float) -> Term:
    """A number as a term."""
    return Term(ca.SX(value))


def total(addends: Iterable[Term], subtrahends: Iterable[Term] = ()) -> Term:
    """Sum of the addends less the subtrahends, in the order in which they become known.

    The two that are known first are added, and their sum takes its place among the others; no order of
    additions ends sooner.
    """
    signed = [*((1, term) for term in addends), *((-1, term) for term in subtrahends)]
    heap = [(term.ready, place, sign, term) for place, (sign, term) in enumerate(signed) if not term.zero]
    heapq.heapify(heap)
    place = len(signed)
    while len(heap) > 1:
        _, _, sign, first = heapq.heappop(heap)
        _, _, other, second = heapq.heappop(heap)
        together = first + second if sign == other else first - second if sign > 0 else second - first
        heapq.heappush(heap, (together.ready, place, sign if sign == other else 1, together))
        place += 1
    if not heap:
        return number(0.0)
    _, _, sign, term = heap[0]
    return term if sign > 0 else -term
