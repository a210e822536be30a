"""What a run needs of the kernels, whichever way they are evaluated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Function, Manifest

Array = npt.NDArray[np.float64]
Kernel = Callable[..., tuple[Array, ...]]
Kind = Literal["compiled", "interpreted"]


class Evaluator(Protocol):
    """The kernels of one model."""

    @property
    def kind(self) -> Kind:
        """How the kernels are evaluated."""
        ...

    @property
    def manifest(self) -> Manifest:
        """The model: names, sizes and order of every argument and result."""
        ...

    def kernel(self, name: str) -> Kernel:
        """One kernel for one point: contiguous float64 vectors in, fresh vectors out; nothing is checked."""
        ...

    def call(self, name: str, *arrays: npt.ArrayLike) -> tuple[Array, ...]:
        """Evaluate a kernel over rows.

        Args:
            name: of the kernel, as in ``model.json``.
            arrays: one for each input, shape (..., size); leading dimensions broadcast.

        Returns:
            One array for each output, shape (..., size).

        Raises:
            UsageError: there is no such kernel, or shapes do not fit.
        """
        ...


def find_function(manifest: Manifest, name: str) -> Function:
    """Look a kernel up by name.

    Raises:
        UsageError: the model has no such kernel; the message lists those it has.
    """
    try:
        return manifest.function(name)
    except KeyError:
        names = ", ".join(function.name for function in manifest.functions)
        raise UsageError(
            f"no kernel is called {name!r}", where=manifest.name, remedy=f"kernels: {names}"
        ) from None


def as_rows(function: Function, arrays: Sequence[npt.ArrayLike]) -> tuple[tuple[int, ...], list[Array]]:
    """Bring arguments into rows.

    Args:
        function: the kernel's description.
        arrays: one for each input, shape (..., size).

    Returns:
        The common leading shape, and for each argument a C-contiguous array of shape (rows, size) or, where
        it is the same for every row, (1, size).

    Raises:
        UsageError: a number of arguments or a shape that does not fit.
    """
    if len(arrays) != len(function.inputs):
        raise UsageError(f"takes {len(function.inputs)} arguments, not {len(arrays)}", where=function.name)
    given = [np.asarray(array, dtype=np.float64) for array in arrays]
    for array, (label, size) in zip(given, function.inputs, strict=True):
        if array.ndim == 0 or array.shape[-1] != size:
            raise UsageError(
                f"argument {label} has shape {array.shape}, not (..., {size})", where=function.name
            )
    try:
        shape = np.broadcast_shapes(*(array.shape[:-1] for array in given))
    except ValueError as error:
        raise UsageError(f"leading dimensions do not broadcast: {error}", where=function.name) from None
    return shape, [_rows(array, shape) for array in given]


def _rows(array: Array, shape: tuple[int, ...]) -> Array:
    size = array.shape[-1]
    if array.size == size:
        return np.ascontiguousarray(array.reshape(1, size))
    whole = array if array.shape == (*shape, size) else np.broadcast_to(array, (*shape, size))
    return np.ascontiguousarray(whole.reshape(-1, size))
