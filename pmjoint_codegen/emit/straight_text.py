"""C text of functions as straight lines, printed from CasADi's own instruction list.

Every instruction becomes one named constant, so that the compiler sees arithmetic without calls through
pointers, branches or checks. A dialect says what a value is, a double or a vector of them, and how each
operation is written on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from pmjoint_codegen.errors import ModelError

MARGIN = 118


@dataclass(frozen=True)
class Instruction:
    """One operation in static single assignment.

    Attributes:
        operation: CasADi's number of it.
        result: name of the constant that it defines, or the place that it writes.
        operands: names of constants, places that it reads, or literals.
    """

    operation: int
    result: str
    operands: tuple[str, ...]


@dataclass(frozen=True)
class Dialect:
    """How values and operations are written.

    Attributes:
        number: C type of a value.
        templates: CasADi's number of an operation -> expression of its operands.
        literal: a literal as a value, where an operator would not make it one.
        functions: operations that are calls, whose literals must be values.
        file: what is printed, for messages.
    """

    number: str
    templates: Mapping[int, str]
    literal: str
    functions: frozenset[int]
    file: str


def arithmetic() -> dict[int, str]:
    """Templates of what C's operators do on values of either kind."""
    return {
        ca.OP_ADD: "{0} + {1}",
        ca.OP_SUB: "{0} - {1}",
        ca.OP_NEG: "-{0}",
        ca.OP_TWICE: "{0} + {0}",
        ca.OP_MUL: "{0} * {1}",
        ca.OP_SQ: "{0} * {0}",
        ca.OP_DIV: "{0} / {1}",
        ca.OP_INV: "1.0 / {0}",
    }


Print = Callable[[Sequence[Instruction]], list[str]]


def definition(function: ca.Function, head: str, printed: Print) -> str:
    """A function's C.

    Args:
        function: what to print.
        head: its signature.
        printed: prints its instructions.
    """
    listing = instructions(function)
    read = {operand.partition("[")[0] for item in listing for operand in item.operands}
    unused = [f"(void){name};" for name in function.name_in() if name not in read]
    body = "\n".join(f"    {line}" for line in [*unused, *printed(listing)])
    return f"{head}\n{{\n{body}\n}}"


def signature(function: ca.Function, opening: str, number: str) -> str:
    """A function's head: a pointer an input, a restricted pointer an output, lines broken at the margin.

    Args:
        function: whose head it is.
        opening: everything up to the first argument.
        number: C type of a value.
    """
    inputs = [f"const {number} *{name}" for name in function.name_in()]
    outputs = [f"{number} *restrict {name}" for name in function.name_out()]
    lines = [opening]
    for position, argument in enumerate([*inputs, *outputs]):
        comma = ", " if position else ""
        if len(lines[-1]) + len(comma + argument) > MARGIN:
            lines[-1] += ","
            lines.append(" " * len(opening) + argument)
        else:
            lines[-1] += comma + argument
    return "\n".join(lines) + ")"


def instructions(function: ca.Function) -> list[Instruction]:
    """A function's instruction list with a name for every value; CasADi's own reuses its registers."""
    register: dict[int, str] = {}
    listing: list[Instruction] = []
    for position in range(function.n_instructions()):
        operation = function.instruction_id(position)
        reads, writes = function.instruction_input(position), function.instruction_output(position)
        if operation == ca.OP_INPUT:
            register[writes[0]] = f"{function.name_in(reads[0])}[{reads[1]}]"
        elif operation == ca.OP_CONST:
            register[writes[0]] = repr(float(function.instruction_constant(position)))
        elif operation == ca.OP_OUTPUT:
            place = f"{function.name_out(writes[0])}[{writes[1]}]"
            listing.append(Instruction(operation, place, (register[reads[0]],)))
        else:
            operands = tuple(register[read] for read in reads)
            register[writes[0]] = f"a{len(listing)}"
            listing.append(Instruction(operation, register[writes[0]], operands))
    return listing


def statement(item: Instruction, dialect: Dialect) -> str:
    """One instruction as one line of C.

    Raises:
        ModelError: for an operation that the dialect cannot write.
    """
    operands = item.operands
    if item.operation == ca.OP_OUTPUT:
        return f"{item.result} = {_value(operands[0], dialect)};"
    template = dialect.templates.get(item.operation)
    if template is None:
        raise ModelError(
            f"operation {item.operation} has no form for {dialect.file}",
            where=dialect.file,
            remedy="use analytic functions",
        )
    if item.operation in dialect.functions:
        operands = tuple(_value(name, dialect) for name in operands)
    return f"const {dialect.number} {item.result} = {template.format(*operands)};"


def _value(operand: str, dialect: Dialect) -> str:
    return operand if operand[0].isalpha() else dialect.literal.format(operand)
