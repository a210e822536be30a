"""C and header text of the kernels: CasADi prints most bodies, this module the banner and the declarations.

The bodies are CasADi's as they come (its calling convention, its checks for absent arguments), but for
those in which runs spend their time: ``scalar_text`` prints these as straight lines. The header declares just
what is called, without macros or types of CasADi's, so that cffi reads it and a person does too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import casadi as ca

from pmjoint_codegen.emit.compact import Compact
from pmjoint_codegen.emit.compact_text import compact_kernel
from pmjoint_codegen.emit.scalar_text import HEADER as SAMPLED_HEADER
from pmjoint_codegen.emit.scalar_text import straight_kernel, wrapper
from pmjoint_codegen.manifest import Function

STRAIGHT = (
    "plant",
    "closed_loop",
    "taylor",
    "guard",
    "plant_taylor",
    "plant_guard",
)  # beside the sampled loop's
_CONVENTION = """\
/* arg[i] points to input i, res[i] to output i: dense vectors of doubles. iw, w, mem are unused and may be 0.
 * Every function returns 0. None allocates or keeps state. */
"""


def banner(lines: list[str]) -> str:
    """What stands at the head of a generated file, as a C comment."""
    # A title may hold what ends a comment, or what begins one, of which compilers warn.
    text = "\n * ".join(line.replace("*/", "* /").replace("/*", "/ *") for line in lines)
    return f"/* {text}\n */\n"


def kernels_source(
    functions: Mapping[str, ca.Function], sampled: Collection[str], compact: Compact | None, head: str
) -> str:
    """``kernels.c``: every function, in order.

    Args:
        functions: the kernels, by name.
        sampled: names of those whose bodies stand in ``sampled.h``; they come last.
        compact: ``taylor``, where it is no straight lines.
        head: the banner.
    """
    private_helpers, own_header = {"static_aux": True}, {"with_header": False}
    generator = ca.CodeGenerator("kernels", private_helpers | own_header)
    for name, function in functions.items():
        if name not in (*sampled, *STRAIGHT):
            generator.add(function)
    body = "\n".join(line.rstrip() for line in str(generator.dump()).splitlines())
    own = [
        compact_kernel(compact) if compact and compact.name == name else straight_kernel(functions[name])
        for name in STRAIGHT
    ]
    wrappers = [wrapper(functions[name]) for name in functions if name in sampled]
    parts = [f'{head}#include "kernels.h"\n#include "{SAMPLED_HEADER}"', body.strip(), *own, *wrappers]
    return "\n\n".join(parts) + "\n"


def kernels_header(functions: tuple[Function, ...], head: str) -> str:
    """``kernels.h``: a declaration a kernel, with its vectors and its equation."""
    declarations = "\n\n".join(_declaration(function) for function in functions)
    guard = "PMJOINT_KERNELS_H"
    return f"{head}#ifndef {guard}\n#define {guard}\n\n{_CONVENTION}\n{declarations}\n\n#endif\n"


def _declaration(function: Function) -> str:
    inputs, outputs = _vectors(function.inputs), _vectors(function.outputs)
    number = f", {function.equation}" if function.equation else ""
    comment = f"/* {function.about}{number}: ({inputs}) -> ({outputs}); {function.operations} operations */"
    return (
        f"{comment}\n"
        f"int {function.name}(const double **arg, double **res, long long int *iw, double *w, int mem);\n"
        f"int {function.name}_work(long long int *sz_arg, long long int *sz_res,\n"
        "    long long int *sz_iw, long long int *sz_w);"
    )


def _vectors(blocks: tuple[tuple[str, int], ...]) -> str:
    return ", ".join(f"{label}[{size}]" for label, size in blocks)
