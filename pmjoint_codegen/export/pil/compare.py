"""A processor's answers against this machine's, and against the derived bound on rounding errors.

Without functions of the C library every operation is IEEE 754's, so both sides must agree in every bit. With
them, libraries differ in the last places. In either case each step is judged by itself: from the state that
the processor had at one sample, its answers at the next are what the equations give, within the bound of
`pmjoint_codegen.export.bounds`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.bounds import Bounded
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.records import Answer, Array, other_bits
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.statements import Program
from pmjoint_codegen.export.tree import DOUBLE, operations_in, tree_of
from pmjoint_codegen.export.twin import COMMAND, Twin, bounded_arithmetic

_BASIC: Final = frozenset({"add", "sub", "mul", "div", "neg", "fmin", "fmax", "fabs", "sqrt", "sign"})
_LEAVES: Final = frozenset({"number", "name"})


@dataclass(frozen=True)
class Agreement:
    """One precision's answers compared.

    Attributes:
        values: how many were compared.
        other_bits: how many have other bits than the host's.
        ratio: largest difference of a step from the equations, relative to its bound.
    """

    values: int
    other_bits: int
    ratio: float


def library_functions(program: Program) -> tuple[str, ...]:
    """The functions of the C library that a controller calls, but those that IEEE 754 defines exactly."""
    groups = (program.constants, program.law, program.update, program.start)
    trees = [item.tree for group in groups for item in group]
    trees += [tree_of(entry.value) for entry in program.matrices]
    trees += [tree_of(value) for value in program.starts.values()]
    found = set[str]().union(*(operations_in(tree) for tree in trees)) - _BASIC - _LEAVES
    if "filter" in program.derivation.model.chain:
        found.add("expm1")
    return tuple(sorted(found))


def compare(export: Export, given: Array, target: Answer, host: Answer, place: str) -> Agreement:
    """Compare a processor's answers with the host's and with the bound.

    Args:
        export: the controller.
        given: the samples, shape (samples, inputs), as they were before rounding to the precision.
        target: the processor's answers.
        host: this machine's, to the same samples.
        place: for messages.

    Raises:
        CheckFailed: bits differ though no function of the library is called, or a step is beyond the bound.
    """
    differing = other_bits(target, host)
    if differing.any() and not library_functions(export.program):
        row, column = (int(i) for i in np.argwhere(differing)[0])
        name = target.layout.columns.values[column]
        a, b = (float(item.column(name)[row]) for item in (host, target))
        told = f"{name} at sample {row} is {b!r}, on this machine {a!r}"
        raise CheckFailed(f"{int(differing.sum())} values have other bits: {told}", where=place)
    ratio = step_ratios(export, given, target)
    worst = np.unravel_index(np.argmax(ratio), ratio.shape)
    if not ratio[worst] <= 1.0:
        name = target.layout.columns.values[int(worst[1])]
        told = f"{name} at sample {int(worst[0]) + 1} is off by {ratio[worst]:.3g} times its derived bound"
        raise CheckFailed(told, where=place)
    return Agreement(differing.size, int(differing.sum()), float(ratio[worst]))


def step_ratios(export: Export, given: Array, target: Answer) -> Array:
    """How far each step is from the equations, relative to its bound, shape (samples - 1, values)."""
    program, precision = export.program, export.precision
    sign = program.derivation.signals
    start = twin_of(program, bounded_arithmetic(precision), precision, matched=False)
    samples = given.astype(target.layout.real).astype(np.float64)
    held = {symbol: target.column(symbol.name) for symbol in program.states}
    held |= {sign.y: target.column("y"), sign.u: target.column("u"), sign.v: target.column("v")}
    held |= {COMMAND: target.column("command")}
    start.values = {symbol: Bounded(column[:-1], 0.0) for symbol, column in held.items()}
    found = _next(start, samples[1:])
    names = target.layout.columns.values
    symbols = {symbol.name: symbol for symbol in (*program.states, *program.estimate, *sign.z)}
    symbols |= {"y": sign.y, "v": sign.v, "u": sign.u, "command": COMMAND}
    # The twin rounds too, to double.
    factor = 1.0 + DOUBLE.roundoff / precision.roundoff
    columns = []
    for name in names:
        expected = found[symbols[name]]
        error = np.abs(target.column(name)[1:] - expected.value)
        with np.errstate(all="ignore"):  # 0/0 is a value that both have exactly
            ratio = np.where(error > 0.0, error / (factor * expected.error), 0.0)
        columns.append(np.where(np.isnan(error) | np.isnan(ratio), np.inf, ratio))
    return np.column_stack(columns)


def _next(twin: Twin, samples: Array) -> dict[Any, Bounded]:
    """What a twin gives one sample later, at every sample at once."""
    twin.ready = True
    y, *y_r = (Bounded(column, 0.0) for column in samples.T)
    found = twin.step(y, y_r)
    return {**twin.values, **found}
