"""Taylor coefficients of an ordinary differential equation, as one straight-line CasADi function.

The right-hand side is a list of elementary operations (CasADi's own instruction list). Each operation has a
recurrence that gives its k-th normalised coefficient ``a[k] = (d^k a / dt^k) / k!`` from lower ones; the
state follows by ``x[k+1] = x'[k] / (k+1)``. Running the list for k = 0, 1, ..., N on symbols instead of
numbers yields all coefficients exactly, with no truncation error in any of them.

Recurrences: Moore, Interval Analysis (1966); Jorba and Zou, Experimental Mathematics 14 (2005), Proposition
    2.1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

from pmjoint_codegen.errors import ModelError

Series = list[ca.SX]
Recurrence = Callable[["Node", int], ca.SX]


@dataclass
class Node:
    """One operation of the right-hand side, with the coefficients computed so far.

    Attributes:
        recurrence: gives coefficient k from the operands' coefficients up to k and its own below k.
        operands: nodes that it reads.
        series: coefficients 0..k.
        constant: whether only coefficient 0 can differ from zero.
        companion: second series of a coupled pair, such as the cosine beside a sine.
        exponent: of a constant power.
    """

    recurrence: Recurrence
    operands: tuple[Node, ...] = ()
    series: Series = field(default_factory=list)
    constant: bool = False
    companion: Series = field(default_factory=list)
    exponent: float = 0.0

    def __getitem__(self, k: int) -> ca.SX:
        """Coefficient k; beyond a constant's (or time's) own coefficients there are zeros."""
        return self.series[k] if k < len(self.series) else ca.SX(0)

    def extend(self, k: int) -> None:
        """Compute coefficient k, all lower ones being known."""
        if not (self.constant and k > 0):
            self.series.append(self.recurrence(self, k))


def convolve(
    a: Sequence[ca.SX] | Node, b: Sequence[ca.SX] | Node, k: int, first: int = 0, last: int | None = None
) -> ca.SX:
    """``sum_j a[j] b[k-j]`` for j = first..last (k by default)."""
    total = ca.SX(0)
    for j in range(first, (k if last is None else last) + 1):
        total += a[j] * b[k - j]
    return total


def _weighted(a: Node, b: Sequence[ca.SX], k: int) -> ca.SX:
    """``(1/k) sum_{j=1..k} j a[j] b[k-j]``: coefficient k of the primitive of a' b."""
    total = ca.SX(0)
    for j in range(1, k + 1):
        total += (j * a[j]) * b[k - j]
    return total * (1 / k)


def _multiply(node: Node, k: int) -> ca.SX:
    a, b = node.operands
    if a.constant:
        return a[0] * b[k]
    if b.constant:
        return a[k] * b[0]
    return convolve(a, b, k)


