"""Which loop runs: the C one if the kernels are compiled, its Python twin if they are interpreted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from struct import Struct
from typing import Any, Final

import numpy as np

from pmjoint_codegen.kernels.compiled import CompiledEvaluator
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chained import ChainedLoop
from pmjoint_codegen.loops.continuous import continuous_loop
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.sampled import sampled_loop

Advance = Callable[[int], None]
_START: Final = {field.name: field.default for field in fields(Progress)}
_LAYOUT: Final = Struct("5d17q")  # of `pmj_progress`: five doubles, then integers


def make_loop(evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> Advance:
    """Prepare a run: a function that advances it by at most the given number of steps or samples.

    Args:
        evaluator: of the kernels.
        problem: constants of the run; a sample time makes it the sampled loop.
        progress: changes with every call.
        memory: as `make_memory` made it.
    """
    if isinstance(evaluator, CompiledEvaluator):
        return CompiledLoop(evaluator, problem, progress, memory)
    if problem.n_history:
        return ChainedLoop(evaluator, problem, progress, memory).advance
    return (sampled_loop if problem.sample_time else continuous_loop)(evaluator, problem, progress, memory)


class CompiledLoop:
    """A run of the C loops of ``pmjoint_runtime.h``; calling it advances the run, see `Advance`."""

    def __init__(
        self, evaluator: CompiledEvaluator, problem: Problem, progress: Progress, memory: Memory
    ) -> None:
        ffi, lib = evaluator.ffi, evaluator.lib
        self._problem, self._progress, self._memory = (
            _struct(ffi, name, record)
            for name, record in (
                ("pmj_problem *", problem),
                ("pmj_progress *", progress),
                ("pmj_memory *", memory),
            )
        )
        # The sampled loop includes ``sample``.
        sampled = bool(problem.sample_time)
        names = ("plant_taylor", "plant_guard", "plant") if sampled else ("taylor", "guard", "closed_loop")
        self._library = lib  # its code runs, so it must stay loaded
        held = (*(f"{name}_held" for name in names), "holds") if evaluator.manifest.can_hold else ()
        self._bound = [evaluator.function(name) for name in (*names, *held)]  # the structs point into them
        self._kernels = ffi.new("pmj_kernels *", [function.struct for function in self._bound])
        if problem.n_history:  # whose law and update are kernels of their own
            own = [evaluator.function(name) for name in ("reference", "law", "sampled_update")]
            self._bound += own
            parts = [self._kernels[0], *(function.struct for function in own)]
            self._kernels = ffi.new("pmj_functions *", parts)
        self._run = (
            lib.pmj_chained
            if problem.n_history
            else lib.pmj_sampled
            if problem.sample_time
            else lib.pmj_continuous
        )
        self._records = (problem, progress, memory)  # and into these
        self._arguments = (self._problem[0], self._kernels, self._progress[0], self._memory[0])
        self._begin = lib.pmj_begin
        self._bytes = ffi.buffer(self._progress[0])

    def __call__(self, budget: int) -> None:
        """Advance by at most `budget` steps or samples."""
        self._run(*self._arguments, budget)
        self._read()

    def restart(self, x0: Array) -> None:
        """Begin again at X(0) = x0, shape (nX,), in the memory of the run before: its results are lost.

        Where the run stands, the next call says.
        """
        self._records[2].state[:] = x0
        self._begin(self._arguments[0], *self._arguments[-2:])

    def _read(self) -> None:
        """Copy the run's progress from the C struct."""
        self._records[1].__dict__.update(zip(_START, _LAYOUT.unpack(self._bytes), strict=True))


def _struct(ffi: Any, name: str, record: Problem | Progress | Memory) -> tuple[Any, list[Any]]:
    """Copy a record into the C struct with the same field names; arrays become pointers into their memory."""
    doubles, integers = ffi.typeof("double[]"), ffi.typeof("long long[]")
    values = dict(vars(record))
    buffers = []
    for field, value in values.items():
        if isinstance(value, np.ndarray):
            kind = integers if value.dtype == np.int64 else doubles
            values[field] = ffi.from_buffer(kind, value)
            buffers.append(values[field])
    return ffi.new(name, values), buffers
