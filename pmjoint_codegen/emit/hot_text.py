"""C text of the kernels that a run spends its time in, printed from CasADi's instruction list.

The operations and their order are CasADi's. Its own text asks before every entry whether an argument or a
result is there, and keeps reusing a few variables; here both must be there, and every value is a constant
of its own, so that the compiler sees one straight line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca

from pmjoint_codegen.emit.lane_text import Instruction, instructions
from pmjoint_codegen.errors import ModelError

_ARGUMENTS = "const double **arg, double **res, long long int *iw, double *w, int mem"
_SIZES = "long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w"


def hot_source(function: ca.Function) -> str:
    """Definition of a kernel and of its ``_work``, in CasADi's calling convention.

    Raises:
        ModelError: for an operation that has no form here.
    """
    name = function.name()
    inputs, outputs = (
        _vectors(labels, size)
        for labels, size in (
            (function.name_in(), function.size1_in),
            (function.name_out(), function.size1_out),
        )
    )
    body = "\n".join(f"  {line}" for line in [*_results(function), *_statements(function)])
    sizes = {"sz_arg": function.n_in(), "sz_res": function.n_out(), "sz_iw": 0, "sz_w": 0}
    work = "\n".join(f"  if ({where}) *{where} = {size};" for where, size in sizes.items())
    return (
        f"/* {name}:({inputs})->({outputs}) */\n"
        f"int {name}({_ARGUMENTS}) {{\n{body}\n  return 0;\n}}\n\n"
        f"int {name}_work({_SIZES}) {{\n{work}\n  return 0;\n}}\n"
    )


def _vectors(labels: Sequence[str], size: Callable[[int], int]) -> str:
    return ",".join(label if size(i) == 1 else f"{label}[{size(i)}]" for i, label in enumerate(labels))


def _results(function: ca.Function) -> list[str]:
    return [f"double *restrict {label} = res[{i}];" for i, label in enumerate(function.name_out())]


def _statements(function: ca.Function) -> list[str]:
    places = {label: f"arg[{i}]" for i, label in enumerate(function.name_in())}
    lines: list[str] = []
    read: set[str] = set()
    for item in instructions(function):
        for operand in item.operands:
            if "[" in operand and operand not in read:
                read.add(operand)
                label, bracket, entry = operand.partition("[")
                lines.append(f"const double {_name(operand)} = {places[label]}{bracket}{entry};")
        lines.append(_statement(item))
    return lines


def _name(operand: str) -> str:
    """Of a value; an argument's entry is read into a constant, which no store can change."""
    if not operand[0].isalpha():
        return f"{float(operand):.16e}"
    return operand.replace("[", "_").replace("]", "")


def _statement(item: Instruction) -> str:
    operands = [_name(operand) for operand in item.operands]
    if item.operation == ca.OP_OUTPUT:
        return f"{item.result} = {operands[0]};"
    template = _templates().get(item.operation)
    if template is None:
        raise ModelError(
            f"operation {item.operation} has no form in C", where="kernels.c", remedy="use analytic functions"
        )
    return f"const double {item.result} = {template.format(*operands)};"


def _templates() -> Mapping[int, str]:
    return {
        ca.OP_ADD: "{0} + {1}",
        ca.OP_SUB: "{0} - {1}",
        ca.OP_NEG: "-{0}",
        ca.OP_TWICE: "2.0 * {0}",
        ca.OP_MUL: "{0} * {1}",
        ca.OP_SQ: "{0} * {0}",
        ca.OP_DIV: "{0} / {1}",
        ca.OP_INV: "1.0 / {0}",
        ca.OP_SIN: "sin({0})",
        ca.OP_COS: "cos({0})",
        ca.OP_TAN: "tan({0})",
        ca.OP_TANH: "tanh({0})",
        ca.OP_EXP: "exp({0})",
        ca.OP_LOG: "log({0})",
        ca.OP_SQRT: "sqrt({0})",
        ca.OP_POW: "pow({0}, {1})",
        ca.OP_CONSTPOW: "pow({0}, {1})",
        ca.OP_FMIN: "fmin({0}, {1})",
        ca.OP_FMAX: "fmax({0}, {1})",
        ca.OP_FABS: "fabs({0})",
        ca.OP_SIGN: "{0} < 0.0 ? -1.0 : {0} > 0.0 ? 1.0 : {0}",
    }
