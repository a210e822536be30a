"""The symbolic reference of every kernel, evaluated to sixty digits at exact points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.check.oracles.precise import Number, Numbers, PowerSeries, Series
from pmjoint_codegen.check.oracles.program import Program, compile_program
from pmjoint_codegen.emit.table import Kernel, actuator_limits
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_derive import Derivation

Array = npt.NDArray[np.float64]
Rows = list[list[Number]]  # one row per point


@dataclass(frozen=True)
class Reference:
    """The correct results of a kernel.

    Attributes:
        name: of the kernel.
        entries: name of every result, one tuple per output.
        inputs: symbols of every argument, in order.
        program: the expressions of all results.
        taylor: number of states whose rates the first results are, for a kernel of Taylor coefficients; else
            0.
        order: highest Taylor coefficient.
        plant: for ``sample``, the reference of the plant's coefficients under the w of output 1; they are
            output 2, which the program omits.
        kinks: how many of the last results of a rate are arguments of kinks.
    """

    name: str
    entries: tuple[tuple[str, ...], ...]
    inputs: tuple[tuple[sp.Symbol, ...], ...]
    program: Program
    taylor: int = 0
    order: int = 0
    plant: Reference | None = None
    kinks: int = 0

    def values(self, arguments: Sequence[Array]) -> list[Rows]:
        """Exact results, rounded to 60 digits: one table per output, one row per point."""
        numbers = Numbers()
        rows = [self._row(numbers, [array[k] for array in arguments]) for k in range(len(arguments[0]))]
        tables: list[Rows] = []
        first = 0
        for names in self.entries:
            tables.append([row[first : first + len(names)] for row in rows])
            first += len(names)
        return tables

    def _row(self, numbers: Numbers, point: list[Array]) -> list[Number]:
        exact = {
            symbol: numbers.exactly(float(value))
            for symbols, array in zip(self.inputs, point, strict=True)
            for symbol, value in zip(symbols, array, strict=True)
        }
        if self.taylor:
            return self._series(numbers, exact)
        results = self.program.run(numbers, exact)
        return results if self.plant is None else self._with_plant(self.plant, numbers, exact, results)

    def _with_plant(
        self, plant: Reference, numbers: Numbers, exact: dict[sp.Symbol, Number], results: list[Number]
    ) -> list[Number]:
        """Results with the plant's coefficients in their place."""
        first, last = len(self.entries[0]), len(self.entries[0]) + len(self.entries[1])
        w = dict(zip(plant.inputs[2], results[first:last], strict=False))
        sides = plant.inputs[2][len(w) :]
        known = exact | w | dict.fromkeys(sides, numbers.context.one)
        for j, side in enumerate(sides):  # an argument depends on the sides before its own
            arguments = plant.program.run(numbers, known)[-plant.kinks :]
            known[side] = numbers.apply("sign", arguments[j])
        return [*results[:last], *plant._series(numbers, known), *results[last:]]

    def _series(self, numbers: Numbers, exact: dict[sp.Symbol, Number]) -> list[Number]:
        """Taylor coefficients by Picard's iteration: each pass over the right-hand side fixes one more."""
        state = self.inputs[1]
        inputs: dict[sp.Symbol, Series] = {symbol: [value] for symbol, value in exact.items()}
        time = self.inputs[0][0]
        for k in range(self.order + 1):
            inputs[time] = [exact[time], numbers.context.one][: k + 1]
            results = self.program.run(PowerSeries(numbers, k), inputs)
            if k < self.order:
                for symbol, rate in zip(state, results, strict=False):
                    inputs[symbol].append((rate[k] if k < len(rate) else numbers.context.zero) / (k + 1))
        channels = [*(inputs[symbol] for symbol in state), *results[self.taylor :]]
        zero = numbers.context.zero
        return [series[k] if k < len(series) else zero for k in range(self.order + 1) for series in channels]


def reference_of(derivation: Derivation, kernel: Kernel) -> Reference:
    """The reference of one row of the table of kernels."""
    expressions = [sp.sympify(entry) for _, entries in kernel.outputs for entry in entries]
    inputs = tuple(tuple(sp.sympify(symbol) for symbol in symbols) for _, symbols in kernel.inputs)
    known = [symbol for symbols in inputs for symbol in symbols]
    program = compile_program(expressions, known, derivation.equations, kernel.given, kernel.sides)
    names = tuple(_entry_names(label, entries) for label, entries in kernel.outputs)
    return Reference(kernel.name, names, inputs, program, kinks=len(kernel.sides))


def taylor_reference(name: str, derivation: Derivation, kernel: Kernel, order: int) -> Reference:
    """The reference of a kernel of Taylor coefficients.

    Args:
        name: of the Taylor kernel.
        derivation: the symbolic reference.
        kernel: row of the table that gives the rates, then values; its first inputs are time and the state.
        order: highest coefficient.
    """
    plain = reference_of(derivation, kernel)
    values = [name for names in plain.entries[1:] for name in names]
    channels = [*(symbol.name for symbol in plain.inputs[1]), *values]
    entries = tuple(f"coefficient {k} of {channel}" for k in range(order + 1) for channel in channels)
    return replace(plain, name=name, entries=(entries,), taylor=len(plain.inputs[1]), order=order)


def sample_reference(derivation: Derivation, update: Kernel, plant: Reference) -> Reference:
    """The reference of ``sample``.

    Args:
        derivation: the symbolic reference.
        update: row of the table that gives the controller's next state.
        plant: reference of the coefficients of the plant under constant w.
    """
    words, v = vocabulary(derivation), derivation.signals.v
    (label, s_next), (h,) = update.outputs[0], [block for block in update.inputs if block[0] == "h"]
    actuated = {
        w: sp.Min(sp.Max(offset + slope * v, lower), upper)
        for w, (offset, slope, lower, upper) in actuator_limits(derivation).items()
    }
    inputs = ((derivation.signals.t,), (*words.x, *words.s), tuple(map(sp.sympify, h[1])), words.p)
    known = [symbol for symbols in inputs for symbol in symbols]
    # The compensator is driven by the applied input: entry 0 of w is u.
    program = compile_program([v, *words.w, *s_next], known, derivation.equations, actuated)
    entries = (
        (v.name,),
        tuple(symbol.name for symbol in words.w),
        *plant.entries,
        _entry_names(label, s_next),
    )
    return Reference("sample", entries, inputs, program, order=plant.order, plant=plant)


def _entry_names(label: str, entries: tuple[Any, ...]) -> tuple[str, ...]:
    return tuple(
        entry.name if getattr(entry, "is_Symbol", False) else f"{label}[{i}]"
        for i, entry in enumerate(entries)
    )
