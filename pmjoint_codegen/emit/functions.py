"""The table's rows as CasADi functions, and what the loops use beside them, composed from the rows."""

from __future__ import annotations

import casadi as ca
import sympy as sp

from pmjoint_codegen.emit.compact import compact_where_long
from pmjoint_codegen.emit.guard import guard_function
from pmjoint_codegen.emit.sampling import sampled_functions
from pmjoint_codegen.emit.table import Block, Kernel, kernel_table
from pmjoint_codegen.emit.taylor import taylor_function
from pmjoint_codegen.emit.translate import Translator
from pmjoint_derive import Derivation
from pmjoint_derive.progress import Stage, unwatched

GUARDS = ("guard", "plant_guard")  # bounds, not equations
COMPOSED = ("taylor", "guard", "plant_taylor", "plant_guard", "sample")


def build_function(kernel: Kernel, derivation: Derivation) -> ca.Function:
    """One row of the table as a CasADi function of dense vectors.

    Raises:
        ModelError: when an output needs a symbol that is neither input nor defined.
    """
    arguments = [ca.SX.sym(label, len(symbols)) for label, symbols in kernel.inputs]
    known = {
        symbol: argument[i]
        for (_, symbols), argument in zip(kernel.inputs, arguments, strict=True)
        for i, symbol in enumerate(symbols)
    }
    translate = Translator(kernel.name, known, kernel.given, derivation.equations, kernel.sides)
    results = [_dense([translate(sp.sympify(entry)) for entry in entries]) for _, entries in kernel.outputs]
    return ca.Function(
        kernel.name, arguments, ca.cse(results), _labels(kernel.inputs), _labels(kernel.outputs)
    )


def build_functions(derivation: Derivation, order: int, stage: Stage = unwatched) -> dict[str, ca.Function]:
    """Every kernel by name, in the order of the table, then those of `COMPOSED`, which are made from them.

    Args:
        derivation: named equations.
        order: highest coefficient of ``taylor``.
        stage: told which kernels are being built.
    """
    rows = {kernel.name: kernel for kernel in kernel_table(derivation)}
    functions: dict[str, ca.Function] = {}
    for count, (name, kernel) in enumerate(rows.items()):
        stage("building kernels", count / len(rows))
        functions[name] = build_function(kernel, derivation)
    stage(f"building Taylor coefficients up to order {order}", 0.0)
    loop = functions["closed_loop"]
    compact = compact_where_long("taylor", loop, order, state="X")
    functions["taylor"] = compact.unrolled() if compact else taylor_function("taylor", loop, order, state="X")
    functions["guard"] = guard_function("guard", loop, state="X")
    stage("building the sampled loop's kernels", 0.0)
    return functions | sampled_functions(functions)


def _dense(entries: list[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*entries)) if entries else ca.SX(0, 1)


def _labels(blocks: tuple[Block, ...]) -> list[str]:
    return [label for label, _ in blocks]
