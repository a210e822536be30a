"""The guard of a step: how much of a right-hand side its Taylor polynomials can miss, as a CasADi function.

``guard_function`` walks a function's instruction list once, in complex balls (`balls`). The loops ask it, for
a step on trial, for the nonlinear part of every rate and value on a disc around the step's start that is
larger than the step; by Cauchy's estimate that bounds what the polynomials leave out (`rule`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from pmjoint_codegen.emit.balls import Ball, Rule, entire, fixed, leaf, power, rules
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.manifest import GuardRule

# Where the right-hand side is compared with the polynomials beside the step's end: at `1 - place/(N + 3)`.
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
        can be shown the entry is infinite or no number.

    Raises:
        ModelError: for an operation without a rule.
    """
    inputs = [ca.SX.sym(label, function.size1_in(i)) for i, label in enumerate(function.name_in())]
    R, P = ca.SX.sym("R"), ca.SX.sym("P", function.size1_in(state))
    known = rules()
    register: dict[int, Ball] = {}
    results = [[ca.SX(0)] * function.nnz_out(i) for i in range(function.n_out())]
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_INPUT:
            label, entry = function.name_in(reads[0]), inputs[reads[0]][reads[1]]
            moving = {time: R, state: P[reads[1]] if label == state else ca.SX(0)}
            register[writes[0]] = leaf(entry, moving[label]) if label in moving else fixed(entry)
        elif operation == ca.OP_CONST:
            register[writes[0]] = fixed(ca.SX(float(function.instruction_constant(position))))
        elif operation == ca.OP_OUTPUT:
            results[writes[0]][writes[1]] = register[reads[0]].rest
        else:
            register[writes[0]] = _operation(operation, [register[i] for i in reads], known)
    rest = ca.densify(ca.vertcat(*(entry for entries in results for entry in entries)))
    return ca.Function(name, [*inputs, R, P], [ca.cse(rest)], [*function.name_in(), "R", "P"], ["rest"])


def _operation(operation: int, operands: list[Ball], known: Mapping[int, Rule]) -> Ball:
    if operation in (ca.OP_POW, ca.OP_CONSTPOW):
        result = power(operands[0], float(operands[1].centre))
    elif operation in known:
        result = known[operation](*operands)
    else:
        raise ModelError(
            what=f"operation {operation} of the right-hand side has no bound on a disc",
            where="step control",
            remedy="use analytic functions: + - * / **, sin, cos, tan, exp, log, sqrt, tanh",
        )
    return fixed(result.centre) if all(operand.constant for operand in operands) else result


def bent(guard: ca.Function) -> tuple[list[int], list[int]]:
    """Which states a guard looks at, and which of its results can differ from 0: the others are linear."""
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

    Without singularities the end alone is compared; with them two points inside, too, which lets a step come
    closer to a singularity.
    """
    return rule(order, 1 if _moving_operations(function) <= entire() else 1 + len(INSIDE))


def _moving_operations(function: ca.Function) -> set[int]:
    """Operations whose value changes along a run: those on parameters alone are left out."""
    constant: dict[int, bool] = {}
    moving: set[int] = set()
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_INPUT:
            constant[writes[0]] = function.name_in(reads[0]) not in ("t", "x", "X")
        elif operation == ca.OP_CONST:
            constant[writes[0]] = True
        elif operation != ca.OP_OUTPUT:
            if operation == ca.OP_DIV and constant[reads[1]]:
                operation = ca.OP_MUL
            constant[writes[0]] = all(constant[read] for read in reads)
            moving |= set() if constant[writes[0]] else {operation}
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
    step = 1.0 + (order + samples) ** 2 / len(x) ** 2  # between grid points a polynomial rises no further
    return GuardRule(
        order, tuple(nodes[:-1]), _rounded(lebesgue.max() * step), _rounded(product.max() * step)
    )


def _rounded(value: float) -> float:
    """Up, to six digits: the same text on every machine."""
    digits = 5 - math.floor(math.log10(value))
    return math.ceil(value * 10.0**digits) / 10.0**digits