def _square(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    pairs = 2 * convolve(a, a, k, 0, (k - 1) // 2) if k > 0 else ca.SX(0)
    return pairs + a[k // 2] * a[k // 2] if k % 2 == 0 else pairs


def _divide(node: Node, k: int) -> ca.SX:
    a, b = node.operands
    if b.constant and k > 0:
        return a[k] * (1 / b[0])
    return (a[k] - convolve(b, node.series, k, 1)) / b[0]


def _invert(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    return 1 / a[0] if k == 0 else -convolve(a, node.series, k, 1) * node.series[0]


def _sine(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    node.companion.append(ca.cos(a[0]) if k == 0 else -_weighted(a, node.series, k))
    return ca.sin(a[0]) if k == 0 else _weighted(a, node.companion, k)


def _cosine(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    node.companion.append(ca.sin(a[0]) if k == 0 else _weighted(a, node.series, k))
    return ca.cos(a[0]) if k == 0 else -_weighted(a, node.companion, k)


def _exponential(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    return ca.exp(a[0]) if k == 0 else _weighted(a, node.series, k)


def _logarithm(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    if k == 0:
        return ca.log(a[0])
    inner = ca.SX(0)
    for j in range(1, k):
        inner += (j * node.series[j]) * a[k - j]
    return (a[k] - inner * (1 / k)) / a[0]


def _root(node: Node, k: int) -> ca.SX:
    a = node.operands[0]
    return (
        ca.sqrt(a[0])
        if k == 0
        else (a[k] - convolve(node.series, node.series, k, 1, k - 1)) / (2 * node.series[0])
    )


def _tangent_like(function: Callable[[ca.SX], ca.SX], sign: int) -> Recurrence:
    """``f' = (1 + sign f^2) a'``: tan with +1, tanh with -1; the companion holds f^2."""

    def recurrence(node: Node, k: int) -> ca.SX:
        a = node.operands[0]
        own = function(a[0]) if k == 0 else a[k] + sign * _weighted(a, node.companion, k)
        node.companion.append(convolve([*node.series, own], [*node.series, own], k))
        return own

    return recurrence


def _magnitude(node: Node, k: int) -> ca.SX:
    """|a| is a or -a away from its kink, and takes the slope 0 on it."""
    a = node.operands[0]
    return ca.fabs(a[0]) if k == 0 else ca.sign(a[0]) * a[k]


def _sign(node: Node, k: int) -> ca.SX:
    return ca.sign(node.operands[0][0]) if k == 0 else ca.SX(0)


def _constant_power(node: Node, k: int) -> ca.SX:
    a, exponent = node.operands[0], node.exponent
    if k == 0:
        return a[0] ** exponent
    total = ca.SX(0)
    for j in range(k):
        total += (k * exponent - j * (exponent + 1)) * (a[k - j] * node.series[j])
    return total / (k * a[0])


def _recurrences() -> Mapping[int, Recurrence]:
    return {
        ca.OP_ASSIGN: lambda node, k: node.operands[0][k],
        ca.OP_ADD: lambda node, k: node.operands[0][k] + node.operands[1][k],
        ca.OP_SUB: lambda node, k: node.operands[0][k] - node.operands[1][k],
        ca.OP_NEG: lambda node, k: -node.operands[0][k],
        ca.OP_TWICE: lambda node, k: 2 * node.operands[0][k],
        ca.OP_MUL: _multiply,
        ca.OP_SQ: _square,
        ca.OP_DIV: _divide,
        ca.OP_INV: _invert,
        ca.OP_SIN: _sine,
        ca.OP_COS: _cosine,
        ca.OP_TAN: _tangent_like(ca.tan, 1),
        ca.OP_TANH: _tangent_like(ca.tanh, -1),
        ca.OP_EXP: _exponential,
        ca.OP_LOG: _logarithm,
        ca.OP_SQRT: _root,
        ca.OP_CONSTPOW: _constant_power,
        ca.OP_FABS: _magnitude,
        ca.OP_SIGN: _sign,
    }


@dataclass(frozen=True)
class Graph:
    """A CasADi function as nodes in evaluation order.

    Attributes:
        nodes: every operation, operands before users.
        outputs: node of each output entry, one list an output.
    """

    nodes: tuple[Node, ...]
    outputs: tuple[tuple[Node, ...], ...]


def build_graph(function: ca.Function, leaves: Mapping[tuple[int, int], Node]) -> Graph:
    """Read a function's instruction list.

    Args:
        function: an SX function with dense inputs and outputs.
        leaves: node of each input entry, keyed by (input, entry).

    Raises:
        ModelError: for an operation without a recurrence; it is not analytic, or not known here.
    """
    recurrences = _recurrences()
    nodes: list[Node] = []
    register: dict[int, Node] = {}
    outputs: list[list[Node]] = [[leaf(ca.SX(0))] * function.nnz_out(i) for i in range(function.n_out())]
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_INPUT:
            register[writes[0]] = leaves[reads[0], reads[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[writes[0]][writes[1]] = register[reads[0]]
        elif operation == ca.OP_CONST:
            register[writes[0]] = leaf(ca.SX(function.instruction_constant(position)))
        else:
            register[writes[0]] = _operation(operation, [register[i] for i in reads], recurrences)
            nodes.append(register[writes[0]])
    return Graph(tuple(nodes), tuple(tuple(entries) for entries in outputs))


def _operation(operation: int, operands: list[Node], recurrences: Mapping[int, Recurrence]) -> Node:
    if operation in (ca.OP_POW, ca.OP_CONSTPOW):
        exponent = operands[1][0]
        return Node(_constant_power, (operands[0],), exponent=float(exponent), constant=operands[0].constant)
    if operation not in recurrences:
        raise ModelError(
            what=f"operation {operation} of the right-hand side has no Taylor recurrence",
            where="continuous integrator",
            remedy="use analytic functions: + - * / **, sin, cos, tan, exp, log, sqrt, tanh",
        )
    return Node(recurrences[operation], tuple(operands), constant=all(node.constant for node in operands))


def leaf(*series: ca.SX, moving: bool = False) -> Node:
    """A node whose coefficients come from outside: a number, a parameter, time, or a state's entry."""
    return Node(lambda _node, _k: ca.SX(0), series=list(series), constant=not moving)


def taylor_function(
    name: str, function: ca.Function, order: int, *, time: str = "t", state: str
) -> ca.Function:
    """A function of the same inputs that returns Taylor coefficients instead of rates.

    Args:
        name: name of the new function.
        function: SX function with dense inputs; output 0 is the rate of input ``state``, the others are
            carried along.
        order: highest coefficient N.
        time: name of the input that is time.
        state: name of the input that is the state.

    Returns:
        Function of the same inputs with one output ``c`` of length ``(N + 1) * channels``; row k holds the
        k-th coefficients of the state's entries, then of the other outputs' entries.

    Raises:
        ModelError: for an operation without a recurrence.
    """
    inputs = [ca.SX.sym(label, function.size1_in(i)) for i, label in enumerate(function.name_in())]
    leaves = {
        (i, entry): _input_leaf(inputs[i][entry], label, time, state)
        for i, label in enumerate(function.name_in())
        for entry in range(inputs[i].numel())
    }
    states = [leaves[function.index_in(state), entry] for entry in range(function.size1_in(state))]
    graph = build_graph(function, leaves)
    for k in range(order + 1):
        for node in graph.nodes:
            node.extend(k)
        for node, rate in zip(states, graph.outputs[0], strict=True):
            node.series.append(rate[k] * (1 / (k + 1)))
    channels = [*states, *(node for entries in graph.outputs[1:] for node in entries)]
    rows = [node[k] for k in range(order + 1) for node in channels]
    return ca.Function(name, inputs, [ca.cse(ca.vertcat(*rows))], function.name_in(), ["c"])


def _input_leaf(symbol: ca.SX, label: str, time: str, state: str) -> Node:
    if label == time:
        return leaf(symbol, ca.SX(1), moving=True)
    return leaf(symbol, moving=label == state)
