"""The kernels interpreted by CasADi, without a compiler.

In the runtime, only this module imports CasADi, inside functions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.compile.compiler import install_line
from pmjoint_codegen.errors import MissingToolError, StaleError, installing
from pmjoint_codegen.kernels.evaluator import (
    Array,
    Kernels,
    Kind,
    Prepared,
    as_rows,
    find_function,
    prepared_arrays,
    wanted_outputs,
)
from pmjoint_codegen.kernels.tape import FILE_NAME, Tape, read_tapes
from pmjoint_codegen.kernels.turn import alone
from pmjoint_codegen.manifest import Function, Manifest
from pmjoint_codegen.operations import by_name


class InterpretedEvaluator(Kernels):
    """One model's kernels in CasADi's virtual machine: `Evaluator`.

    Attributes:
        kind: ``"interpreted"``.
        manifest: the model.
    """

    kind: Kind = "interpreted"

    def __init__(self, manifest: Manifest, tapes: Mapping[str, Tape]) -> None:
        self.manifest = manifest
        self._tapes = tapes
        self._functions: dict[str, Any] = {}

    @alone
    def prepare(self, name: str) -> Prepared:
        """One kernel for single points in sequence, its arguments and results in place; see `Evaluator`."""
        arrays = prepared_arrays(find_function(self.manifest, name))
        buffer, trigger = self._function(name).buffer()
        for place, side in zip((buffer.set_arg, buffer.set_res), arrays, strict=True):
            for i, array in enumerate(side):
                place(i, array.data)

        def run(_keep: object = (buffer, arrays)) -> None:
            trigger()

        return Prepared(*arrays, run)

    def call(
        self, name: str, *arrays: npt.ArrayLike, results: Sequence[str] | None = None
    ) -> tuple[Array, ...]:
        """Evaluate a kernel over rows; see `Evaluator.call`."""
        description = find_function(self.manifest, name)
        shape, rows = as_rows(description, arrays)
        found = self._map(description, math.prod(shape), rows)
        wanted = wanted_outputs(description, results)
        return tuple(
            result.reshape(*shape, result.shape[1])
            for result, asked in zip(found, wanted, strict=True)
            if asked
        )

    @alone
    def _map(self, description: Function, count: int, rows: list[Array]) -> list[Array]:
        if count == 0:
            return [np.empty((0, size)) for _, size in description.outputs]
        columns = [np.broadcast_to(array, (count, array.shape[1])).T for array in rows]
        found = self._function(description.name).map(count)(*columns)
        results = [found] if len(description.outputs) == 1 else list(found)
        return [np.asarray(result.full().T) for result in results]

    def _function(self, name: str) -> Any:
        if name not in self._functions:
            self._functions[name] = rebuild(self._tapes[name])
        return self._functions[name]


@alone
def rebuild(tape: Tape) -> Any:
    """The CasADi function that a tape was made from: the same operations in the same order.

    CasADi's simplifications, such as ``x (1/y) = x/y``, are off meanwhile: they change bits.
    """
    import casadi

    rules = casadi.GlobalOptions.getSimplificationOnTheFly()
    casadi.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        return _rebuilt(casadi, tape)
    finally:
        casadi.GlobalOptions.setSimplificationOnTheFly(rules)


def _rebuilt(casadi: Any, tape: Tape) -> Any:
    arguments = [casadi.SX.sym(label, size) for label, size in tape.inputs]
    results = [casadi.SX.zeros(size) for _, size in tape.outputs]
    apply = {name: operation.of(casadi) for name, operation in by_name().items()}
    values: list[Any] = []
    for item in tape.instructions:
        if item.operation == "output":
            result, entry, value = item.operands
            results[result][entry] = values[value]
        elif item.operation == "input":
            values.append(arguments[item.operands[0]][item.operands[1]])
        elif item.operation == "const":
            values.append(casadi.SX(item.value))
        else:
            values.append(apply[item.operation](*(values[operand] for operand in item.operands)))
    names_in, names_out = ([label for label, _ in side] for side in (tape.inputs, tape.outputs))
    return casadi.Function(tape.name, arguments, results, names_in, names_out)


def load(folder: Path, manifest: Manifest) -> InterpretedEvaluator:
    """Load the tapes of a model's kernels.

    Args:
        folder: holds ``kernels.tape``.
        manifest: the model.

    Raises:
        MissingToolError: CasADi is not installed.
        StaleError: the file is missing, unreadable or lacks a kernel.
    """
    try:
        import casadi  # noqa: F401 - only whether it is there
    except ImportError:
        raise MissingToolError(
            "casadi is needed to interpret the kernels",
            remedy=f"install it: {installing('pmjoint-codegen[derive]')}, or a C compiler: {install_line()}",
        ) from None
    path = folder / FILE_NAME
    try:
        tapes = read_tapes(path.read_text(encoding="utf-8"))
        lacking = [function.name for function in manifest.functions if function.name not in tapes]
    except (OSError, ValueError, IndexError):
        raise StaleError(
            "is missing or unreadable", where=str(path), remedy="run pmjoint regenerate"
        ) from None
    if lacking:
        raise StaleError(
            f"lacks the kernels {', '.join(lacking)}", where=str(path), remedy="run pmjoint regenerate"
        )
    return InterpretedEvaluator(manifest, tapes)
