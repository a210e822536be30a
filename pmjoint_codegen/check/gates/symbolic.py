"""Symbolic = C: every result of every kernel against the derivation at sixty digits, within a derived bound.

The bound comes from :mod:`error_bound`, which evaluates the emitted instructions at the same point. It is
tight where nothing cancels, and wide exactly where cancellation makes a result uncertain. A limit in ULP
would be neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.inputs.points import describe_point
from pmjoint_codegen.check.oracles.error_bound import LITERAL_ROUNDINGS, walk
from pmjoint_codegen.check.oracles.precise import Numbers
from pmjoint_codegen.check.oracles.reference import (
    Reference,
    Rows,
    reference_of,
    sample_reference,
    taylor_reference,
)
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.emit.loop_table import loop_rows
from pmjoint_codegen.emit.table import Guard, Taylor
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.manifest import Function
from pmjoint_derive.closed_loop import column_name

Array = npt.NDArray[np.float64]

SEED = 20200529
POINTS = 8  # of each kind
TAYLOR_POINTS = 2
LARGEST = float(np.finfo(np.float64).max)
STEEP = LARGEST**0.5  # beyond it, the product of two coefficients overflows


@dataclass(frozen=True)
class Prepared:
    """A kernel's points with the reference for the code's results.

    Attributes:
        function: the kernel, as the manifest describes it.
        reference: its symbolic reference.
        arguments: one for each input, shape (points, size).
        exact: results at 60 digits, one table per output.
        bounds: error bound of each result, one array per output, shape (points, size).
    """

    function: Function
    reference: Reference
    arguments: tuple[Array, ...]
    exact: tuple[Rows, ...]
    bounds: tuple[Array, ...]


@dataclass(frozen=True)
class Judgement:
    """The result of the comparison of one kernel.

    Attributes:
        values: number of results compared.
        unbounded: number of results without a finite bound, though their exact value is finite.
        ratio: largest error / bound.
        error: the error there.
        bound: the bound there.
        where: kernel and entry there.
        difference: the first result beyond its bound.
    """

    values: int
    unbounded: int
    ratio: float
    error: float
    bound: float
    where: str
    difference: Difference | None


def check(subject: Subject) -> GateResult:
    """Compare every compiled kernel with its reference; kernels that are bounds have their own gate."""
    if subject.compiled is None:
        return not_run("no C compiler")
    mismatch = vocabulary_mismatch(subject)
    if mismatch:
        return failed(mismatch)
    judgements, guards = [], [row.name for row in loop_rows(subject.table) if isinstance(row, Guard)]
    for function in subject.manifest.functions:
        if function.name in guards:
            continue
        prepared = prepare(subject, function)
        judgements.append(judge(prepared, subject.compiled.call(function.name, *prepared.arguments)))
    return conclude(judgements)


def vocabulary_mismatch(subject: Subject) -> str:
    """Names in the manifest that differ from the derivation, or nothing."""
    manifest, loop = subject.manifest, subject.table["closed_loop"]
    words = {label: tuple(symbol.name for symbol in symbols) for label, symbols in loop.inputs}
    partials = tuple(symbol.name for symbol in subject.table["partials"].outputs[0][1])
    reported = subject.table["signals"].outputs[0][1]
    signals = tuple(column_name(subject.model, symbol) for symbol in reported)
    pairs = {
        "parameters": (tuple(item.name for item in manifest.parameters), words["p"]),
        "states": (tuple(item.name for item in manifest.states), words["X"]),
        "signals": (tuple(item.name for item in manifest.signals), signals),
        "partial derivatives": (manifest.partials, partials),
        "kernels": (
            tuple(item.name for item in manifest.functions),
            (*subject.table, *(row.name for row in loop_rows(subject.table))),
        ),
    }
    return "; ".join(f"{what}: {a} in model.json, {b} derived" for what, (a, b) in pairs.items() if a != b)


def kernel_reference(subject: Subject, function: Function) -> Reference:
    """The reference of any kernel, including those composed from the table's rows."""
    derivation, table, manifest = subject.derivation, subject.table, subject.manifest
    if function.name in table:
        return reference_of(derivation, table[function.name])
    for row in loop_rows(table):
        if row.name == function.name and isinstance(row, Taylor):
            return taylor_reference(row.name, derivation, table[row.of], row.order or manifest.order)
    plant = taylor_reference("plant_taylor", derivation, table["plant"], manifest.hold_order)
    return sample_reference(derivation, table["sampled_update"], plant)


