"""C text of the functions in which single runs spend their time, on doubles (see ``print_c``).

The arithmetic is that of CasADi's interpreter, operation by operation; its own text asks before every entry
whether an argument or a result is there, and keeps reusing a few variables. The sampled loop's function goes
to ``sampled.h``, which the loop takes in whole: the compiler inlines it, so that what depends on parameters
alone is computed once a run and a sample passes no memory. ``loops.c`` wraps the same text into CasADi's
convention; so what `pmjoint check` looks at is what runs. What the loops call through a pointer stands in
``loops.c`` too, in that convention straight away.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from pmjoint_codegen.emit.compact import Compact
from pmjoint_codegen.emit.compact_text import phases
from pmjoint_codegen.emit.print_c import Dialect, definition, print_c, signature
from pmjoint_codegen.kernels.declarations import exported
from pmjoint_codegen.kernels.tape import Tape

HEADER = "sampled.h"
# The C library's fmin and fmax, of which a compiler makes calls; of two zeros the first one.
HELPERS = """\
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


def dialect() -> Dialect:
    """Doubles."""
    return Dialect("double", spelling=lambda operation: operation.scalar)


def sampled_header(tapes: Iterable[Tape], sizes: Mapping[str, int], head: str) -> str:
    """``sampled.h``: the sizes as constants, for loops that the compiler unrolls, and the functions.

    Args:
        tapes: of the functions that it defines; a C name has the prefix ``pmj_``.
        sizes: name -> value of each constant.
        head: the banner.
    """
    constants = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    bodies = "\n\n".join(_inlined(tape) for tape in tapes)
    guard = "#ifndef PMJOINT_GENERATED_SAMPLED_H\n#define PMJOINT_GENERATED_SAMPLED_H"
    return f"{head}{guard}\n\n#include <math.h>\n\n{constants}\n\n{HELPERS}\n{bodies}\n\n#endif\n"


def loops_source(
    tapes: Iterable[Tape], sampled: Iterable[Tape], compacts: Iterable[Compact], head: str
) -> str:
    """``loops.c``: what the loops of single runs call.

    Args:
        tapes: of functions that are called through a pointer.
        sampled: of functions whose bodies stand in ``sampled.h``.
        compacts: those of the former that are not printed as straight lines.
        head: the banner.
    """
    short = {compact.name: compact for compact in compacts}
    called = [
        compact_kernel(tape, short[tape.name]) if tape.name in short else straight_kernel(tape)
        for tape in tapes
    ]
    bodies = [*called, *(wrapper(tape) for tape in sampled)]
    return "\n\n".join([f'{head}#include "kernels.h"\n#include "{HEADER}"', *bodies]) + "\n"


def wrapper(tape: Tape) -> str:
    """A function of ``sampled.h`` in CasADi's calling convention."""
    sides = (("arg", tape.inputs), ("res", tape.outputs))
    places = [f"{array}[{i}]" for array, blocks in sides for i in range(len(blocks))]
    return kernel(tape, [f"pmj_{tape.name}({', '.join(places)});"])


def straight_kernel(tape: Tape) -> str:
    """A function in CasADi's calling convention, for one that is called through a pointer."""
    arrays = {label: f"arg[{i}]" for i, (label, _) in enumerate(tape.inputs)}
    results = [f"double *restrict {label} = res[{i}];" for i, (label, _) in enumerate(tape.outputs)]
    inputs, outputs = (
        ",".join(f"{label}[{size}]" for label, size in blocks) for blocks in (tape.inputs, tape.outputs)
    )
    body = print_c(tape, replace(dialect(), arrays=arrays))
    return f"/* {tape.name}:({inputs})->({outputs}) */\n" + kernel(tape, [*results, *body])


def compact_kernel(tape: Tape, compact: Compact) -> str:
    """A function in CasADi's calling convention that is computed in two phases an order."""
    parts, body = phases(compact, dialect())
    return "\n\n".join([*parts, kernel(tape, body)])


def kernel(tape: Tape, body: Sequence[str]) -> str:
    """A function of CasADi's convention around a body, and its ``_work``."""
    name = exported(tape.name)
    lines = "\n".join(f"    {line}" for line in ["(void)iw;", "(void)w;", "(void)mem;", *body])
    return f"""\
int {name}(const double **arg, double **res, long long int *iw, double *w, int mem)
{{
{lines}
    return 0;
}}

int {name}_work(long long int *sz_arg, long long int *sz_res, long long int *sz_iw, long long int *sz_w)
{{
    *sz_arg = {len(tape.inputs)};
    *sz_res = {len(tape.outputs)};
    *sz_iw = 0;
    *sz_w = 0;
    return 0;
}}"""


def _inlined(tape: Tape) -> str:
    head = signature(tape, f"static inline void pmj_{tape.name}(", "double")
    return definition(tape, head, print_c(tape, dialect()))
