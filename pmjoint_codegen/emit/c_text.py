"""C and header text of the table's rows: CasADi prints the bodies, this module banner and declarations.

``kernels.c`` is CasADi's own text, unedited (its calling convention, its checks for absent arguments). The
header declares just what is called, in ``loops.c`` too, without macros or types of CasADi's, so that cffi
reads it and a person does too.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from pmjoint_codegen.kernels.declarations import exported
from pmjoint_codegen.manifest import Function

_CONVENTION = """\
/* arg[i] points to input i, res[i] to output i: dense vectors of doubles. iw, w, mem are unused and may be 0.
 * Every function returns 0. None allocates or keeps state. */
"""


def banner(lines: list[str]) -> str:
    """What stands at the head of a generated file, as a C comment."""
    # A title may hold what ends a comment, or what begins one, of which compilers warn.
    text = "\n * ".join(line.replace("*/", "* /").replace("/*", "/ *") for line in lines)
    return f"/* {text}\n */\n"


def kernels_source(rows: Iterable[ca.Function], head: str) -> str:
    """``kernels.c``: every row of the table, in order, as CasADi prints it under its name in C.

    Args:
        rows: the functions.
        head: the banner.
    """
    generator = ca.CodeGenerator("kernels", {"static_aux": True, "with_header": False})
    for function in rows:
        symbols = function.sx_in()
        generator.add(
            ca.Function(
                exported(function.name()),
                symbols,
                function.call(symbols),
                function.name_in(),
                function.name_out(),
            )
        )
    text = generator.dump()
    # Of two zeros, a compiler's fmin and fmax take either; the interpreter and the loops take the first.
    for name, relation in (("fmin", "<="), ("fmax", ">=")):
        text = text.replace(f"return {name}(x, y);", f"return x{relation}y || y!=y ? x : y;")
    return f'{head}#include "kernels.h"\n\n{text}'


def kernels_header(functions: tuple[Function, ...], head: str) -> str:
    """``kernels.h``: a declaration a kernel, with its vectors and its equation."""
    declarations = "\n\n".join(_declaration(function) for function in functions)
    guard = "PMJOINT_KERNELS_H"
    return f"{head}#ifndef {guard}\n#define {guard}\n\n{_CONVENTION}\n{declarations}\n\n#endif\n"


def _declaration(function: Function) -> str:
    inputs, outputs = _vectors(function.inputs), _vectors(function.outputs)
    number = f", {function.equation}" if function.equation else ""
    comment = f"/* {function.about}{number}: ({inputs}) -> ({outputs}); {function.operations} operations */"
    name = exported(function.name)
    return (
        f"{comment}\n"
        f"int {name}(const double **arg, double **res, long long int *iw, double *w, int mem);\n"
        f"int {name}_work(long long int *sz_arg, long long int *sz_res,\n"
        "    long long int *sz_iw, long long int *sz_w);"
    )


def _vectors(blocks: tuple[tuple[str, int], ...]) -> str:
    return ", ".join(f"{label}[{size}]" for label, size in blocks)
