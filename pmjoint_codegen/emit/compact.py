"""Taylor coefficients as compact code: one text for all orders, in two phases per order.

Straight lines grow with the square of the order and of the right-hand side. Above some thousand instructions
they no longer fit a processor's instruction cache, and compilers take minutes. Here order k is

* phase A: all sums ``S_i = sum_{j=1}^{k-1} x_j y_{k-j}``. They need lower orders only and do not depend on
  one another, so eight of them share a vector, without horizontal sums;
* phase B: straight lines in which the coefficients of order k enter linearly.

Order 0, and what it fixes for all orders (factors, quotients), is straight code as well, once per call.
Squares and sums add in another order than straight lines do; `unrolled` is the same arithmetic as one
function, operation by operation, for evaluation without a compiler.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import casadi as ca

from pmjoint_codegen.emit.affine import Entry, Factor
from pmjoint_codegen.emit.recurrences import Kind, Node, Order, Series
from pmjoint_codegen.emit.taylor import Expansion, expand
from pmjoint_codegen.emit.terms import Term, number, total

WIDTH: Final = 8  # sums that share a vector
MOST_STRAIGHT: Final = (
    8_000  # operations; beyond, compact code is faster, and compiled in a tenth of the time
)


@dataclass(frozen=True)
class Compact:
    """A Taylor kernel in two phases per order.

    Attributes:
        name: of the kernel.
        order: highest coefficient N.
        start: the kernel's arguments -> ``c`` row 0, ``q`` rates at order 0, ``r`` what stays for all orders.
        rise: ``k`` (k, 1/k and the coefficient k of time), ``q`` rates of order k - 1, ``r``, ``S`` ->
            ``c`` row k, ``q`` rates of order k, ``a`` coefficients that sums read.
        pairs: of each sum, the entries of ``a`` that are its x and its y.
    """

    name: str
    order: int
    start: ca.Function
    rise: ca.Function
    pairs: tuple[tuple[int, int], ...]

    @property
    def operations(self) -> int:
        """Operations of all orders together; straight lines take about as many."""
        sums = len(self.pairs) * self.order * (self.order - 1)
        return self.start.n_instructions() + self.order * self.rise.n_instructions() + sums

    def unrolled(self) -> ca.Function:
        """The kernel as one function of its arguments, with output ``c``: the same operations, in order."""
        start, rise = self.start, self.rise
        inputs = [ca.SX.sym(label, start.size1_in(i)) for i, label in enumerate(start.name_in())]
        with literally():
            row, q, r = start.call(inputs)
            rows, stored = [row], list[ca.SX]()
            for k in range(1, self.order + 1):
                sums = ca.vertcat(*(self._sum(stored, x, y, k) for x, y in self.pairs))
                scalars = ca.vertcat(float(k), 1.0 / k, 1.0 if k == 1 else 0.0)
                row, q, a = rise.call([scalars, q, r, sums])
                rows.append(row)
                stored.append(a)
            return ca.Function(self.name, inputs, [ca.vertcat(*rows)], start.name_in(), ["c"])

    @staticmethod
    def _sum(stored: Sequence[ca.SX], x: int, y: int, k: int) -> ca.SX:
        result = ca.SX(0.0)
        for j in range(1, k):
            result = result + stored[j - 1][x] * stored[k - j - 1][y]
        return result


@contextmanager
def literally() -> Iterator[None]:
    """Make CasADi keep every operation as written: simplifications such as ``x (1/y) = x/y`` change bits."""
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


class _Phase(Order):
    """Order k as symbols: the inputs of phase B from order 0, from phase A and from the order below."""

    def __init__(self, system: Expansion) -> None:
        self.k, self.per_k, self.tau = ca.SX.sym("k"), ca.SX.sym("per_k"), ca.SX.sym("tau")
        self.q = ca.SX.sym("q", len(system.states))
        self.fixed: list[tuple[ca.SX, ca.SX]] = []  # symbol, expression at order 0
        self.sums: list[tuple[ca.SX, Series, Series]] = []
        self.values: dict[Node, Term] = {}
        self.beside: dict[Node, Term] = {}
        self._rates = {node: Term(self.q[i]) for i, node in enumerate(system.states)}
        self._fixed: dict[int, Term] = {}
        self._sums: dict[tuple[Series, Series], Term] = {}
        self._partner = _partners(system.nodes)
        for node, rate in self._rates.items():
            self.values[node] = self.per_order(rate)

    def of(self, node: Node) -> Term:
        """Coefficient k: a leaf that moves and is no state is time."""
        if node.constant:
            return number(0.0)
        return self.values[node] if node in self.values else Term(self.tau)

    def first(self, node: Node) -> Term:
        """Coefficient 0, which stays for all orders."""
        return self._stays(node[0])

    def companion(self, node: Node) -> Term:
        """Coefficient 0 of the companion."""
        return self._stays(node.companion[0])

    def slope(self, node: Node) -> Term:
        """``k a[k]``; of a state, its rate."""
        return self._rates.get(node) or self.times(self.of(node), 1.0)

    def interior(self, a: Series, b: Series) -> list[Term]:
        """One sum of phase A."""
        pair = (self._canonical(a), self._canonical(b))
        swapped = pair[::-1]
        if pair not in self._sums and swapped not in self._sums:
            symbol = ca.SX.sym(f"S{len(self.sums)}")
            self.sums.append((symbol, *pair))
            self._sums[pair] = Term(symbol)
        return [self._sums[pair if pair in self._sums else swapped]]

    def square(self, node: Node, own: Term) -> Term:
        """The sum over the inner orders, and the outer product twice."""
        series = (node, Kind.VALUE)
        return total([(self.first(node) * own).times(2.0), *self.interior(series, series)])

    def times(self, term: Term, slope: float) -> Term:
        """Product with the symbol of ``slope k``."""
        k = Term(self.k)
        return term * (k if slope == 1.0 else k.times(slope))

    def per_order(self, term: Term) -> Term:
        """Product with the symbol of 1/k."""
        return term * Term(self.per_k)

    def over(self, term: Term, divisor: Term) -> Term:
        """Product with an inverse that stays for all orders."""
        return term * self._stays(number(1.0) / self._meant(divisor))

    def factor(self, factor: Factor) -> Term:
        """Its expression at order 0."""
        return self._stays(factor.term)

    def extended(self, node: Node) -> None:
        """Compute a node's coefficients."""
        own, beside = self.extend(node)
        self.values[node] = own
        if beside is not None:
            self.beside[node] = beside

    def coefficient(self, series: Series) -> ca.SX:
        """Coefficient k of a series that a sum reads."""
        node, kind = series
        if kind is Kind.COMPANION:
            return self.beside[node].value
        return (self.of(node) if kind is Kind.VALUE else self.slope(node)).value

    def _stays(self, term: Term) -> Term:
        value = term.value
        if value.is_constant():
            return Term(value)
        key = value.element_hash()
        if key not in self._fixed:
            symbol = ca.SX.sym(f"r{len(self.fixed)}")
            self.fixed.append((symbol, value))
            self._fixed[key] = Term(symbol)
        return self._fixed[key]

    def _meant(self, term: Term) -> Term:
        """What an expression of symbols that stay is at order 0."""
        if not self.fixed:
            return term
        symbols, values = zip(*self.fixed, strict=True)
        (value,) = ca.substitute([term.value], [ca.vertcat(*symbols)], [ca.vertcat(*values)])
        return Term(value)

    def _canonical(self, series: Series) -> Series:
        node, kind = series
        if kind is Kind.COMPANION and node in self._partner:
            return self._partner[node], Kind.VALUE
        return series


