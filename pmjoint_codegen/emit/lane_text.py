"""C text of functions over lanes, printed from CasADi's own instruction list.

A value of the C is a vector that holds one double of each trajectory (``pmj_lanes`` of ``pmjoint_lanes.h``),
every instruction one named constant, so that the compiler sees straight-line vector arithmetic without calls,
branches or checks. Two things differ from CasADi's C: the sine and cosine of one argument are computed
together, and a divisor that occurs more than once is inverted once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
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


def lanes_source(functions: Mapping[str, ca.Function], head: str) -> str:
    """``lanes.c``: every function, in order."""
    bodies = "\n\n".join(_definition(function) for function in functions.values())
    return f'{head}#include "lanes.h"\n\n{bodies}\n'


def lanes_header(functions: Mapping[str, ca.Function], sizes: Mapping[str, int], head: str) -> str:
    """``lanes.h``: the sizes as constants, for loops that the compiler unrolls, and a declaration a function.

    Args:
        functions: what ``lanes.c`` defines.
        sizes: name -> value of each constant.
        head: the banner.
    """
    constants = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    declarations = "\n".join(f"{_signature(function)};" for function in functions.values())
    guard = "#ifndef PMJOINT_GENERATED_LANES_H\n#define PMJOINT_GENERATED_LANES_H"
    return f'{head}{guard}\n\n#include "pmjoint_lanes.h"\n\n{constants}\n\n{declarations}\n\n#endif\n'


def _definition(function: ca.Function) -> str:
    listing = instructions(function)
    read = {operand.partition("[")[0] for item in listing for operand in item.operands}
    unused = [f"(void){name};" for name in function.name_in() if name not in read]
    body = "\n".join(f"    {line}" for line in [*unused, *_statements(listing)])
    return f"{_signature(function)}\n{{\n{body}\n}}"


def _signature(function: ca.Function) -> str:
    inputs = [f"const pmj_lanes *{name}" for name in function.name_in()]
    outputs = [f"pmj_lanes *restrict {name}" for name in function.name_out()]
    opening = f"void {function.name()}("
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


def _statements(listing: Sequence[Instruction]) -> list[str]:
    angles = {
        operation: {item.operands[0]: item.result for item in listing if item.operation == operation}
        for operation in (ca.OP_SIN, ca.OP_COS)
    }
    pairs = {
        angle: (sine, angles[ca.OP_COS][angle])
        for angle, sine in angles[ca.OP_SIN].items()
        if angle in angles[ca.OP_COS]
    }
    divisors = Counter(item.operands[1] for item in listing if item.operation == ca.OP_DIV)
    often = {divisor for divisor, count in divisors.items() if count > 1 and divisor[0].isalpha()}
    lines: list[str] = []
    done: set[str] = set()
    for item in listing:
        divisor = item.operands[1] if item.operation == ca.OP_DIV else ""
        if divisor in often and divisor not in done:
            done.add(divisor)
            lines.append(f"const pmj_lanes {_inverse(divisor)} = 1.0 / {divisor};")
        if item.operation in angles and item.operands[0] in pairs:
            if item.operands[0] not in done:
                done.add(item.operands[0])
                lines += _pair(item.operands[0], *pairs[item.operands[0]])
        elif divisor in often:
            lines.append(f"const pmj_lanes {item.result} = {item.operands[0]} * {_inverse(divisor)};")
        else:
            lines.append(_statement(item))
    return lines


def _pair(angle: str, sine: str, cosine: str) -> list[str]:
    return [f"pmj_lanes {sine};", f"pmj_lanes {cosine};", f"pmj_sincos({angle}, &{sine}, &{cosine});"]


def _inverse(divisor: str) -> str:
    return "inverse_" + divisor.replace("[", "_").replace("]", "")


def _statement(item: Instruction) -> str:
    operands = item.operands
    if item.operation == ca.OP_OUTPUT:
        value = operands[0] if operands[0][0].isalpha() else f"pmj_all({operands[0]})"
        return f"{item.result} = {value};"
    template = _templates().get(item.operation)
    if template is None:
        raise ModelError(
            f"operation {item.operation} has no form for lanes",
            where="lanes.c",
            remedy="use analytic functions",
        )
    if item.operation in (ca.OP_CONSTPOW, ca.OP_POW, ca.OP_FMIN, ca.OP_FMAX):
        operands = tuple(name if name[0].isalpha() else f"pmj_all({name})" for name in operands)
    return f"const pmj_lanes {item.result} = {template.format(*operands)};"


def _templates() -> Mapping[int, str]:
    return {
        ca.OP_ADD: "{0} + {1}",
        ca.OP_SUB: "{0} - {1}",
        ca.OP_NEG: "-{0}",
        ca.OP_TWICE: "{0} + {0}",
        ca.OP_MUL: "{0} * {1}",
        ca.OP_SQ: "{0} * {0}",
        ca.OP_DIV: "{0} / {1}",
        ca.OP_INV: "1.0 / {0}",
        ca.OP_SIN: "pmj_sin({0})",
        ca.OP_COS: "pmj_cos({0})",
        ca.OP_TAN: "pmj_tan({0})",
        ca.OP_TANH: "pmj_tanh({0})",
        ca.OP_EXP: "pmj_exp({0})",
        ca.OP_LOG: "pmj_log({0})",
        ca.OP_SQRT: "pmj_sqrt({0})",
        ca.OP_POW: "pmj_pow({0}, {1})",
        ca.OP_CONSTPOW: "pmj_pow({0}, {1})",
        ca.OP_FMIN: "pmj_min({0}, {1})",
        ca.OP_FMAX: "pmj_max({0}, {1})",
        ca.OP_FABS: "pmj_max({0}, -{0})",
        ca.OP_SIGN: "pmj_select({0} > 0.0, pmj_all(1.0), pmj_select({0} < 0.0, pmj_all(-1.0), pmj_all(0.0)))",
    }
