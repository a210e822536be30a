"""Recurrences of the elementary operations: coefficient k of a result from its operands' up to k.

The table of operations assigns them (`operations`). Coefficients are normalised,
``a[k] = (d^k a / dt^k) / k!``. Moore, Interval Analysis (1966); Jorba and Zou,
Experimental Mathematics 14 (2005), Proposition 2.1.

A recurrence sees one order at a time (`Order`): the coefficients of order k and 0, and sums over the orders
between. So it serves straight lines, where every order is printed, and compact code, where all orders share
one text (`compact`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, TypeAlias

import casadi as ca

from pmjoint_codegen.emit.affine import Factor
from pmjoint_codegen.emit.terms import Term, number, total
from pmjoint_codegen.operations import by_name


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
        recurrence: gives the coefficients; None for an input.
        operands: nodes that it reads.
        series: coefficients 0..k.
        constant: whether only coefficient 0 can differ from zero.
        companion: second series of a coupled pair, such as the cosine beside a sine.
        exponent: of a constant power.
        operation: its name in the table; empty for an input.
        residue: of a constant, see `affine`.
        rate: of a state: the node whose coefficient k-1 is k times the state's coefficient k.
        sum: what replaces the recurrence above order 0: nodes with the factors that they are summed with.
        absorbed: whether it has been multiplied out, so its higher coefficients are not needed.
    """

    recurrence: Recurrence | None
    operands: tuple[Node, ...] = ()
    series: list[Term] = field(default_factory=list)
    constant: bool = False
    companion: list[Term] = field(default_factory=list)
    exponent: float = 0.0
    operation: str = ""
    residue: int = 0
    rate: Node | None = None
    sum: tuple[tuple[Node, Factor], ...] | None = None
    absorbed: bool = False

    def __getitem__(self, k: int) -> Term:
        """Coefficient k; beyond a constant's (or time's) own coefficients there are zeros."""
        return self.series[k] if k < len(self.series) else number(0.0)

    def begin(self) -> None:
        """Compute coefficient 0; a constant such as the lesser of two limits has no other."""
        if self.recurrence is None and self.operands:
            value = by_name()[self.operation].of(ca)(*(operand[0].value for operand in self.operands))
            self.series.append(Term(value))
        if self.recurrence is not None:
            self.series.append(self.recurrence.start(self))
            if self.recurrence.companion_start is not None:
                self.companion.append(self.recurrence.companion_start(self))


class Order(ABC):
    """The coefficients of one order k >= 1, for recurrences and sums."""

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
    def times(self, term: Term, slope: float) -> Term:
        """Product with ``slope k``."""

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


def linear(apply: Callable[..., Term]) -> Recurrence:
    """Sums, differences and the like: coefficient by coefficient."""
    return Recurrence(_first(apply), lambda node, o: apply(*(o.of(operand) for operand in node.operands)))


def _first(apply: Callable[..., Term]) -> Callable[[Node], Term]:
    return lambda node: apply(*(operand[0] for operand in node.operands))


def _called(name: str) -> Callable[[Node], Term]:
    """CasADi's function of that name."""
    return lambda node: node.operands[0][0].apply(getattr(ca, name))


def _product(node: Node, o: Order) -> Term:
    a, b = node.operands
    if a.constant:
        return o.first(a) * o.of(b)
    if b.constant:
        return o.of(a) * o.first(b)
    interior = o.interior((a, Kind.VALUE), (b, Kind.VALUE))
    return total([o.first(a) * o.of(b), *interior, o.of(a) * o.first(b)])


def _quotient(node: Node, o: Order) -> Term:
    a, b = node.operands
    if b.constant:
        return o.over(o.of(a), o.first(b))
    known = [*o.interior((b, Kind.VALUE), (node, Kind.VALUE)), o.of(b) * o.first(node)]
    return o.over(total([o.of(a)], known), o.first(b))


def _inverse(node: Node, o: Order) -> Term:
    a = node.operands[0]
    known = [*o.interior((a, Kind.VALUE), (node, Kind.VALUE)), o.of(a) * o.first(node)]
    return -total(known) * o.first(node)


