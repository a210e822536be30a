"""Recurrences of the elementary operations: coefficient k of a result from its operands' up to k.

Coefficients are normalised, ``a[k] = (d^k a / dt^k) / k!``. Moore, Interval Analysis (1966); Jorba and Zou,
Experimental Mathematics 14 (2005), Proposition 2.1.

A recurrence sees one order at a time (`Order`): the coefficients of order k and 0, and sums over the orders
between. So it serves straight lines, where every order is printed, and compact code, where all orders share
one text (`compact`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

import casadi as ca

from pmjoint_codegen.emit.affine import Factor
from pmjoint_codegen.emit.terms import Term, number, total


class Kind(Enum):
    """Which series of a node."""

    VALUE = "value"  # a[j]
    SLOPE = "slope"  # j a[j]
    COMPANION = "companion"


Series: TypeAlias = "tuple[Node, Kind]"


@dataclass(eq=False)
class Node:
    """One operation of the right-hand side, with the coefficients computed so far.

    Attributes:
        recurrence: gives the coefficients; None for what comes from outside.
        operands: nodes that it reads.
        series: coefficients 0..k.
        constant: whether only coefficient 0 can differ from zero.
        companion: second series of a coupled pair, such as the cosine beside a sine.
        exponent: of a constant power.
        operation: CasADi's number of it; -1 for what comes from outside.
        residue: of a constant, see `affine`.
        rate: of a state: the node whose coefficient k-1 is k times the state's coefficient k.
        sum: what replaces the recurrence above order 0: nodes with the factors that they are summed with.
        absorbed: whether it has been multiplied out, so that nothing asks for its higher coefficients.
    """

    recurrence: Recurrence | None
    operands: tuple[Node, ...] = ()
    series: list[Term] = field(default_factory=list)
    constant: bool = False
    companion: list[Term] = field(default_factory=list)
    exponent: float = 0.0
    operation: int = -1
    residue: int = 0
    rate: Node | None = None
    sum: tuple[tuple[Node, Factor], ...] | None = None
    absorbed: bool = False

    def __getitem__(self, k: int) -> Term:
        """Coefficient k; beyond a constant's (or time's) own coefficients there are zeros."""
        return self.series[k] if k < len(self.series) else number(0.0)

    def begin(self) -> None:
        """Compute coefficient 0."""
        if self.recurrence is not None:
            self.series.append(self.recurrence.start(self))
            if self.recurrence.companion_start is not None:
                self.companion.append(self.recurrence.companion_start(self))


class Order(ABC):
    """The coefficients of one order k >= 1, as recurrences and sums ask for them."""

    @abstractmethod
    def of(self, node: Node) -> Term:
        """Coefficient k."""

    @abstractmethod
    def first(self, node: Node) -> Term:
        """Coefficient 0."""

    @abstractmethod
    def companion(self, node: Node) -> Term:
        """Coefficient 0 of the companion."""

    @abstractmethod
    def slope(self, node: Node) -> Term:
        """``k a[k]``."""

    @abstractmethod
    def interior(self, a: Series, b: Series) -> list[Term]:
        """``sum_j a[j] b[k-j]`` for j = 1..k-1, as terms that are to be added."""

    @abstractmethod
    def square(self, node: Node, own: Term) -> Term:
        """``sum_j a[j] a[k-j]`` for j = 0..k; `own` is a[k]."""

    @abstractmethod
    def times(self, term: Term, slope: float, constant: float = 0.0) -> Term:
        """Product with ``slope k + constant``."""

    @abstractmethod
    def per_order(self, term: Term) -> Term:
        """Product with 1/k."""

    @abstractmethod
    def over(self, term: Term, divisor: Term) -> Term:
        """Quotient by what is known at order 0."""

    @abstractmethod
    def factor(self, factor: Factor) -> Term:
        """A constant factor, without its sign."""

    def weighted(self, a: Node, b: Series, first: Term) -> Term:
        """``(1/k) sum_{j=1..k} j a[j] b[k-j]``: coefficient k of the primitive of a' b; `first` is b[0]."""
        return self.per_order(total([*self.interior((a, Kind.SLOPE), b), self.slope(a) * first]))

    def combined(self, parts: tuple[tuple[Node, Factor], ...]) -> Term:
        """A sum of nodes with constant factors."""
        products = [
            (self.of(part) if by.unit else self.factor(by) * self.of(part), by.sign) for part, by in parts
        ]
        plus, minus = ([term for term, sign in products if sign * wanted > 0] for wanted in (1, -1))
        return total(plus, minus)

    def extend(self, node: Node) -> tuple[Term, Term | None]:
        """Coefficient k of a node and of its companion, all lower ones and its operands' being known."""
        if node.sum is not None or node.recurrence is None:
            return self.combined(node.sum or ()), None
        own = node.recurrence.rise(node, self)
        beside = node.recurrence.companion_rise
        return own, None if beside is None else beside(node, self, own)


