"""C text of the functions in which single runs spend their time, on doubles and as straight lines.

The arithmetic is that of CasADi's interpreter, operation by operation; its own text asks before every entry
whether an argument or a result is there, and keeps reusing a few variables. The sampled loop's two functions
go to ``sampled.h``, which the loop takes in whole: the compiler inlines them, so that what depends on
parameters alone is computed once a run and a sample passes no memory. ``kernels.c`` wraps the same text into
CasADi's convention; so what `pmjoint check` looks at is what runs. The Taylor kernel of the continuous loop
is called through a pointer, and printed in that convention straight away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca

from pmjoint_codegen.emit.straight_text import (
    Dialect,
    Instruction,
    arithmetic,
    definition,
    instructions,
    signature,
    statement,
)

HEADER = "sampled.h"
# The C library's fmin and fmax, of which a compiler makes calls; of two zeros the first one.
_HELPERS = """\
static inline double pmj_fmin(double a, double b)
{
    return a <= b || b != b ? a : b;
}

static inline double pmj_fmax(double a, double b)
{
    return a >= b || b != b ? a : b;
}

static inline double pmj_sign(double a)
{
    return a < 0.0 ? -1.0 : a > 0.0 ? 1.0 : a;
}
"""


def sampled_header(functions: Mapping[str, ca.Function], sizes: Mapping[str, int], head: str) -> str:
    """``sampled.h``: the sizes as constants, for loops that the compiler unrolls, and the functions.

    Args:
        functions: what it defines, by name; a C name has the prefix ``pmj_``.
        sizes: name -> value of each constant.
        head: the banner.
    """
    constants = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    bodies = "\n\n".join(_definition(function) for function in functions.values())
    guard = "#ifndef PMJOINT_GENERATED_SAMPLED_H\n#define PMJOINT_GENERATED_SAMPLED_H"
    return f"{head}{guard}\n\n#include <math.h>\n\n{constants}\n\n{_HELPERS}\n{bodies}\n\n#endif\n"


def wrapper(function: ca.Function) -> str:
    """A function of ``sampled.h`` in CasADi's calling convention, for ``kernels.c``."""
    places = [*(f"arg[{i}]" for i in range(function.n_in())), *(f"res[{i}]" for i in range(function.n_out()))]
    return kernel(
        function.name(), function.n_in(), function.n_out(), [f"pmj_{function.name()}({', '.join(places)});"]
    )


def straight_kernel(function: ca.Function) -> str:
    """A function in CasADi's calling convention, for one that is called through a pointer.

    Every entry of an argument is read into a constant, at its first use, so that no store can change it.
    """
    results = [f"double *restrict {label} = res[{i}];" for i, label in enumerate(function.name_out())]
    places = {label: f"arg[{i}]" for i, label in enumerate(function.name_in())}
    lines: list[str] = []
    known: dict[str, str] = {}
    for item in instructions(function):
        for operand in item.operands:
            if operand.endswith("]") and operand not in known:
                label, bracket, entry = operand[:-1].partition("[")
                known[operand] = f"{label}_{entry}"
                lines.append(f"const double {known[operand]} = {places[label]}{bracket}{entry}];")
        operands = tuple(known.get(operand, operand) for operand in item.operands)
        lines.append(statement(replace(item, operands=operands), _dialect()))
    inputs, outputs = (
        ",".join(f"{label}[{size(i)}]" for i, label in enumerate(labels))
        for labels, size in (
            (function.name_in(), function.size1_in),
            (function.name_out(), function.size1_out),
        )
    )
    comment = f"/* {function.name()}:({inputs})->({outputs}) */\n"
    return comment + kernel(function.name(), function.n_in(), function.n_out(), [*results, *lines])


def kernel(name: str, arguments: int, results: int, body: Sequence[str]) -> str:
    """A function of CasADi's convention around a body, and its ``_work``."""
    lines = "\n".join(f"    {line}" for line in ["(void)iw;", "(void)w;", "(void)mem;", *body])
    return f"""\
int {name}(const double **arg, double **res, long long int *iw, double *w, int mem)
{{
{lines}
    return 0;
}}

int {name}_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w)
{{
    *sz_arg = {arguments};
    *sz_res = {results};
    *sz_iw = 0;
    *sz_w = 0;
    return 0;
}}"""


def _definition(function: ca.Function) -> str:
    head = signature(function, f"static inline void pmj_{function.name()}(", "double")
    return definition(function, head, statements)


def statements(listing: Sequence[Instruction]) -> list[str]:
    """Instructions as lines of C on doubles, one each."""
    return [statement(item, _dialect()) for item in listing]


def _dialect() -> Dialect:
    return Dialect("double", _templates(), "{}", frozenset(), "C on doubles")


def _templates() -> Mapping[int, str]:
    return arithmetic() | {
        ca.OP_SIN: "sin({0})",
        ca.OP_COS: "cos({0})",
        ca.OP_TAN: "tan({0})",
        ca.OP_TANH: "tanh({0})",
        ca.OP_EXP: "exp({0})",
        ca.OP_LOG: "log({0})",
        ca.OP_SQRT: "sqrt({0})",
        ca.OP_POW: "pow({0}, {1})",
        ca.OP_CONSTPOW: "pow({0}, {1})",
        ca.OP_FMIN: "pmj_fmin({0}, {1})",
        ca.OP_FMAX: "pmj_fmax({0}, {1})",
        ca.OP_FABS: "fabs({0})",
        ca.OP_SIGN: "pmj_sign({0})",
    }
