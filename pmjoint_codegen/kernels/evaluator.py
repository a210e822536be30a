"""The interface of the kernels for runs, whichever way they are evaluated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Function, Manifest

Array = npt.NDArray[np.float64]
Kernel = Callable[..., tuple[Array, ...]]
Kind = Literal["compiled", "interpreted"]
Recipe = tuple[Callable[..., "PreparingEvaluator"], tuple[Any, ...]]


@dataclass(frozen=True)
class Prepared:
    """A kernel with memory of its own, for one user at a time.

    Attributes:
        inputs: arrays that it reads, one for each argument.
        outputs: arrays that it writes, one for each result.
        run: evaluates it; raises `SimulationError` if it reports failure.
    """

    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    run: Callable[[], None]


class Kernels(ABC):
    """The base of both evaluators.

    They are pickled and copied by their recipe: loaded code and C memory belong to one process.

    Attributes:
        recipe: see `PreparingEvaluator`.
    """

    recipe: Recipe | None = None

    def __reduce__(self) -> Recipe:
        """Give the recipe; raises `TypeError` if there is none."""
        if self.recipe is None:
            raise TypeError(f"{type(self).__name__} cannot be copied: ClosedLoop.load did not make it")
        return self.recipe

    @abstractmethod
    def prepare(self, name: str) -> Prepared:
        """One kernel for single points in sequence, its arguments and results in place."""

    def kernel(self, name: str) -> Kernel:
        """One kernel for one point: contiguous float64 vectors in, fresh vectors out; nothing is checked."""
        prepared = self.prepare(name)

        def evaluate(*arrays: Array) -> tuple[Array, ...]:
            for argument, array in zip(prepared.inputs, arrays, strict=True):
                argument[:] = array
            prepared.run()
            return tuple(result.copy() for result in prepared.outputs)

        return evaluate


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


class PreparingEvaluator(Evaluator, Protocol):
    """The interface for scripts, beyond that for runs.

    Attributes:
        recipe: a function and its arguments, which make the same evaluator in another process; None:
            unknown.
    """

    recipe: Recipe | None

    def prepare(self, name: str) -> Prepared:
        """One kernel for single points in sequence, its arguments and results in place.

        Raises:
            UsageError: there is no such kernel.
        """
        ...

    def call(
        self, name: str, *arrays: npt.ArrayLike, results: Sequence[str] | None = None
    ) -> tuple[Array, ...]:
        """Evaluate a kernel over rows, as `Evaluator.call`.

        Args:
            name: of the kernel.
            arrays: one for each input.
            results: labels of the requested outputs, returned in the kernel's order; None: all.
        """
        ...


def find_function(manifest: Manifest, name: str) -> Function:
    """Look a kernel up by name.

    Raises:
        UsageError: the model has no such kernel; the message lists its kernels.
    """
    try:
        return manifest.function(name)
    except KeyError:
        names = ", ".join(function.name for function in manifest.functions)
        raise UsageError(
            f"no kernel is called {name!r}", where=manifest.name, remedy=f"kernels: {names}"
        ) from None


def prepared_arrays(function: Function) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Zeros for every argument and every result."""
    inputs = tuple(np.zeros(size) for _, size in function.inputs)
    return inputs, tuple(np.zeros(size) for _, size in function.outputs)


def wanted_outputs(function: Function, results: Sequence[str] | None) -> list[bool]:
    """The indices of the requested outputs; all for None.

    Raises:
        UsageError: a label that no output has.
    """
    labels = [label for label, _ in function.outputs]
    if unknown := set(results or ()) - set(labels):
        raise UsageError(
            f"gives no {sorted(unknown)[0]}", where=function.name, remedy=f"it gives: {', '.join(labels)}"
        )
    return [results is None or label in results for label, _ in function.outputs]


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
    shapes = {array.shape[:-1] for array in given} - {()}
    if not shapes:
        return (), [_row(array) for array in given]
    try:
        shape = shapes.pop() if len(shapes) == 1 else np.broadcast_shapes(*shapes)
    except ValueError as error:
        raise UsageError(f"leading dimensions do not broadcast: {error}", where=function.name) from None
    return shape, [_rows(array, shape) for array in given]


def _rows(array: Array, shape: tuple[int, ...]) -> Array:
    size = array.shape[-1]
    if array.size == size:
        return _row(array)
    whole = array if array.shape[:-1] == shape else np.broadcast_to(array, (*shape, size))
    return np.ascontiguousarray(whole.reshape(-1, size))


def _row(array: Array) -> Array:
    return np.ascontiguousarray(array.reshape(1, array.shape[-1]))
