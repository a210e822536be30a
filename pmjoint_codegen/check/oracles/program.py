"""Named equations as a straight-line program over any algebra: numbers of 60 digits, or power series of them.

This is the reference for generated code. It comes only from the SymPy expressions of the derivation, without
CasADi. So an error in the translation to CasADi, in CasADi itself, in its C printer or in the C compiler
shows as a difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import sympy as sp

from pmjoint_derive import Equations


class Algebra(Protocol):
    """The arithmetic of a program."""

    def constant(self, value: sp.Expr) -> Any:
        """An exact number."""

    def add(self, a: Any, b: Any) -> Any:
        """Sum."""

    def multiply(self, a: Any, b: Any) -> Any:
        """Product."""

    def power(self, a: Any, exponent: sp.Rational) -> Any:
        """Power with a constant rational exponent."""

    def apply(self, function: str, *arguments: Any) -> Any:
        """A function by the name of SymPy's class."""


@dataclass(frozen=True)
class Operation:
    """One step: an operation, its operands among earlier steps, a constant.

    Attributes:
        kind: ``input``, ``constant``, ``add``, ``multiply``, ``power`` or a function's name.
        operands: indices of earlier steps.
        payload: the symbol, number or exponent.
    """

    kind: str
    operands: tuple[int, ...] = ()
    payload: Any = None


@dataclass(frozen=True)
class Program:
    """Straight-line form of some expressions.

    Attributes:
        operations: in order.
        results: index of each expression.
    """

    operations: tuple[Operation, ...]
    results: tuple[int, ...]

    def run(self, algebra: Algebra, inputs: Mapping[sp.Symbol, Any]) -> list[Any]:
        """Evaluate every expression.

        Args:
            algebra: the arithmetic.
            inputs: value of each input symbol.
        """
        values: list[Any] = []
        for step in self.operations:
            operands = [values[place] for place in step.operands]
            values.append(_evaluate(step, operands, algebra, inputs))
        return [values[place] for place in self.results]


def _evaluate(step: Operation, operands: list[Any], algebra: Algebra, inputs: Mapping[sp.Symbol, Any]) -> Any:
    if step.kind == "input":
        return inputs[step.payload]
    if step.kind == "constant":
        return algebra.constant(step.payload)
    if step.kind == "power":
        return algebra.power(operands[0], step.payload)
    if step.kind not in ("add", "multiply"):
        return algebra.apply(step.kind, *operands)
    combine = algebra.add if step.kind == "add" else algebra.multiply
    result = operands[0]
    for operand in operands[1:]:
        result = combine(result, operand)
    return result


def compile_program(
    expressions: Sequence[sp.Expr],
    inputs: Sequence[sp.Symbol],
    equations: Equations,
    given: Mapping[sp.Symbol, sp.Expr] | None = None,
    sides: Mapping[sp.Expr, sp.Symbol] | None = None,
) -> Program:
    """Flatten expressions, following names to their equations.

    Args:
        expressions: what to evaluate.
        inputs: symbols whose values are given.
        equations: definitions of all other names.
        given: definitions with priority over them.
        sides: argument of a kink -> the input that gives its side.

    Raises:
        KeyError: for a name that is neither an input nor defined.
    """
    known, definitions, places_of_sides = set(inputs), given or {}, sides or {}
    operations: list[Operation] = []
    places: dict[sp.Expr, int] = {}

    def place(value: sp.Expr) -> int:
        if value not in places:
            places[value] = build(value)
        return places[value]

    def emit(*step: Any) -> int:
        operations.append(Operation(*step))
        return len(operations) - 1

    def build(value: sp.Expr) -> int:
        if value in known:
            return emit("input", (), value)
        if value.is_Symbol:
            return place(definitions[value] if value in definitions else equations[value.name].expression)
        if value.is_number:
            return emit("constant", (), value)
        if value.is_Add or value.is_Mul:
            return emit("add" if value.is_Add else "multiply", tuple(place(item) for item in value.args))
        if value.is_Pow and value.exp.is_Rational:
            return emit("power", (place(value.base),), value.exp)
        if value.is_Pow:
            return place(sp.exp(value.exp * sp.log(value.base), evaluate=False))
        if isinstance(value, sp.Abs | sp.sign) and value.args[0] in places_of_sides:
            side = place(places_of_sides[value.args[0]])
            return side if isinstance(value, sp.sign) else emit("multiply", (side, place(value.args[0])))
        return emit(value.func.__name__, tuple(place(item) for item in value.args))

    results = tuple(place(sp.sympify(expression)) for expression in expressions)
    return Program(tuple(operations), results)


def operation_count(program: Program) -> int:
    """Roundings of a program at most: one an operation of two numbers, two a function (an ulp)."""
    counts = {"input": 0, "constant": 1}
    return sum(
        len(step.operands) - 1 if step.kind in ("add", "multiply") else counts.get(step.kind, 2)
        for step in program.operations
    )
