"""CasADi functions as tapes: their own instruction lists, in static single assignment.

This is the one place that walks CasADi's list; printers, recurrences, balls and the interpreter read tapes.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.kernels.tape import Instruction, Tape
from pmjoint_codegen.operations import by_name, remedy


def tapes_of(functions: Iterable[ca.Function]) -> list[Tape]:
    """The tape of each function, in order.

    Raises:
        ModelError: for an operation that no kernel may hold.
    """
    return [tape_of(function) for function in functions]


def tape_of(function: ca.Function) -> Tape:
    """A function's tape.

    Raises:
        ModelError: for an operation that no kernel may hold.
    """
    names = {getattr(ca, opcode): item.name for item in by_name().values() for opcode in item.opcodes}
    values: dict[int, int] = {}  # CasADi's work vector entry -> value that it holds now
    instructions: list[Instruction] = []
    count = 0
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_OUTPUT:
            instructions.append(Instruction("output", (writes[0], writes[1], values[reads[0]])))
            continue
        if operation == ca.OP_INPUT:
            item = Instruction("input", (reads[0], reads[1]))
        elif operation == ca.OP_CONST:
            item = Instruction("const", (), float(function.instruction_constant(position)))
        elif operation in names:
            item = Instruction(names[operation], tuple(values[entry] for entry in reads))
        else:
            raise ModelError(
                what=f"operation {operation} has no place on a tape",
                where=f"kernel {function.name()}",
                remedy=remedy(),
            )
        instructions.append(item)
        values[writes[0]] = count
        count += 1
    inputs, outputs = (
        tuple((label, int(size(i))) for i, label in enumerate(labels))
        for labels, size in ((function.name_in(), function.nnz_in), (function.name_out(), function.nnz_out))
    )
    return Tape(function.name(), inputs, outputs, tuple(instructions))
