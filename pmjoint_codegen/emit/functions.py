"""The table's rows as CasADi functions."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import sympy as sp

from pmjoint_codegen.emit.affine import Entry
from pmjoint_codegen.emit.compact import compact_where_long
from pmjoint_codegen.emit.guard import guard_function
from pmjoint_codegen.emit.loop_table import lane_rows, loop_rows
from pmjoint_codegen.emit.table import Composed, Guard, Kernel, Made, Taylor, kernel_table
from pmjoint_codegen.emit.taylor import taylor_function
from pmjoint_codegen.emit.translate import Translator
from pmjoint_codegen.emit.vocabulary import neutral_entry
from pmjoint_codegen.kernels.turn import alone
from pmjoint_derive import Derivation
from pmjoint_derive.progress import Stage, unwatched


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
    taken, given = ([label for label, _ in blocks] for blocks in (kernel.inputs, kernel.outputs))
    return ca.Function(kernel.name, arguments, ca.cse(results), taken, given)


@alone
def build_functions(derivation: Derivation, order: int, stage: Stage = unwatched) -> dict[str, ca.Function]:
    """Every kernel by name, in the order of the table, then those of `loop_rows`, which are made from them.

    Args:
        derivation: named equations.
        order: highest coefficient of ``taylor``.
        stage: called with the name of each stage and the fraction of it completed.

    Raises:
        ModelError: an output that needs an undefined symbol, or an operation without a Taylor recurrence.
    """
    rows = {kernel.name: kernel for kernel in kernel_table(derivation)}
    functions: dict[str, ca.Function] = {}
    for count, (name, kernel) in enumerate(rows.items()):
        stage("building kernels", count / len(rows))
        functions[name] = build_function(kernel, derivation)
    stage(f"building Taylor coefficients up to order {order}", 0.0)
    for made in loop_rows(rows):
        functions[made.name] = make_function(made, functions, order, neutral_entry(derivation))
    return functions


@alone
def lane_functions(
    functions: Mapping[str, ca.Function], neutral: Entry | None = None
) -> dict[str, ca.Function]:
    """The functions of `lane_rows` by name, from those of `build_functions`; see `make_function`."""
    return {made.name: make_function(made, functions, neutral=neutral) for made in lane_rows(functions)}


def make_function(
    made: Made, functions: Mapping[str, ca.Function], order: int = 0, neutral: Entry | None = None
) -> ca.Function:
    """One row that is made from others.

    Args:
        made: the row.
        functions: those that it is made from, among others.
        order: highest Taylor coefficient, where the row leaves it open.
        neutral: place of the parameter that is 1 unless it is set, which changes no order of operations.
    """
    match made:
        case Taylor(name, of, state, fixed):
            compact = compact_where_long(name, functions[of], fixed or order, state=state, neutral=neutral)
            if compact and not fixed:
                return compact.unrolled()
            return taylor_function(name, functions[of], fixed or order, state=state, neutral=neutral)
        case Guard(name, of, state):
            return guard_function(name, functions[of], state=state)
        case Composed(name, parts, build):
            return build(name, *(functions[part] for part in parts))


def _dense(entries: list[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*entries)) if entries else ca.SX(0, 1)
