"""Which loop runs: the C one where the kernels are compiled, its Python twin where they are interpreted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from pmjoint_codegen.kernels.compiled import CompiledEvaluator
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.simulate.continuous import continuous_loop
from pmjoint_codegen.simulate.problem import Memory, Problem, Progress
from pmjoint_codegen.simulate.sampled import sampled_loop

Advance = Callable[[int], None]


def make_loop(evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> Advance:
    """Prepare a run: a function that advances it by at most the given number of steps or samples.

    Args:
        evaluator: of the kernels.
        problem: constants of the run; a sample time makes it the sampled loop.
        progress: changes with every call.
        memory: as `make_memory` made it.
    """
    if isinstance(evaluator, CompiledEvaluator):
        return compiled_loop(evaluator, problem, progress, memory)
    return (sampled_loop if problem.sample_time else continuous_loop)(evaluator, problem, progress, memory)


def compiled_loop(
    evaluator: CompiledEvaluator, problem: Problem, progress: Progress, memory: Memory
) -> Advance:
    """Prepare a run of the C loops of ``pmjoint_runtime.h``."""
    ffi, lib = evaluator.ffi, evaluator.lib
    c_problem, c_progress, c_memory = (
        _struct(ffi, name, record)
        for name, record in (
            ("pmj_problem *", problem),
            ("pmj_progress *", progress),
            ("pmj_memory *", memory),
        )
    )
    names = (
        ("plant_taylor", "reference", "law", "sampled_update")
        if problem.sample_time
        else ("taylor", "reference")
    )
    bound = [evaluator.function(name) for name in names]
    functions = [function.struct for function in bound]
    run = lib.pmj_sampled if problem.sample_time else lib.pmj_continuous
    alive = (problem, memory, bound)  # the structs point into them

    def advance(budget: int) -> None:
        run(c_problem[0], *functions, c_progress[0], c_memory[0], budget)
        for field in fields(progress):
            setattr(progress, field.name, getattr(c_progress[0], field.name))

    advance.__dict__["alive"] = alive
    return advance


def _struct(ffi: Any, name: str, record: Problem | Progress | Memory) -> tuple[Any, list[Any]]:
    """Copy a record into the C struct with the same field names; arrays become pointers into their memory."""
    struct = ffi.new(name)
    buffers = []
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            kind = "long long[]" if value.dtype == np.int64 else "double[]"
            buffers.append(ffi.from_buffer(kind, value))
            value = buffers[-1]
        setattr(struct, field.name, value)
    return struct, buffers