@dataclass(frozen=True)
class Recurrence:
    """How an operation's coefficients follow.

    Attributes:
        start: coefficient 0.
        rise: coefficient k >= 1.
        companion_start: coefficient 0 of the companion; None where there is none.
        companion_rise: coefficient k of the companion, from that of the operation.
    """

    start: Callable[[Node], Term]
    rise: Callable[[Node, Order], Term]
    companion_start: Callable[[Node], Term] | None = None
    companion_rise: Callable[[Node, Order, Term], Term] | None = None


def _multiply(node: Node, o: Order) -> Term:
    a, b = node.operands
    if a.constant:
        return o.first(a) * o.of(b)
    if b.constant:
        return o.of(a) * o.first(b)
    interior = o.interior((a, Kind.VALUE), (b, Kind.VALUE))
    return total([o.first(a) * o.of(b), *interior, o.of(a) * o.first(b)])


def _square(node: Node, o: Order) -> Term:
    a = node.operands[0]
    return o.square(a, o.of(a))


def _divide(node: Node, o: Order) -> Term:
    a, b = node.operands
    if b.constant:
        return o.over(o.of(a), o.first(b))
    known = [*o.interior((b, Kind.VALUE), (node, Kind.VALUE)), o.of(b) * o.first(node)]
    return o.over(total([o.of(a)], known), o.first(b))


def _invert(node: Node, o: Order) -> Term:
    a = node.operands[0]
    known = [*o.interior((a, Kind.VALUE), (node, Kind.VALUE)), o.of(a) * o.first(node)]
    return -total(known) * o.first(node)


def _logarithm(node: Node, o: Order) -> Term:
    a = node.operands[0]
    inner = total(o.interior((node, Kind.SLOPE), (a, Kind.VALUE)))
    return o.over(total([o.of(a)], [o.per_order(inner)]), o.first(a))


def _root(node: Node, o: Order) -> Term:
    interior = o.interior((node, Kind.VALUE), (node, Kind.VALUE))
    return o.over(total([o.of(node.operands[0])], interior), o.first(node).times(2.0))


def _power(node: Node, o: Order) -> Term:
    """``a^e`` with a number e: ``k a[0] p[k] = sum_{j<k} (k e - j (e + 1)) a[k-j] p[j]``."""
    a, e = node.operands[0], node.exponent
    last = o.times(o.of(a) * o.first(node), e)
    values = total(o.interior((a, Kind.VALUE), (node, Kind.VALUE)))
    slopes = total(o.interior((a, Kind.VALUE), (node, Kind.SLOPE)))
    inner = total([last, o.times(values, e)], [slopes.times(e + 1)])
    return o.over(o.per_order(inner), o.first(a))


def _applied(function: Callable[[ca.SX], ca.SX]) -> Callable[[Node], Term]:
    return lambda node: node.operands[0][0].apply(function)


