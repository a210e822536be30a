"""The kernels interpreted by CasADi: the way without a compiler.

Alone in the runtime, this module imports CasADi, inside functions.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import MissingToolError, StaleError
from pmjoint_codegen.kernels.evaluator import Array, Kernel, Kind, as_rows, find_function
from pmjoint_codegen.manifest import Manifest

FILE_NAME = "kernels.casadi"


class InterpretedEvaluator:
    """One model's kernels in CasADi's virtual machine: `Evaluator`.

    Attributes:
        kind: ``"interpreted"``.
        manifest: the model.
    """

    kind: Kind = "interpreted"

    def __init__(self, manifest: Manifest, serialised: dict[str, str]) -> None:
        self.manifest = manifest
        self._serialised = serialised
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
        import casadi

        if name not in self._functions:
            self._functions[name] = casadi.Function.deserialize(self._serialised[name])
        return self._functions[name]


def load(folder: Path, manifest: Manifest) -> InterpretedEvaluator:
    """Load the serialised kernels of a model.

    Args:
        folder: holds ``kernels.casadi``.
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
        serialised = json.loads(path.read_text(encoding="utf-8"))
        lacking = [function.name for function in manifest.functions if function.name not in serialised]
    except (OSError, ValueError, TypeError):
        raise StaleError(
            "is missing or unreadable", where=str(path), remedy="run pmjoint regenerate"
        ) from None
    if lacking:
        raise StaleError(
            f"lacks the kernels {', '.join(lacking)}", where=str(path), remedy="run pmjoint regenerate"
        )
    return InterpretedEvaluator(manifest, serialised)
