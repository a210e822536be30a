"""The kernels interpreted by CasADi: the way without a compiler.

Alone in the runtime, this module imports CasADi, inside functions.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import MissingToolError, StaleError
from pmjoint_codegen.kernels.evaluator import Array, Kernel, Kind, as_rows, find_function
from pmjoint_codegen.kernels.tape import FILE_NAME, Tape, read_tapes
from pmjoint_codegen.manifest import Manifest


class InterpretedEvaluator:
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

    def kernel(self, name: str) -> Kernel:
        """One kernel for one point: contiguous float64 vectors in, fresh vectors out; nothing is checked."""
        description = find_function(self.manifest, name)
        buffer, trigger = self._function(name).buffer()
        arguments = [np.empty(size) for _, size in description.inputs]
        results = [np.empty(size) for _, size in description.outputs]
        for i, array in enumerate(arguments):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(results):
            buffer.set_res(i, array.data)

        def evaluate(*arrays: Array) -> tuple[Array, ...]:
            for argument, array in zip(arguments, arrays, strict=True):
                argument[:] = array
            trigger()
            return tuple(result.copy() for result in results)

        evaluate.__dict__["keep_alive"] = buffer
        return evaluate

    def call(self, name: str, *arrays: npt.ArrayLike) -> tuple[Array, ...]:
        """Evaluate a kernel over rows; see `Evaluator.call`."""
        description = find_function(self.manifest, name)
        shape, rows = as_rows(description, arrays)
        count = int(np.prod(shape))
        if count == 0:
            return tuple(np.empty((*shape, size)) for _, size in description.outputs)
        columns = [np.broadcast_to(array, (count, array.shape[1])).T for array in rows]
        found = self._function(name).map(count)(*columns)
        results = [found] if len(description.outputs) == 1 else list(found)
        return tuple(np.asarray(result.full().T).reshape(*shape, -1) for result in results)

    def _function(self, name: str) -> Any:
        if name not in self._functions:
            self._functions[name] = rebuild(self._tapes[name])
        return self._functions[name]


def rebuild(tape: Tape) -> Any:
    """The CasADi function that a tape was made from: the same operations in the same order."""
    import casadi

    arguments = [casadi.SX.sym(label, size) for label, size in tape.inputs]
    results = [casadi.SX.zeros(size) for _, size in tape.outputs]
    apply = _operations(casadi)
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


def _operations(casadi: Any) -> Mapping[str, Callable[..., Any]]:
    """What each operation of a tape is in CasADi."""
    named = ("sqrt", "sin", "cos", "tan", "tanh", "exp", "log", "fmin", "fmax", "fabs", "sign")
    arithmetic: dict[str, Callable[..., Any]] = {
        "neg": operator.neg,
        "sq": lambda a: a * a,
        "twice": lambda a: 2 * a,
        "inv": lambda a: 1 / a,
        "add": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "div": operator.truediv,
        "pow": operator.pow,
    }
    return arithmetic | {name: getattr(casadi, name) for name in named}


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
            remedy="install it: pip install 'pmjoint-codegen[derive]', or a C compiler: apt-get install gcc",
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