def _root(node: Node, o: Order) -> Term:
    interior = o.interior((node, Kind.VALUE), (node, Kind.VALUE))
    return o.over(total([o.of(node.operands[0])], interior), o.first(node).times(2.0))


def _power(node: Node, o: Order) -> Term:
    """``k a[0] p[k] = sum_{j<k} (k e - j (e + 1)) a[k-j] p[j]``."""
    a, e = node.operands[0], node.exponent
    last = o.times(o.of(a) * o.first(node), e)
    values = total(o.interior((a, Kind.VALUE), (node, Kind.VALUE)))
    slopes = total(o.interior((a, Kind.VALUE), (node, Kind.SLOPE)))
    inner = total([last, o.times(values, e)], [slopes.times(e + 1)])
    return o.over(o.per_order(inner), o.first(a))


def pair(name: str, companion: str, sign: int, back: int) -> Recurrence:
    """``f' = sign g a'`` and ``g' = back f a'``, such as sine and cosine.

    Args:
        name: CasADi's name of f.
        companion: that of g.
        sign: 1 or -1.
        back: 1 or -1.
    """

    def rise(node: Node, o: Order) -> Term:
        value = o.weighted(node.operands[0], (node, Kind.COMPANION), o.companion(node))
        return value if sign > 0 else -value

    def beside(node: Node, o: Order, _own: Term) -> Term:
        value = o.weighted(node.operands[0], (node, Kind.VALUE), o.first(node))
        return value if back > 0 else -value

    return Recurrence(_called(name), rise, _called(companion), beside)


def inverse_slope(name: str, divisor: Recurrence) -> Recurrence:
    """``d f' = a'`` with a divisor d of a, such as log and atan; the companion holds d.

    Args:
        name: CasADi's name of f.
        divisor: of d, as a function of a.
    """

    def rise(node: Node, o: Order) -> Term:
        inner = total(o.interior((node, Kind.SLOPE), (node, Kind.COMPANION)))
        return o.over(total([o.of(node.operands[0])], [o.per_order(inner)]), o.companion(node))

    return Recurrence(_called(name), rise, divisor.start, lambda node, o, _own: divisor.rise(node, o))


def one_plus_square(sign: int) -> Recurrence:
    """``1 + sign a^2``, as a divisor.

    Args:
        sign: 1 or -1.
    """
    return Recurrence(
        lambda node: number(1.0) + (node.operands[0][0] * node.operands[0][0]).times(float(sign)),
        lambda node, o: square.rise(node, o).times(float(sign)),
    )


def riccati(name: str, sign: int) -> Recurrence:
    """``f' = (1 + sign f^2) a'``, such as tan and tanh; the companion holds f^2.

    Args:
        name: CasADi's name of f.
        sign: 1 or -1.
    """

    def rise(node: Node, o: Order) -> Term:
        a = node.operands[0]
        return total([o.of(a), o.weighted(a, (node, Kind.COMPANION), o.companion(node)).times(float(sign))])

    return Recurrence(
        _called(name), rise, lambda node: node[0] * node[0], lambda node, o, own: o.square(node, own)
    )


multiply: Final = Recurrence(_first(lambda a, b: a * b), _product)
square: Final = Recurrence(
    _first(lambda a: a * a), lambda node, o: o.square(node.operands[0], o.of(node.operands[0]))
)
divide: Final = Recurrence(_first(lambda a, b: a / b), _quotient)
invert: Final = Recurrence(_first(lambda a: number(1.0) / a), _inverse)
root: Final = Recurrence(_called("sqrt"), _root)
itself: Final = linear(lambda a: a)
exponential: Final = Recurrence(
    _called("exp"), lambda node, o: o.weighted(node.operands[0], (node, Kind.VALUE), o.first(node))
)
constant_power: Final = Recurrence(
    lambda node: node.operands[0][0].apply(lambda value: value**node.exponent), _power
)
# |a| is a or -a away from its kink, and takes the slope 0 on it.
magnitude: Final = Recurrence(
    _called("fabs"), lambda node, o: o.first(node.operands[0]).apply(ca.sign) * o.of(node.operands[0])
)
sign: Final = Recurrence(_called("sign"), lambda node, o: number(0.0))