def _partners(nodes: Sequence[Node]) -> dict[Node, Node]:
    """Sine and cosine of one argument, hyperbolic ones too: each is the other's companion."""
    found = {(node.operation, node.operands[0]): node for node in nodes if node.operands}
    opposite = {"sin": "cos", "cos": "sin", "sinh": "cosh", "cosh": "sinh"}
    return {
        node: found[opposite[operation], a]
        for (operation, a), node in found.items()
        if operation in opposite and (opposite[operation], a) in found
    }


def compact_function(
    name: str,
    function: ca.Function,
    order: int,
    *,
    time: str = "t",
    state: str,
    neutral: Entry | None = None,
) -> Compact:
    """What `taylor.taylor_function` gives, as two phases per order.

    Raises:
        ModelError: for an operation without a recurrence.
    """
    system = expand(function, time=time, state=state, neutral=neutral)
    phase = _Phase(system)
    for node in system.moving:
        phase.extended(node)
    row = [phase.of(node).value for node in system.channels]
    rates = [phase.of(node).value for node in system.rates]
    series: dict[Series, int] = {}
    for _, a, b in phase.sums:
        series.setdefault(a, len(series))
        series.setdefault(b, len(series))
    stored = [phase.coefficient(item) for item in series]
    sums = ca.vertcat(*(symbol for symbol, _, _ in phase.sums))
    fixed = ca.vertcat(*(symbol for symbol, _ in phase.fixed))
    scalars = ca.vertcat(phase.k, phase.per_k, phase.tau)
    results = [_column(entries) for entries in (row, rates, stored)]
    rise = ca.Function(
        f"{name}_rise",
        [scalars, phase.q, fixed, sums],
        ca.cse(results),
        ["k", "q", "r", "S"],
        ["c", "q_next", "a"],
    )
    first = [
        [node[0].value for node in system.channels],
        [node[0].value for node in system.rates],
        [value for _, value in phase.fixed],
    ]
    start = ca.Function(
        f"{name}_start",
        list(system.inputs),
        ca.cse([_column(entries) for entries in first]),
        list(system.labels),
        ["c", "q", "r"],
    )
    return Compact(name, order, start, rise, tuple((series[a], series[b]) for _, a, b in phase.sums))


def compact_where_long(
    name: str,
    function: ca.Function,
    order: int,
    *,
    time: str = "t",
    state: str,
    neutral: Entry | None = None,
) -> Compact | None:
    """The compact kernel where straight lines would be more than `MOST_STRAIGHT`, else None.

    Raises:
        ModelError: for an operation without a recurrence.
    """
    compact = compact_function(name, function, order, time=time, state=state, neutral=neutral)
    return compact if compact.operations > MOST_STRAIGHT else None


def _column(entries: Sequence[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
