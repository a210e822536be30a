"""What an exported controller computed on another machine, against the equations.

Without functions of the C library every operation is IEEE 754's, so all machines agree in every bit. With
them, libraries differ in the last places. In either case each step is judged by itself: from the state that
the machine had at one sample, its answers at the next are what the equations give, within the bound of
`pmjoint_codegen.export.bounds`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.export.bounds import Bounded, relative
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.tree import DOUBLE, operations_in, tree_of
from pmjoint_codegen.export.twin import COMMAND, bounded_arithmetic

Array = npt.NDArray[np.float64]

_EXACT: Final = frozenset(
    {"add", "sub", "mul", "div", "neg", "fmin", "fmax", "between", "fabs", "sqrt", "sign"}
)
_LEAVES: Final = frozenset({"number", "name"})


def library_functions(program: Program) -> tuple[str, ...]:
    """The functions of the C library that a controller calls, but those that IEEE 754 defines exactly."""
    groups = (program.constants, program.law, program.update, program.start)
    trees = [item.tree for group in groups for item in group]
    trees += [tree_of(entry.value) for entry in program.matrices]
    trees += [tree_of(value) for value in program.starts.values()]
    found = set[str]().union(*(operations_in(tree) for tree in trees)) - _EXACT - _LEAVES
    if "filter" in program.derivation.model.chain:
        found.add("expm1")
    return tuple(sorted(found))


def step_ratios(export: Export, given: Array, found: Mapping[str, Any]) -> Array:
    """How far each step is from the equations, relative to its bound.

    Args:
        export: the controller.
        given: y, the reference and its derivatives, shape (samples, rho + 2), in the controller's precision.
        found: name of an output or a state -> its values after each sample; y, v, u, command and every state
            are among them.

    Returns:
        Shape (samples - 1, values).
    """
    program, precision = export.program, export.precision
    signals = program.derivation.signals
    symbols = {symbol.name: symbol for symbol in (*program.states, *program.estimate, *signals.z)}
    symbols |= {"y": signals.y, "v": signals.v, "u": signals.u, "command": COMMAND}
    twin = twin_of(program, bounded_arithmetic(precision), precision, matched=False)
    kept = [*program.states, signals.y, signals.v, signals.u, COMMAND]
    twin.values = {
        symbol: Bounded(found[name][:-1], 0.0) for name, symbol in symbols.items() if symbol in kept
    }
    twin.values |= {
        symbol: Bounded(column[:-1], 0.0) for symbol, column in zip(signals.y_r, given.T[1:], strict=True)
    }
    twin.keep()
    twin.ready = True
    y, *y_r = (Bounded(column, 0.0) for column in given[1:].T)
    expected = {**twin.step(y, y_r), **twin.values}
    factor = 1.0 + DOUBLE.roundoff / precision.roundoff  # the twin rounds too, to double
    columns = []
    for name, values in found.items():
        item = expected[symbols[name]]
        error = np.abs(values[1:] - item.value)
        columns.append(relative(error, factor * item.error))
    return np.column_stack(columns)
