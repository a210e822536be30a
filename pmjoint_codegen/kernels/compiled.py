"""The kernels as compiled C, through cffi in ABI mode."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.library import FLAGS, build
from pmjoint_codegen.errors import BuildError, SimulationError, StaleError
from pmjoint_codegen.kernels.declarations import MODULE, declarations, exported, load_library, to_module
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
from pmjoint_codegen.kernels.processor import Level, known_levels
from pmjoint_codegen.manifest import Manifest

RUNTIME_HEADER: Final = "pmjoint_runtime.h"
GENERATED: Final = ("kernels.c", "kernels.h", "loops.c", "sampled.h")


class BoundFunction(NamedTuple):
    """A kernel and the memory that its C struct points to, which must live as long as the struct.

    Attributes:
        struct: ``pmj_function *``.
        memory: its pointer arrays, ``arg`` and ``res``.
        library: the one that contains its code.
    """

    struct: Any
    memory: tuple[Any, Any]
    library: Any


class CompiledEvaluator(Kernels):
    """One loaded library: `Evaluator`, and the C loops for `simulate`.

    Attributes:
        kind: ``"compiled"``.
        manifest: the model.
        ffi: cffi's object for the library's types.
        lib: the library.
    """

    kind: Kind = "compiled"

    def __init__(self, manifest: Manifest, ffi: Any, lib: Any) -> None:
        self.manifest = manifest
        self.ffi = ffi
        self.lib = lib

    def function(self, name: str) -> BoundFunction:
        """A kernel with pointer arrays of its own, for one user at a time."""
        description = find_function(self.manifest, name)
        arg = self.ffi.new("const double *[]", len(description.inputs))
        res = self.ffi.new("double *[]", len(description.outputs))
        call = self.ffi.cast("pmj_kernel", getattr(self.lib, exported(name)))
        # kernels.h: iw and w are unused and may be null.
        return BoundFunction(
            self.ffi.new("pmj_function *", {"call": call, "arg": arg, "res": res}), (arg, res), self.lib
        )

    def prepare(self, name: str) -> Prepared:
        """One kernel for one point after another, its arguments and results in place; see `Evaluator`."""
        bound = self.function(name)
        arrays = prepared_arrays(find_function(self.manifest, name))
        for pointers, side in zip(bound.memory, arrays, strict=True):
            for i, array in enumerate(side):
                pointers[i] = self.ffi.from_buffer("double[]", array)
        apply, struct = self.lib.pmj_apply, bound.struct

        def run(_keep: object = (bound, arrays)) -> None:
            if failed := apply(struct):
                _check(name, failed)

        return Prepared(*arrays, run)

    def call(
        self, name: str, *arrays: npt.ArrayLike, results: Sequence[str] | None = None
    ) -> tuple[Array, ...]:
        """Evaluate a kernel over rows; see `Evaluator.call`."""
        description = find_function(self.manifest, name)
        shape, rows = as_rows(description, arrays)
        count = math.prod(shape)
        sizes = [size for _, size in description.outputs]
        wanted = wanted_outputs(description, results)
        found = [
            np.empty((count, size)) if asked else None for size, asked in zip(sizes, wanted, strict=True)
        ]
        self._map(name, count, rows, found, sizes)
        return tuple(result.reshape(*shape, result.shape[1]) for result in found if result is not None)

    def _map(
        self,
        name: str,
        count: int,
        arguments: list[Array],
        results: list[Array | None],
        sizes: list[int],
    ) -> None:
        ffi = self.ffi
        inputs = [ffi.from_buffer("double[]", array) for array in arguments]
        outputs = [ffi.NULL if array is None else ffi.from_buffer("double[]", array) for array in results]
        strides = [array.shape[1] if len(array) > 1 else 0 for array in arguments]
        bound = self.function(name)
        failed = self.lib.pmj_map(
            bound.struct,
            count,
            len(inputs),
            ffi.new("const double *[]", inputs),
            ffi.new("long long[]", strides),
            len(outputs),
            ffi.new("double *[]", outputs),
            ffi.new("long long[]", sizes),
        )
        _check(name, failed)


def load(
    folder: Path,
    manifest: Manifest,
    compiler: Compiler,
    cache: Path,
    levels: Sequence[Level] | None = None,
) -> CompiledEvaluator:
    """Build the kernels of a model, or reuse the build, and load them.

    Args:
        folder: holds the files of `GENERATED`.
        manifest: the model.
        compiler: to build with.
        cache: folder for builds.
        levels: instructions that this machine has, the widest first, by default the lowest only; if a
            compiler does not know one, the next is tried.

    Raises:
        BuildError: the compiler failed, or its output cannot be loaded here.
        StaleError: a generated file is missing or declares too little.
        UsageError: the cache cannot be written.
    """
    sources = _sources(folder)

    def extras() -> Mapping[str, bytes]:
        kernels, loops = (sources[name].decode() for name in ("kernels.h", RUNTIME_HEADER))
        try:
            text = declarations(kernels, loops, [function.name for function in manifest.functions])
        except ValueError as error:
            raise _stale(str(error), folder) from None
        return {MODULE: to_module(text).encode()}

    built = build_for(
        levels or known_levels()[-1:], lambda flags: build(sources, compiler, cache, extras, flags)
    )
    return CompiledEvaluator(manifest, *load_library(built))


def build_for(levels: Sequence[Level], build_with: Callable[[Sequence[str]], Path]) -> Path:
    """The build for the first level that the compiler knows; the last level must be."""
    for level in levels[:-1]:
        with suppress(BuildError):
            return build_with((*FLAGS, *level.flags))
    return build_with((*FLAGS, *levels[-1].flags))


def _sources(folder: Path) -> dict[str, bytes]:
    """The generated files and the package's own loops."""
    own = sorted((Path(__file__).parents[1] / "loops" / "c").glob("*.[ch]"))
    try:
        return {path.name: path.read_bytes() for path in (*(folder / name for name in GENERATED), *own)}
    except OSError as error:
        raise _stale(f"{error.filename} cannot be read", folder) from None


def _stale(what: str, folder: Path) -> StaleError:
    return StaleError(what, where=str(folder), remedy="run pmjoint regenerate")


def _check(name: str, failed: int) -> None:
    if failed:
        raise SimulationError(f"kernel {name} reported failure {failed}")
