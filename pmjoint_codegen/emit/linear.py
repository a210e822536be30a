"""Linear expressions above order 0, and products that differ only by constant factors.

Order 0 is computed as the right-hand side is written. Above it, constants fall out of sums, so that linear
expressions can be multiplied out where that saves operations (`affine`), and one product of moving quantities
can serve all its multiples.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from pmjoint_codegen.emit.affine import Combination, Factor, factor, inverse, one, shortest
from pmjoint_codegen.emit.recurrences import Node, divide, invert, multiply, square
from pmjoint_codegen.emit.terms import number


@dataclass(frozen=True)
class Product:
    """A product, square, quotient or inverse of moving nodes.

    Attributes:
        operation: its name in the table.
        operands: without their constant factors.
    """

    operation: str
    operands: tuple[Node, ...]

    @property
    def key(self) -> Hashable:
        """What equal products have in common: the factors of a product in any order."""
        return self.operation, frozenset(self.operands) if self.operation == "mul" else self.operands


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


def _unscaled(node: Node) -> tuple[Node, Factor]:
    """A node as a constant factor times another one, as far down as that goes; sums are no multiples."""
    by = one()
    while node.operands and not node.constant and node.operation not in ("add", "sub"):
        parts = _parts(node)
        if parts is None:
            break
        ((node, inner),) = parts
        by = by * inner
    return node, by


def _product(node: Node) -> tuple[Product, Factor] | None:
    """A product or quotient of moving nodes without constant factors, and these factors' product."""
    a, b = node.operands[0], node.operands[-1]
    if node.operation in ("mul", "sq") and not (a.constant or b.constant):
        (left, by), (right, times) = _unscaled(a), _unscaled(b)
        if left is right:
            return Product("sq", (left,)), by * times
        return Product("mul", (left, right)), by * times
    if node.operation not in ("div", "inv") or b.constant:
        return None
    right, times = _unscaled(b)
    if node.operation == "inv":
        return Product("inv", (right,)), times.inverted()
    if a.constant:
        return Product("inv", (right,)), _constant_factor(a) * times.inverted()
    left, by = _unscaled(a)
    return Product("div", (left, right)), by * times.inverted()


def shared(nodes: Sequence[Node]) -> tuple[list[Node], dict[Node, list[tuple[Node, Factor]]]]:
    """Write products and quotients that differ only by constant factors as multiples of one.

    Returns:
        the nodes, with those that are new before their first multiple, and each multiple as a sum.
    """
    forms = {node: form for node in nodes if not node.constant and (form := _product(node))}
    uses = Counter(product.key for product, _ in forms.values())
    rules = {"mul": multiply, "sq": square, "div": divide, "inv": invert}
    result: list[Node] = []
    chosen: dict[Hashable, Node] = {}
    multiples: dict[Node, list[tuple[Node, Factor]]] = {}
    for node in nodes:
        product, by = forms.get(node, (None, one()))
        if product is not None and uses[product.key] > 1:
            if product.key not in chosen:
                chosen[product.key] = Node(
                    rules[product.operation], product.operands, operation=product.operation
                )
                chosen[product.key].begin()
                result.append(chosen[product.key])
            multiples[node] = [(chosen[product.key], by)]
        result.append(node)
    return result, multiples


def _past_neutral(
    node: Node, by: Factor, linear: Mapping[Node, list[tuple[Node, Factor]]]
) -> tuple[Node, Factor]:
    """A multiple of a node, past neutral factors: so they change no order in which a sum is added."""
    while node in linear and len(linear[node]) == 1 and linear[node][0][1].neutral:
        ((node, inner),) = linear[node]
        by = by * inner
    return node, by


def simplify(
    nodes: Sequence[Node], multiples: Mapping[Node, list[tuple[Node, Factor]]], asked: Iterable[Node]
) -> None:
    """Replace linear recurrences above order 0 by the shortest combinations of the required values."""
    linear = dict(multiples)
    for node in nodes:
        parts = None if node.constant or node in linear else _parts(node)
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
    for node in nodes:
        parts = linear.get(node)
        if parts is None:
            continue
        form: Combination = {}
        for direct, by in parts:
            part, times = _past_neutral(direct, by, linear)
            key = name(part)
            form[key] = form[key] + times if key in form else times
        forms[name(node)] = form
    needed = [*asked, *(operand for node in nodes if node not in linear for operand in node.operands)]
    kept = shortest(forms, [place[node] for node in needed if node in linear])
    for key in forms:
        known[key].absorbed = key not in kept
    for key, form in kept.items():
        known[key].sum = tuple((known[part], times) for part, times in form.items())
