"""Recurrences of the elementary operations: coefficient k of a result from its operands' up to k.

The table of operations says which one is whose (`operations`). Coefficients are normalised,
``a[k] = (d^k a / dt^k) / k!``. Moore, Interval Analysis (1966); Jorba and Zou, Experimental Mathematics 14
(2005), Proposition 2.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca

from pmjoint_codegen.emit.affine import Factor
from pmjoint_codegen.emit.terms import Term, number, total

Recurrence = Callable[["Node", int], Term]


@dataclass(eq=False)
class Node:
    """One operation of the right-hand side, with the coefficients computed so far.

    Attributes:
        recurrence: gives coefficient k from the operands' coefficients up to k and its own below k.
        operands: nodes that it reads.
        series: coefficients 0..k.
        constant: whether only coefficient 0 can differ from zero.
        companion: second series that the recurrence needs, such as the cosine beside a sine.
        exponent: of a constant power.
        operation: its name in the table of operations; empty for what comes from outside.
        residue: of a constant, see `affine`.
        rate: of a state: the node whose coefficient k-1 is k times the state's coefficient k.
        sum: what replaces the recurrence above order 0: nodes with the factors that they are summed with.
        absorbed: whether it has been multiplied out, so that nothing asks for its higher coefficients.
    """

    recurrence: Recurrence
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

    def extend(self, k: int) -> None:
        """Compute coefficient k, all lower ones being known."""
        if k == 0 or not (self.constant or self.absorbed):
            linear = k > 0 and self.sum is not None
            self.series.append(_combined(self, k) if linear else self.recurrence(self, k))

    def slope(self, k: int) -> Term:
        """Coefficient k - 1 of its derivative, ``k a[k]``."""
        return self[k].times(float(k)) if self.rate is None else self.rate[k - 1]


def _combined(node: Node, k: int) -> Term:
    parts = node.sum or ()
    products = [(part[k] if factor.unit else factor.term * part[k], factor.sign) for part, factor in parts]
    return total([term for term, sign in products if sign > 0], [term for term, sign in products if sign < 0])


def convolve(
    a: Sequence[Term] | Node, b: Sequence[Term] | Node, k: int, first: int = 0, last: int | None = None
) -> Term:
    """``sum_j a[j] b[k-j]`` for j = first..last (k by default)."""
    return total([a[j] * b[k - j] for j in range(first, (k if last is None else last) + 1)])


def _weighted(a: Node, b: Sequence[Term], k: int) -> Term:
    """``(1/k) sum_{j=1..k} j a[j] b[k-j]``: coefficient k of the primitive of a' b."""
    return total([a.slope(j) * b[k - j] for j in range(1, k + 1)]).times(1 / k)


def linear(apply: Callable[..., Term]) -> Recurrence:
    """Sums, differences and the like: coefficient by coefficient."""
    return lambda node, k: apply(*(operand[k] for operand in node.operands))


def multiply(node: Node, k: int) -> Term:
    """``a b``."""
    a, b = node.operands
    if a.constant:
        return a[0] * b[k]
    if b.constant:
        return a[k] * b[0]
    return convolve(a, b, k)


def square(node: Node, k: int) -> Term:
    """``a^2``."""
    a = node.operands[0]
    pairs = convolve(a, a, k, 0, (k - 1) // 2).times(2.0) if k > 0 else number(0.0)
    return total([pairs, a[k // 2] * a[k // 2]]) if k % 2 == 0 else pairs


def divide(node: Node, k: int) -> Term:
    """``a / b``."""
    a, b = node.operands
    if k == 0:
        return a[0] / b[0]
    if b.constant:
        return a[k].over(b[0])
    return total([a[k]], [b[j] * node.series[k - j] for j in range(1, k + 1)]).over(b[0])


def invert(node: Node, k: int) -> Term:
    """``1 / a``."""
    a = node.operands[0]
    return number(1.0) / a[0] if k == 0 else -convolve(a, node.series, k, 1) * node.series[0]


def pair(name: str, companion: str, sign: int, back: int) -> Recurrence:
    """``f' = sign g a'`` and ``g' = back f a'``, such as sine and cosine.

    Args:
        name: CasADi's name of f.
        companion: that of g.
        sign: 1 or -1.
        back: 1 or -1.
    """

    def recurrence(node: Node, k: int) -> Term:
        a = node.operands[0]
        if k == 0:
            node.companion.append(a[0].apply(getattr(ca, companion)))
            return a[0].apply(getattr(ca, name))
        slope = _weighted(a, node.series, k)
        node.companion.append(slope if back > 0 else -slope)
        own = _weighted(a, node.companion, k)
        return own if sign > 0 else -own

    return recurrence


def exponential(node: Node, k: int) -> Term:
    """``f' = f a'``."""
    a = node.operands[0]
    return a[0].apply(ca.exp) if k == 0 else _weighted(a, node.series, k)


def inverse_slope(name: str, divisor: Recurrence) -> Recurrence:
    """``d f' = a'`` with a divisor d of a, such as log and atan.

    Args:
        name: CasADi's name of f.
        divisor: coefficient k of d.
    """

    def recurrence(node: Node, k: int) -> Term:
        a, d = node.operands[0], node.companion
        d.append(divisor(node, k))
        if k == 0:
            return a[0].apply(getattr(ca, name))
        inner = total([node.series[j].times(float(j)) * d[k - j] for j in range(1, k)])
        return total([a[k]], [inner.times(1 / k)]).over(d[0])

    return recurrence


def one_plus_square(sign: int) -> Recurrence:
    """``1 + sign a^2``, as a divisor.

    Args:
        sign: 1 or -1.
    """

    def coefficient(node: Node, k: int) -> Term:
        own = square(node, k).times(float(sign))
        return number(1.0) + own if k == 0 else own

    return coefficient


def root(node: Node, k: int) -> Term:
    """``f^2 = a``."""
    a = node.operands[0]
    if k == 0:
        return a[0].apply(ca.sqrt)
    inner = [node.series[j] * node.series[k - j] for j in range(1, k)]
    return total([a[k]], inner).over(node.series[0].times(2.0))


def riccati(name: str, sign: int) -> Recurrence:
    """``f' = (1 + sign f^2) a'``, such as tan and tanh; the companion holds f^2.

    Args:
        name: CasADi's name of f.
        sign: 1 or -1.
    """

    def recurrence(node: Node, k: int) -> Term:
        a = node.operands[0]
        if k == 0:
            own = a[0].apply(getattr(ca, name))
        else:
            own = total([a[k], _weighted(a, node.companion, k).times(float(sign))])
        node.companion.append(convolve([*node.series, own], [*node.series, own], k))
        return own

    return recurrence


def magnitude(node: Node, k: int) -> Term:
    """|a| is a or -a away from its kink, and takes the slope 0 on it."""
    a = node.operands[0]
    return a[0].apply(ca.fabs) if k == 0 else a[0].apply(ca.sign) * a[k]


def sign(node: Node, k: int) -> Term:
    """The sign of a."""
    return node.operands[0][0].apply(ca.sign) if k == 0 else number(0.0)


def constant_power(node: Node, k: int) -> Term:
    """``a^e`` with a number e."""
    a, exponent = node.operands[0], node.exponent
    if k == 0:
        return a[0].apply(lambda value: value**exponent)
    inner = [(a[k - j] * node.series[j]).times(k * exponent - j * (exponent + 1)) for j in range(k)]
    return total(inner).times(1 / k).over(a[0])
