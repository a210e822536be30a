"""Taylor coefficients of an ordinary differential equation, as one straight-line CasADi function.

The right-hand side is a list of elementary operations, its tape. Each operation has a recurrence
(`recurrences`) that gives its k-th normalised coefficient ``a[k] = (d^k a / dt^k) / k!`` from
lower ones; the state follows by ``x[k+1] = x'[k] / (k+1)``. Running the list for k = 0, 1, ..., N on symbols
instead of numbers yields all coefficients exactly, with no truncation error in any of them.

Order 0 is computed as the right-hand side stands. Above it, constants fall out of sums, and linear
expressions are multiplied out where that saves operations (`affine`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from pmjoint_codegen.emit import recurrences
from pmjoint_codegen.emit.affine import (
    PRIME,
    Combination,
    Factor,
    factor,
    inverse,
    one,
    residue_named,
    residue_of,
    shortest,
)
from pmjoint_codegen.emit.recurrences import Node
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.emit.terms import Term, number
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.operations import Operation, by_name, remedy


@dataclass(frozen=True)
class Graph:
    """A CasADi function as nodes in evaluation order.

    Attributes:
        nodes: every operation, operands before users.
        outputs: node of each output entry, one list an output.
    """

    nodes: tuple[Node, ...]
    outputs: tuple[tuple[Node, ...], ...]


def build_graph(tape: Tape, leaves: Mapping[tuple[int, int], Node]) -> Graph:
    """Read a function's tape.

    Args:
        tape: of a function with dense inputs and outputs.
        leaves: node of each input entry, keyed by (input, entry).

    Raises:
        ModelError: for an operation without a recurrence; it is not analytic, or not known here.
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
    if operation.recurrence is None:
        raise ModelError(
            what=f"operation {operation.name} of the right-hand side has no Taylor recurrence",
            where="continuous integrator",
            remedy=f"{remedy()}: they are analytic",
        )
    exponent = 0.0
    if operation.name == "pow":
        operands, exponent = operands[:1], float(operands[1][0].value)
    node = Node(
        operation.recurrence(recurrences),
        tuple(operands),
        constant=all(node.constant for node in operands),
        exponent=exponent,
        operation=operation.name,
    )
    if node.constant:
        node.residue = _residue(node)
    return node


def leaf(*series: ca.SX, moving: bool = False) -> Node:
    """A node whose coefficients come from outside: a parameter, time, or a state's entry."""
    return Node(lambda _node, _k: number(0.0), series=[Term(value) for value in series], constant=not moving)


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
    return exact() % PRIME if exact else residue_named(node.operation, node.exponent, a, b)


def _constant_factor(node: Node, *, inverted: bool = False) -> Factor:
    if inverted:
        return factor(inverse(node.residue), number(1.0) / node[0])
    return factor(node.residue, node[0])


def _parts(node: Node) -> list[tuple[Node, Factor]] | None:
    """A linear operation as a sum of moving nodes with constant factors; None for any other operation."""
    a, b = node.operands[0], node.operands[-1]
    if node.operation == "mul" and (a.constant or b.constant):
        moving, fixed = (b, a) if a.constant else (a, b)
        return [(moving, _constant_factor(fixed))]
    if node.operation == "div" and b.constant:
        return [(a, _constant_factor(b, inverted=True))]
    plus = one()
    signed = {
        "neg": [(a, -plus)],
        "twice": [(a, factor(2, number(2.0)))],
        "add": [(a, plus), (b, plus)],
        "sub": [(a, plus), (b, -plus)],
    }.get(node.operation)
    return None if signed is None else [(part, sign) for part, sign in signed if not part.constant]


def _simplify(graph: Graph) -> None:
    """Replace linear recurrences above order 0 by the shortest combinations."""
    linear = {}
    for node in graph.nodes:
        parts = None if node.constant else _parts(node)
        if parts is not None:
            linear[node] = parts
    known: list[Node] = []
    place: dict[Node, int] = {}

    def name(node: Node) -> int:
        if node not in place:
            place[node] = len(known)
            known.append(node)
        return place[node]

    forms: dict[int, Combination] = {}
    for node, parts in linear.items():
        form: Combination = {}
        for part, times in parts:
            key = name(part)
            form[key] = form[key] + times if key in form else times
        forms[name(node)] = form
    asked = [node for entries in graph.outputs for node in entries]
    asked += [operand for node in graph.nodes if node not in linear for operand in node.operands]
    kept = shortest(forms, [place[node] for node in asked if node in linear])
    for key in forms:
        known[key].absorbed = key not in kept
    for key, form in kept.items():
        known[key].sum = tuple((known[part], times) for part, times in form.items())


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
        (i, entry): _input_leaf(inputs[i][entry], label, entry, time, state)
        for i, label in enumerate(function.name_in())
        for entry in range(inputs[i].numel())
    }
    states = [leaves[function.index_in(state), entry] for entry in range(function.size1_in(state))]
    graph = build_graph(tape_of(function), leaves)
    for node, rate in zip(states, graph.outputs[0], strict=True):
        node.rate = rate
    for node in graph.nodes:
        if node.constant:
            node.extend(0)
    _simplify(graph)
    for k in range(order + 1):
        for node in graph.nodes:
            if not (node.constant and k == 0):
                node.extend(k)
        for node, rate in zip(states, graph.outputs[0], strict=True):
            node.series.append(rate[k].times(1 / (k + 1)))
    channels = [*states, *(node for entries in graph.outputs[1:] for node in entries)]
    rows = [node[k].value for k in range(order + 1) for node in channels]
    return ca.Function(name, inputs, [ca.cse(ca.vertcat(*rows))], function.name_in(), ["c"])


def _input_leaf(symbol: ca.SX, label: str, entry: int, time: str, state: str) -> Node:
    if label == time:
        return leaf(symbol, ca.SX(1), moving=True)
    node = leaf(symbol, moving=label == state)
    node.residue = residue_named(label, entry)
    return node
