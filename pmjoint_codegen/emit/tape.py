"""CasADi functions as tapes: their own instruction lists, in static single assignment."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.kernels.tape import Instruction, Tape


def _operations() -> dict[int, str]:
    """Names of the operations that a kernel may hold."""
    return {
        ca.OP_NEG: "neg", ca.OP_SQ: "sq", ca.OP_TWICE: "twice", ca.OP_INV: "inv", ca.OP_SQRT: "sqrt",
        ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_TANH: "tanh", ca.OP_EXP: "exp",
        ca.OP_LOG: "log", ca.OP_ADD: "add", ca.OP_SUB: "sub", ca.OP_MUL: "mul", ca.OP_DIV: "div",
        ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax",
        ca.OP_FABS: "fabs", ca.OP_SIGN: "sign",
    }  # fmt: skip


def tapes_of(functions: Iterable[ca.Function]) -> list[Tape]:
    """The tape of each function, in order.

    Raises:
        ModelError: for an operation that no kernel may hold.
    """
    return [_tape(function) for function in functions]


def _tape(function: ca.Function) -> Tape:
    names = _operations()
    values: dict[int, int] = {}  # CasADi's work vector entry -> value that it holds now
    instructions: list[Instruction] = []
    count = 0
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_OUTPUT:
            instructions.append(Instruction("output", (writes[0], writes[1], values[reads[0]])))
            continue
        instructions.append(_instruction(function, position, names, values))
        values[writes[0]] = count
        count += 1
    sizes = [
        tuple((label, int(size(i))) for i, label in enumerate(labels))
        for labels, size in ((function.name_in(), function.nnz_in), (function.name_out(), function.nnz_out))
    ]
    return Tape(function.name(), sizes[0], sizes[1], tuple(instructions))


def _instruction(
    function: ca.Function, position: int, names: dict[int, str], values: dict[int, int]
) -> Instruction:
    operation, reads = function.instruction_id(position), function.instruction_input(position)
    if operation == ca.OP_INPUT:
        return Instruction("input", (reads[0], reads[1]))
    if operation == ca.OP_CONST:
        return Instruction("const", (), float(function.instruction_constant(position)))
    if operation not in names:
        raise ModelError(
            what=f"operation {operation} has no place on a tape",
            where=f"kernel {function.name()}",
            remedy="use + - * / **, sin, cos, tan, exp, log, sqrt, tanh",
        )
    return Instruction(names[operation], tuple(values[entry] for entry in reads))