def prepare(subject: Subject, function: Function, count: int | None = None) -> Prepared:
    """Points, exact results and bounds for one kernel."""
    reference = kernel_reference(subject, function)
    wanted = count or (TAYLOR_POINTS if reference.taylor else POINTS)
    found = subject.points(function, wanted, SEED)
    arguments = tuple(
        np.concatenate(arrays) for arrays in zip(*(batch.arguments for batch in found), strict=True)
    )
    return prepare_at(reference, subject.tapes[function.name], function, arguments)


def prepare_at(
    reference: Reference, emitted: Tape, function: Function, arguments: tuple[Array, ...]
) -> Prepared:
    """Exact results and bounds at given points."""
    roundings = max(LITERAL_ROUNDINGS, 2 * reference.order)
    bounds = tuple(result.error for result in walk(emitted, arguments, roundings))
    return Prepared(function, reference, arguments, tuple(reference.values(arguments)), bounds)


def judge(prepared: Prepared, results: Sequence[Array]) -> Judgement:
    """Check results against the reference.

    Args:
        prepared: points, exact results and bounds.
        results: the code's results there, one array per output.
    """
    numbers = Numbers()
    values = unbounded = 0
    worst, first = (0.0, 0.0, 0.0, ""), None
    for output, (table, bound, result) in enumerate(
        zip(prepared.exact, prepared.bounds, results, strict=True)
    ):
        for row, column in np.ndindex(*result.shape):
            values += 1
            found, allowed = float(result[row, column]), float(bound[row, column])
            if not np.isfinite(found) and abs(table[row][column]) > LARGEST:
                continue  # the exact value overflows, and so does the code
            if np.isnan(found) and numbers.context.im(table[row][column]) != 0:
                continue  # V where a true value is outside its range: both have none
            error = float(abs(numbers.exactly(found) - table[row][column])) if np.isfinite(found) else np.inf
            if not np.isfinite(allowed):
                if prepared.reference.taylor and max(map(abs, table[row])) > STEEP:
                    continue  # so high a coefficient takes products that overflow, though it does not
                unbounded += 1
                first = first or _difference(prepared, output, row, column, found, error)
                continue
            ratio = error / allowed if allowed > 0 else (0.0 if error == 0 else np.inf)
            if ratio > worst[0]:
                worst = (
                    ratio,
                    error,
                    allowed,
                    f"{prepared.function.name}, {prepared.reference.entries[output][column]}",
                )
            if not ratio <= 1 and first is None:
                first = _difference(prepared, output, row, column, found, error)
    return Judgement(values, unbounded, *worst, first)


def conclude(judgements: Sequence[Judgement]) -> GateResult:
    """One result from the comparisons of all kernels."""
    values = sum(item.values for item in judgements)
    unbounded = sum(item.unbounded for item in judgements)
    worst = max(judgements, key=lambda item: item.ratio)
    first = next((item.difference for item in judgements if item.difference), None)
    detail = f"largest error/bound of {values} values: {worst.error:.2e}/{worst.bound:.2e} in {worst.where}"
    if unbounded:
        return failed(f"{unbounded} of {values} values have no finite error bound", worst.ratio, 1, first)
    if first is not None:
        return failed(detail, worst.ratio, 1, first)
    return passed(detail, worst.ratio, 1)


def _difference(
    prepared: Prepared, output: int, row: int, column: int, found: float, error: float
) -> Difference:
    context = Numbers().context
    exact = prepared.exact[output][row][column]
    return Difference(
        kernel=prepared.function.name,
        entry=prepared.reference.entries[output][column],
        point=describe_point(prepared.function, prepared.arguments, row),
        expected=context.nstr(exact, 25),
        found=repr(found),
        error=f"{error:.3g}",
        bound=f"{prepared.bounds[output][row, column]:.3g}",
    )
