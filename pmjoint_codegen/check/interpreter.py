"""Interpreter = C: CasADi's virtual machine and compiled C agree bit for bit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.features import Features
from pmjoint_codegen.check.points import Batch, batches, describe_point
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.manifest import Function

NAME = "interpreter"
SEED = 20200501
POINTS = 120  # of each kind


def check(subject: Subject) -> GateResult:
    """Compare every kernel on random and on hard points."""
    if subject.compiled is None:
        return not_run(NAME, "no C compiler")
    return compare(subject.interpreted, subject.compiled, features=subject.features)


def compare(
    interpreted: Evaluator, compiled: Evaluator, count: int = POINTS, features: Features | None = None
) -> GateResult:
    """Compare two evaluators, kernel by kernel.

    Args:
        interpreted: one side.
        compiled: the other side; its manifest says which kernels there are.
        count: points of each kind.
        features: of the model; see `batches`.
    """
    points = values = differing = 0
    first: Difference | None = None
    for function in compiled.manifest.functions:
        for batch in batches(interpreted, function, count, SEED, extreme=True, features=features):
            expected = interpreted.call(function.name, *batch.arguments)
            found = compiled.call(function.name, *batch.arguments)
            points += len(batch.arguments[0])
            values += sum(array.size for array in expected)
            unequal = [different_bits(a, b) for a, b in zip(expected, found, strict=True)]
            differing += sum(int(mask.sum()) for mask in unequal)
            first = first or describe_difference(function, batch, expected, found, unequal)
    if differing:
        return failed(NAME, f"{differing} of {values} values differ in their bits", differing, 0, first)
    kernels = len(compiled.manifest.functions)
    return passed(NAME, f"values with other bits, of {values} at {points} points in {kernels} kernels", 0, 0)


def different_bits(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Where two arrays differ in any bit; NaNs are equal, as their payload depends on operand order."""
    bits = np.ascontiguousarray(a).view(np.int64) != np.ascontiguousarray(b).view(np.int64)
    return np.asarray(bits & ~(np.isnan(a) & np.isnan(b)), dtype=np.bool_)


def describe_difference(
    function: Function,
    batch: Batch,
    expected: tuple[npt.NDArray[np.float64], ...],
    found: tuple[npt.NDArray[np.float64], ...],
    unequal: list[npt.NDArray[np.bool_]],
) -> Difference | None:
    """The first value of some results that differs, with the point as text that can be pasted."""
    for (label, _), a, b, mask in zip(function.outputs, expected, found, unequal, strict=True):
        if mask.any():
            row, entry = (int(i) for i in np.argwhere(mask)[0])
            point = f"({batch.kind}) {describe_point(function, batch.arguments, row)}"
            x, y = float(a[row, entry]), float(b[row, entry])
            error = f"{abs(y - x):.3g}"
            return Difference(
                function.name,
                f"{label}[{entry}]",
                point,
                f"{x!r} ({x.hex()})",
                f"{y!r} ({y.hex()})",
                error,
                "0",
            )
    return None
