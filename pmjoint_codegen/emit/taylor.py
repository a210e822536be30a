"""Taylor coefficients of an ordinary differential equation, as one straight-line CasADi function.

The right-hand side is a list of elementary operations, its tape. Each operation has a recurrence
(`recurrences`) that gives its k-th normalised coefficient ``a[k] = (d^k a / dt^k) / k!`` from
lower ones; the state follows by ``x[k+1] = x'[k] / (k+1)``. Running the list for k = 0, 1, ..., N on symbols
instead of numbers yields all coefficients exactly, with no truncation error in any of them.

Order 0 is computed as the right-hand side is written. Above it, constants fall out of sums, and linear
expressions are multiplied out where that saves operations (`affine`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from pmjoint_codegen.emit import recurrences
from pmjoint_codegen.emit.affine import (
    MODULUS,
    PRIME,
    Entry,
    Factor,
    inverse,
    joined,
    residue_named,
    residue_of,
    residue_of_result,
)
from pmjoint_codegen.emit.linear import shared, simplify
from pmjoint_codegen.emit.recurrences import Kind, Node, Order, Series
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.emit.terms import Term, total
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.operations import Operation, by_name, remedy


@dataclass(frozen=True)
class Graph:
    """A CasADi function as nodes in evaluation order.

    Attributes:
        nodes: every operation, operands before users.
        outputs: node of each output entry, one list per output.
    """

    nodes: tuple[Node, ...]
    outputs: tuple[tuple[Node, ...], ...]


def build_graph(tape: Tape, leaves: Mapping[tuple[int, int], Node]) -> Graph:
    """Read a function's tape.

    Args:
        tape: of a function with dense inputs and outputs.
        leaves: node of each input entry, keyed by (input, entry).

    Raises:
        ModelError: for an operation without a recurrence: it is not analytic, or unknown here.
    """
    known = by_name()
    nodes: list[Node] = []
    values: list[Node] = []
    outputs = [[literal(0.0)] * size for _, size in tape.outputs]
    for item in tape.instructions:
        if item.operation == "input":
            values.append(leaves[item.operands[0], item.operands[1]])
        elif item.operation == "output":
            result, entry, value = item.operands
            outputs[result][entry] = values[value]
        elif item.operation == "const":
            values.append(literal(item.value))
        else:
            values.append(_operation(known[item.operation], [values[i] for i in item.operands]))
            nodes.append(values[-1])
    return Graph(tuple(nodes), tuple(tuple(entries) for entries in outputs))


def _operation(operation: Operation, operands: list[Node]) -> Node:
    constant = all(node.constant for node in operands)
    if operation.recurrence is None and not constant:
        raise ModelError(
            what=f"operation {operation.name} of the right-hand side has no Taylor recurrence",
            where="continuous integrator",
            remedy=f"{remedy()}: they are analytic",
        )
    exponent = 0.0
    if operation.name == "pow":
        operands, exponent = operands[:1], float(operands[1][0].value)
    node = Node(
        operation.recurrence and operation.recurrence(recurrences),
        tuple(operands),
        constant=constant,
        exponent=exponent,
        operation=operation.name,
    )
    if node.constant:
        node.residue = _residue(node)
    return node


def leaf(*series: ca.SX, moving: bool = False) -> Node:
    """A node whose coefficients are inputs: a parameter, time, or a state's entry."""
    return Node(None, series=[Term(value) for value in series], constant=not moving)


def literal(value: float) -> Node:
    """A node that is a number."""
    node = leaf(ca.SX(value))
    node.residue = residue_of(value)
    return node


def _residue(node: Node) -> int:
    """Residue of a constant from those of its operands."""
    a, b = (node.operands[0].residue, node.operands[-1].residue)
    exact = {
        "add": lambda: a + b,
        "sub": lambda: a - b,
        "neg": lambda: -a,
        "twice": lambda: 2 * a,
        "mul": lambda: a * b,
        "sq": lambda: a * a,
        "div": lambda: a * inverse(b),
        "inv": lambda: inverse(a),
    }.get(node.operation)
    return exact() % MODULUS if exact else residue_of_result((node.operation, node.exponent), a, b)


@dataclass(frozen=True)
class Expansion:
    """A right-hand side, ready for coefficients of any order: order 0 is computed, sums are simplified.

    Attributes:
        inputs: CasADi symbols of the function's arguments.
        labels: their names.
        nodes: operations in evaluation order.
        states: entries of the state.
        rates: their rates.
        channels: the state's entries, then those of the other results.
    """

    inputs: tuple[ca.SX, ...]
    labels: tuple[str, ...]
    nodes: tuple[Node, ...]
    states: tuple[Node, ...]
    rates: tuple[Node, ...]
    channels: tuple[Node, ...]

    @property
    def moving(self) -> list[Node]:
        """The nodes whose coefficients above order 0 are needed, in evaluation order."""
        return [node for node in self.nodes if not (node.constant or node.absorbed)]


