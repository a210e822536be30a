"""C text of functions over lanes, as straight lines (see ``straight_text``).

A value of the C is a vector that holds one double of each trajectory (``pmj_lanes`` of ``pmjoint_lanes.h``).
Two things differ from CasADi's C: the sine and cosine of one argument are computed together, and a divisor
that occurs more than once is inverted once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import casadi as ca

from pmjoint_codegen.emit.straight_text import (
    Dialect,
    Instruction,
    arithmetic,
    definition,
    signature,
    statement,
)


def lanes_source(functions: Mapping[str, ca.Function], head: str) -> str:
    """``lanes.c``: every function, in order."""
    bodies = "\n\n".join(_definition(function) for function in functions.values())
    return f'{head}#include "lanes.h"\n\n{bodies}\n'


def lanes_header(functions: Mapping[str, ca.Function], sizes: Mapping[str, int | str], head: str) -> str:
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
    return definition(function, _signature(function), _statements)


def _signature(function: ca.Function) -> str:
    return signature(function, f"void {function.name()}(", "pmj_lanes")


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
    dialect = _dialect()
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
            lines.append(statement(item, dialect))
    return lines


def _pair(angle: str, sine: str, cosine: str) -> list[str]:
    return [f"pmj_lanes {sine};", f"pmj_lanes {cosine};", f"pmj_sincos({angle}, &{sine}, &{cosine});"]


def _inverse(divisor: str) -> str:
    return "inverse_" + divisor.replace("[", "_").replace("]", "")


def _dialect() -> Dialect:
    functions = frozenset((ca.OP_CONSTPOW, ca.OP_POW, ca.OP_FMIN, ca.OP_FMAX))
    return Dialect("pmj_lanes", _templates(), "pmj_all({})", functions, "lanes.c")


def _templates() -> Mapping[int, str]:
    return arithmetic() | {
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
