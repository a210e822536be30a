"""Compares two computations of one function bit for bit, for the gates `interpreter` and `lanes`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.inputs.points import Batch, describe_point
from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Function


@dataclass(frozen=True)
class Answers:
    """The results of both sides at some points.

    Attributes:
        function: the one evaluated.
        batch: the points.
        expected: results of the reference, one array each, shape (points, size).
        found: results of the checked side, of the same shapes.
    """

    function: Function
    batch: Batch
    expected: tuple[Array, ...]
    found: tuple[Array, ...]


def judge(answers: Iterable[Answers], of: str) -> GateResult:
    """Count the values whose bits differ.

    Args:
        answers: of both sides.
        of: the number of functions, in words.
    """
    points = values = differing = 0
    first: Difference | None = None
    for item in answers:
        unequal = [different_bits(a, b) for a, b in zip(item.expected, item.found, strict=True)]
        points += len(item.batch.arguments[0])
        values += sum(array.size for array in item.expected)
        differing += sum(int(mask.sum()) for mask in unequal)
        first = first or _difference(item, unequal)
    if differing:
        return failed(f"{differing} of {values} values differ in their bits", differing, 0, first)
    return passed(f"values with other bits, of {values} at {points} points in {of}", 0, 0)


def different_bits(a: Array, b: Array) -> npt.NDArray[np.bool_]:
    """Where two arrays differ in any bit; NaNs are equal, as their payload depends on operand order."""
    bits = np.ascontiguousarray(a).view(np.int64) != np.ascontiguousarray(b).view(np.int64)
    return np.asarray(bits & ~(np.isnan(a) & np.isnan(b)), dtype=np.bool_)


def _difference(answers: Answers, unequal: list[npt.NDArray[np.bool_]]) -> Difference | None:
    """The first value that differs, with the point as text that can be pasted."""
    function, batch = answers.function, answers.batch
    for (label, _), a, b, mask in zip(
        function.outputs, answers.expected, answers.found, unequal, strict=True
    ):
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
