"""C text of the sampled loop's two functions on doubles: ``sampled.h``, which the loop takes in whole.

They are written as straight lines (see ``straight_text``) that the compiler inlines into the loop, so that
what depends on parameters alone is computed once a run and a sample passes no memory. The arithmetic is that
of CasADi's interpreter, operation by operation. ``kernels.c`` wraps the same text into CasADi's convention;
so what `pmjoint check` looks at is what runs.
"""

from __future__ import annotations

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
    name, inputs, outputs = function.name(), function.n_in(), function.n_out()
    places = [*(f"arg[{i}]" for i in range(inputs)), *(f"res[{i}]" for i in range(outputs))]
    return f"""\
int {name}(const double **arg, double **res, long long int *iw, double *w, int mem)
{{
    (void)iw;
    (void)w;
    (void)mem;
    pmj_{name}({", ".join(places)});
    return 0;
}}

int {name}_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w)
{{
    *sz_arg = {inputs};
    *sz_res = {outputs};
    *sz_iw = 0;
    *sz_w = 0;
    return 0;
}}"""


def _definition(function: ca.Function) -> str:
    head = signature(function, f"static inline void pmj_{function.name()}(", "double")
    return definition(function, head, _statements)


def _statements(listing: Sequence[Instruction]) -> list[str]:
    dialect = Dialect("double", _templates(), "{}", frozenset(), HEADER)
    return [statement(item, dialect) for item in listing]


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
