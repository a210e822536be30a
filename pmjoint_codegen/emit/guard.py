"""The guard of a step: a bound on the error of its Taylor polynomials, as a CasADi function.

``guard_function`` evaluates a function's tape once, in complex balls (`balls`). For a trial step, it gives
the loops the nonlinear part of every rate and value on a disc around the step's start that is larger than the
step; by Cauchy's estimate that bounds the remainder of the polynomials (`rule`).
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from pmjoint_codegen.emit import balls
from pmjoint_codegen.emit.balls import Ball, fixed, leaf
from pmjoint_codegen.emit.tape import tape_of
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.manifest import GuardRule
from pmjoint_codegen.operations import Operation, by_name, remedy

# Where the right-hand side is compared with the polynomials besides the step's end: at `1 - place/(N + 3)`.
# The remainder of Hermite interpolation is then smallest, to a few percent, for N = 5..24.
INSIDE = (2.849, 0.8916)


def guard_function(name: str, function: ca.Function, *, time: str = "t", state: str) -> ca.Function:
    """A function that bounds the nonlinear part of another's results on a disc.

    Args:
        name: of the new function.
        function: SX function with dense inputs.
        time: name of the input that is time.
        state: name of the input whose entries move, each within a disc of its own.

    Returns:
        Function of the same inputs and ``R``, the disc's radius in time, s, and ``P``, of each entry of the
        state; its one output ``rest`` has an entry for each entry of the results, in order. Where no bound
        is found the entry is infinite or NaN.

    Raises:
        ModelError: for an operation without a rule.
    """
    inputs = [ca.SX.sym(label, function.size1_in(i)) for i, label in enumerate(function.name_in())]
    R, P = ca.SX.sym("R"), ca.SX.sym("P", function.size1_in(state))
    known, tape = by_name(), tape_of(function)
    values: list[Ball] = []
    results = [[ca.SX(0)] * size for _, size in tape.outputs]
    for item in tape.instructions:
        if item.operation == "input":
            (block, place), label = item.operands, tape.inputs[item.operands[0]][0]
            moving = {time: R, state: P[place] if label == state else ca.SX(0)}
            entry = inputs[block][place]
            values.append(leaf(entry, moving[label]) if label in moving else fixed(entry))
        elif item.operation == "const":
            values.append(fixed(ca.SX(item.value)))
        elif item.operation == "output":
            result, place, value = item.operands
            results[result][place] = values[value].rest
        else:
            values.append(_operation(known[item.operation], [values[i] for i in item.operands]))
    rest = ca.densify(ca.vertcat(*(entry for entries in results for entry in entries)))
    return ca.Function(name, [*inputs, R, P], [ca.cse(rest)], [*function.name_in(), "R", "P"], ["rest"])


def _operation(operation: Operation, operands: list[Ball]) -> Ball:
    constant = all(operand.constant for operand in operands)
    if operation.ball is None and constant:  # such as the lesser of two limits
        return fixed(operation.of(ca)(*(operand.centre for operand in operands)))
    if operation.ball is None:
        raise ModelError(
            what=f"operation {operation.name} of the right-hand side has no bound on a disc",
            where="step control",
            remedy=f"{remedy()}: they are analytic",
        )
    result: Ball = operation.ball(balls)(*operands)
    return fixed(result.centre) if constant else result


def bent(guard: ca.Function) -> tuple[list[int], list[int]]:
    """Which states a guard reads, and which of its results can differ from 0: the others are linear."""
    places = guard.jac_sparsity(0, guard.index_in("P"))
    symbols = [ca.SX.sym(label, guard.size1_in(i)) for i, label in enumerate(guard.name_in())]
    (rest,) = guard.call(symbols)
    entries = [i for i in range(rest.size1()) if not rest[i].is_zero()]
    return sorted(set(places.get_col())), entries


def looks_at_actuator(guard: ca.Function, channels: int) -> bool:
    """Whether the guard of the plant depends on any of the first entries of w."""
    return any(column < channels for column in guard.jac_sparsity(0, guard.index_in("w")).get_col())


def rule_of(function: ca.Function, order: int) -> GuardRule:
    """The rule for steps of polynomials of degree `order` over a right-hand side.

    Without singularities only the end is compared; with them also two points inside, which lets a step come
    closer to a singularity.
    """
    known = by_name()
    smooth = all(known[name].entire for name in _moving_operations(function))
    return rule(order, 1 if smooth else 1 + len(INSIDE))


def _moving_operations(function: ca.Function) -> set[str]:
    """Operations whose value changes along a run: those on parameters only are omitted."""
    tape = tape_of(function)
    constant: list[bool] = []
    moving: set[str] = set()
    for item in tape.instructions:
        if item.operation == "input":
            constant.append(tape.inputs[item.operands[0]][0] not in ("t", "x", "X"))
        elif item.operation == "const":
            constant.append(True)
        elif item.operation != "output":
            scaled = item.operation == "div" and constant[item.operands[1]]
            constant.append(all(constant[operand] for operand in item.operands))
            moving |= set() if constant[-1] else {"mul" if scaled else item.operation}
    return moving


def rule(order: int, samples: int) -> GuardRule:
    """Hermite interpolation with an N-fold zero at the step's start and `samples` points, the last its end.

    With F analytic and |F - F(0)| <= r on the disc of radius R = s h, the defect d of polynomials obeys
    ``|d| <= L max_j |d(n_j h)| + W / (s^N prod_j (s - n_j)) s/(s - 1) r`` on the whole step.
    """
    nodes = [*(1.0 - place / (order + 3.0) for place in INSIDE[: samples - 1]), 1.0]
    x = np.linspace(0.0, 1.0, 20001)
    product = x**order
    for node in nodes:
        product = product * np.abs(x - node)
    lebesgue = np.zeros_like(x)
    for node in nodes:
        term = (x / node) ** order
        for other in nodes:
            if other != node:
                term = term * (x - other) / (node - other)
        lebesgue += np.abs(term)
    step = 1.0 + (order + samples) ** 2 / len(x) ** 2  # bounds a polynomial between grid points
    return GuardRule(
        order, tuple(nodes[:-1]), _rounded(lebesgue.max() * step), _rounded(product.max() * step)
    )


def _rounded(value: float) -> float:
    """Rounded up to six digits: the same text on every machine."""
    digits = 5 - math.floor(math.log10(value))
    return math.ceil(value * 10.0**digits) / 10.0**digits