def expand(function: ca.Function, *, time: str = "t", state: str, neutral: Entry | None = None) -> Expansion:
    """Read a right-hand side.

    Args:
        function: SX function with dense inputs; output 0 is the rate of input ``state``, the others are
            carried along.
        time: name of the input that is time.
        state: name of the input that is the state.
        neutral: label and index of a parameter that is 1 unless it is set; see `affine`.

    Raises:
        ModelError: for an operation without a recurrence.
    """
    inputs = [ca.SX.sym(label, function.size1_in(i)) for i, label in enumerate(function.name_in())]
    leaves = {
        (i, entry): _input_leaf(inputs[i][entry], label, entry, time, state)
        for i, label in enumerate(function.name_in())
        for entry in range(inputs[i].numel())
    }
    if neutral is not None and neutral[0] in function.name_in():
        node = leaves[function.index_in(neutral[0]), neutral[1]]
        node.residue = joined(node.residue % PRIME, 1)
        node.series = [Term(node[0].value, neutral=True)]
    states = [leaves[function.index_in(state), entry] for entry in range(function.size1_in(state))]
    graph = build_graph(tape_of(function), leaves)
    for node, rate in zip(states, graph.outputs[0], strict=True):
        node.rate = rate
    for node in graph.nodes:
        node.begin()
    nodes, multiples = shared(graph.nodes)
    simplify(nodes, multiples, [node for entries in graph.outputs for node in entries])
    channels = [*states, *(node for entries in graph.outputs[1:] for node in entries)]
    return Expansion(
        tuple(inputs),
        tuple(function.name_in()),
        tuple(nodes),
        tuple(states),
        graph.outputs[0],
        tuple(channels),
    )


@dataclass(frozen=True)
class At(Order):
    """Order k on numbers' symbols: every coefficient is an expression of its own.

    Attributes:
        k: the order.
    """

    k: int

    def of(self, node: Node) -> Term:
        """Coefficient k."""
        return node[self.k]

    def first(self, node: Node) -> Term:
        """Coefficient 0."""
        return node[0]

    def companion(self, node: Node) -> Term:
        """Coefficient 0 of the companion."""
        return node.companion[0]

    def slope(self, node: Node) -> Term:
        """``k a[k]``."""
        return self._coefficient((node, Kind.SLOPE), self.k)

    def interior(self, a: Series, b: Series) -> list[Term]:
        """Every product."""
        return [self._coefficient(a, j) * self._coefficient(b, self.k - j) for j in range(1, self.k)]

    def square(self, node: Node, own: Term) -> Term:
        """Half of the products, doubled, and the middle one."""
        series = [*(node[j] for j in range(self.k)), own]
        half = range((self.k + 1) // 2)
        pairs = total([series[j] * series[self.k - j] for j in half]).times(2.0)
        middle = series[self.k // 2]
        return pairs if self.k % 2 else total([pairs, middle * middle])

    def times(self, term: Term, slope: float) -> Term:
        """Product with a number."""
        return term.times(slope * self.k)

    def per_order(self, term: Term) -> Term:
        """Product with a number."""
        return term.times(1 / self.k)

    def over(self, term: Term, divisor: Term) -> Term:
        """Product with the inverse."""
        return term.over(divisor)

    def factor(self, factor: Factor) -> Term:
        """Its expression."""
        return factor.term

    def _coefficient(self, series: Series, j: int) -> Term:
        node, kind = series
        if kind is Kind.COMPANION:
            return node.companion[j]
        if kind is Kind.VALUE:
            return node[j]
        return node[j].times(float(j)) if node.rate is None else node.rate[j - 1]


def taylor_function(
    name: str,
    function: ca.Function,
    order: int,
    *,
    time: str = "t",
    state: str,
    neutral: Entry | None = None,
) -> ca.Function:
    """A function of the same inputs that returns Taylor coefficients instead of rates.

    Args:
        name: name of the new function.
        function: what `expand` takes.
        order: highest coefficient N.
        time: name of the input that is time.
        state: name of the input that is the state.
        neutral: as `expand` takes it.

    Returns:
        Function of the same inputs with one output ``c`` of length ``(N + 1) * channels``; row k holds the
        k-th coefficients of the state's entries, then of the other outputs' entries.

    Raises:
        ModelError: for an operation without a recurrence.
    """
    system = expand(function, time=time, state=state, neutral=neutral)
    for k in range(1, order + 1):
        for node, rate in zip(system.states, system.rates, strict=True):
            node.series.append(rate[k - 1].times(1 / k))
        for node in system.moving:
            own, beside = At(k).extend(node)
            node.series.append(own)
            if beside is not None:
                node.companion.append(beside)
    rows = [node[k].value for k in range(order + 1) for node in system.channels]
    return ca.Function(name, list(system.inputs), [ca.cse(ca.vertcat(*rows))], list(system.labels), ["c"])


def _input_leaf(symbol: ca.SX, label: str, entry: int, time: str, state: str) -> Node:
    if label == time:
        return leaf(symbol, ca.SX(1), moving=True)
    node = leaf(symbol, moving=label == state)
    node.residue = residue_named(label, entry)
    return node
