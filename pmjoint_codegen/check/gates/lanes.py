"""The functions over lanes, as compiled for sweeps, against their tapes, bit for bit.

``lanes.c`` is printed by this project from CasADi's instruction lists. Here the same lists are evaluated by
other means (:mod:`lane_tape`), at points drawn as for the gate `interpreter`. Neighbours in a vector are
different points, so any effect of one lane on another shows as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.check.bits import Answers, judge
from pmjoint_codegen.check.gates.interpreter import POINTS, SEED
from pmjoint_codegen.check.inputs.points import Batch, batches
from pmjoint_codegen.check.oracles.lane_tape import Operation, walk
from pmjoint_codegen.check.result import GateResult, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.library import LIBRARY, build
from pmjoint_codegen.emit.functions import build_functions, lane_functions
from pmjoint_codegen.emit.tape import tapes_of
from pmjoint_codegen.emit.vocabulary import neutral_entry
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.loops.batch import Target, batch_sources, compile_batch, level_flags
from pmjoint_codegen.manifest import Function
from pmjoint_codegen.operations import Operation as Row
from pmjoint_codegen.operations import by_name
from pmjoint_codegen.workspace import cache_dir

PROBE: Final = "lane_probe.c"  # the elementary functions over lanes, one by one
HEADER: Final = "pmjoint_lanes.h"
ALIGNMENT: Final = 64  # bytes, of the widest vector

Points = Callable[[Function], Iterable[Batch]]


@dataclass(frozen=True)
class LaneLibrary:
    """A compiled library of functions that take and give pointers to vectors.

    Attributes:
        ffi: cffi's parser, for declarations.
        library: cffi's handle.
        width: doubles in a vector.
    """

    ffi: Any
    library: Any
    width: int

    @classmethod
    def open(cls, file: Path, width: int, arities: Mapping[str, int]) -> LaneLibrary:
        """Load a library.

        Args:
            file: the library.
            width: doubles in a vector, as it was compiled.
            arities: name -> number of pointers of every function that will be called.
        """
        import cffi

        ffi = cffi.FFI()
        for name, count in arities.items():
            ffi.cdef(f"void pmj_{name}({', '.join(['void *'] * count)});")
        return cls(ffi, ffi.dlopen(str(file)), width)

    def call(self, name: str, arguments: Sequence[Array], sizes: Sequence[int]) -> tuple[Array, ...]:
        """Evaluate a function on rows, a vector's width of them at a time.

        Args:
            name: of the function.
            arguments: one per input, shape (points, size).
            sizes: of the results.

        Returns:
            One array per result, shape (points, size).
        """
        function, points = getattr(self.library, f"pmj_{name}"), len(arguments[0])
        given = [self._vectors(max(array.shape[1], 1)) for array in arguments]
        taken = [self._vectors(max(size, 1)) for size in sizes]
        pointers = [self.ffi.cast("void *", array.ctypes.data) for array in (*given, *taken)]
        results = tuple(np.zeros((points, size)) for size in sizes)
        for first in range(0, points, self.width):
            rows = np.arange(first, first + self.width) % points  # the last vector repeats rows
            for block, array in zip(given, arguments, strict=True):
                block[: array.shape[1]] = array[rows].T
            function(*pointers)
            some = min(self.width, points - first)
            for block, result in zip(taken, results, strict=True):
                result[first : first + some] = block[: result.shape[1], :some].T
        return results

    def _vectors(self, count: int) -> Array:
        """Memory for some vectors, aligned as the compiler expects."""
        room = np.zeros(count * self.width * 8 + ALIGNMENT, dtype=np.uint8)
        offset = -room.ctypes.data % ALIGNMENT
        whole = room[offset : offset + count * self.width * 8].view(np.float64)
        return whole.reshape(count, self.width)


def check(subject: Subject) -> GateResult:
    """Compare every function over lanes on random and on hard points."""
    if subject.compiler is None:
        return not_run("no C compiler")
    cache = cache_dir(subject.environment, subject.notify)
    levels = usable_levels(subject.environment)
    target = compile_batch(batch_sources(subject.folder), levels, subject.compiler, cache)
    functions = build_functions(subject.derivation, subject.manifest.order)
    tapes = tapes_of(lane_functions(functions, neutral_entry(subject.derivation)).values())
    points = partial(_points_of, subject=subject)
    return compare(tapes, target, elementary_of(target, subject.compiler, cache), points)


def _points_of(function: Function, subject: Subject) -> list[Batch]:
    return batches(subject.interpreted, function, POINTS, SEED, extreme=True, features=subject.features)


def elementary_of(target: Target, compiler: Compiler, cache: Path) -> Mapping[str, Operation]:
    """The lanes' elementary functions by the tape's names, on shape (points,), compiled as `target` is.

    Raises:
        BuildError: the compiler failed.
    """
    elementary = [item for item in by_name().values() if not item.exact]
    header = Path(__file__).parents[2] / "loops" / "c_batch" / HEADER
    probe = "\n".join([f'#include "{HEADER}"', *map(_probe, elementary)])
    sources = {PROBE: probe.encode(), HEADER: header.read_bytes()}
    folder = build(sources, compiler, cache, flags=level_flags(target.level))
    arities = {f"probe_{item.name}": item.arity + 1 for item in elementary}
    library = LaneLibrary.open(folder / LIBRARY, target.level.width, arities)

    def operation(name: str) -> Operation:
        def evaluate(*operands: Array) -> Array:
            return library.call(f"probe_{name}", [array[:, np.newaxis] for array in operands], [1])[0][:, 0]

        return evaluate

    return {item.name: operation(item.name) for item in elementary}


def _probe(item: Row) -> str:
    """A function of C that applies one operation over lanes."""
    operands = ("a", "b")[: item.arity]
    arguments = ", ".join([*(f"const pmj_lanes *{name}" for name in operands), "pmj_lanes *result"])
    value = item.lanes.format(*(f"*{name}" for name in operands))
    return f"void pmj_probe_{item.name}({arguments})\n{{\n    *result = {value};\n}}"


def compare(
    tapes: Sequence[Tape], target: Target, elementary: Mapping[str, Operation], points: Points
) -> GateResult:
    """Compare compiled functions over lanes with their tapes.

    Args:
        tapes: of the functions.
        target: where they are compiled.
        elementary: as `elementary_of` gives them.
        points: gives the points of a function.
    """
    arities = {tape.name: len(tape.inputs) + len(tape.outputs) for tape in tapes}
    library = LaneLibrary.open(target.folder / LIBRARY, target.level.width, arities)
    functions = {tape.name: Function(tape.name, tape.inputs, tape.outputs, "", "", 0) for tape in tapes}
    answers = (
        Answers(
            functions[tape.name],
            batch,
            walk(tape, batch.arguments, elementary),
            library.call(tape.name, batch.arguments, [size for _, size in tape.outputs]),
        )
        for tape in tapes
        for batch in points(functions[tape.name])
    )
    return judge(answers, f"{len(tapes)} functions over lanes")