def _coupled(
    function: Callable[[ca.SX], ca.SX], beside: Callable[[ca.SX], ca.SX], sign: int, beside_sign: int
) -> Recurrence:
    """A pair with ``f' = sign g a'`` and ``g' = beside_sign f a'``, such as sine and cosine."""

    def rise(node: Node, o: Order) -> Term:
        value = o.weighted(node.operands[0], (node, Kind.COMPANION), o.companion(node))
        return value if sign > 0 else -value

    def companion(node: Node, o: Order, _own: Term) -> Term:
        value = o.weighted(node.operands[0], (node, Kind.VALUE), o.first(node))
        return value if beside_sign > 0 else -value

    return Recurrence(_applied(function), rise, _applied(beside), companion)


def _tangent_like(function: Callable[[ca.SX], ca.SX], sign: int) -> Recurrence:
    """``f' = (1 + sign f^2) a'``: tan with +1, tanh with -1; the companion is f^2."""

    def rise(node: Node, o: Order) -> Term:
        a = node.operands[0]
        return total([o.of(a), o.weighted(a, (node, Kind.COMPANION), o.companion(node)).times(float(sign))])

    return Recurrence(
        _applied(function),
        rise,
        lambda node: node[0] * node[0],
        lambda node, o, own: o.square(node, own),
    )


def _elementwise(function: Callable[[ca.SX], ca.SX], rise: Callable[[Node, Order], Term]) -> Recurrence:
    return Recurrence(_applied(function), rise)


def constant_power() -> Recurrence:
    """``a^e`` with a number e."""
    return Recurrence(lambda node: node.operands[0][0].apply(lambda value: value**node.exponent), _power)


def recurrences() -> Mapping[int, Recurrence]:
    """The recurrence of each operation, by CasADi's number of it; powers have one of their own."""

    def linear(combine: Callable[..., Term]) -> Recurrence:
        return Recurrence(
            lambda node: combine(*(a[0] for a in node.operands)),
            lambda node, o: combine(*(o.of(a) for a in node.operands)),
        )

    def start(combine: Callable[..., Term]) -> Callable[[Node], Term]:
        return lambda node: combine(*(a[0] for a in node.operands))

    return {
        ca.OP_ASSIGN: linear(lambda a: a),
        ca.OP_ADD: linear(lambda a, b: a + b),
        ca.OP_SUB: linear(lambda a, b: a - b),
        ca.OP_NEG: linear(lambda a: -a),
        ca.OP_TWICE: linear(lambda a: a.times(2.0)),
        ca.OP_MUL: Recurrence(start(lambda a, b: a * b), _multiply),
        ca.OP_SQ: Recurrence(start(lambda a: a * a), _square),
        ca.OP_DIV: Recurrence(start(lambda a, b: a / b), _divide),
        ca.OP_INV: Recurrence(start(lambda a: number(1.0) / a), _invert),
        ca.OP_SIN: _coupled(ca.sin, ca.cos, 1, -1),
        ca.OP_COS: _coupled(ca.cos, ca.sin, -1, 1),
        ca.OP_TAN: _tangent_like(ca.tan, 1),
        ca.OP_TANH: _tangent_like(ca.tanh, -1),
        ca.OP_EXP: _elementwise(
            ca.exp, lambda node, o: o.weighted(node.operands[0], (node, Kind.VALUE), o.first(node))
        ),
        ca.OP_LOG: _elementwise(ca.log, _logarithm),
        ca.OP_SQRT: _elementwise(ca.sqrt, _root),
        ca.OP_CONSTPOW: constant_power(),
        # |a| is a or -a away from its kink, and takes the slope 0 on it.
        ca.OP_FABS: _elementwise(
            ca.fabs, lambda node, o: o.first(node.operands[0]).apply(ca.sign) * o.of(node.operands[0])
        ),
        ca.OP_SIGN: _elementwise(ca.sign, lambda node, o: number(0.0)),
    }
