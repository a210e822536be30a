"""Our own loop: the C one, and its Python twin over interpreted kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from benchmarks.paper import Array
from benchmarks.peers.solver import Solver
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.loops.modes import make_actuator
from pmjoint_codegen.loops.problem import Problem, Progress, make_memory
from pmjoint_codegen.loops.select import CompiledLoop, make_loop
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import make_problem
from pmjoint_codegen.simulate.settings import Settings, make_settings
from pmjoint_codegen.simulate.start import initial_state

SETTINGS = (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
ALL_STEPS = 10_000_000


def states_only(kind: str = "compiled") -> Solver:
    """Return the loop as the peers run theirs: states and switches alone, in memory that is kept."""
    loop = ClosedLoop.load("paper", evaluator=kind)
    label = "ours" if kind == "compiled" else "ours, CasADi interpreted"
    return Solver(label, SETTINGS, lambda tolerance, grid: _bare(loop, tolerance, grid))


def whole() -> Solver:
    """Return `ClosedLoop.simulate`: checked settings, and a record from which all else can be read."""
    loop = ClosedLoop.load("paper", evaluator="compiled")

    def make(tolerance: float, grid: Array) -> Callable[[], Array]:
        step = float(grid[1])
        return lambda: loop.simulate(tolerance=tolerance, output_step=step).states

    return Solver("ours, ClosedLoop.simulate", SETTINGS, make)


def _bare(loop: ClosedLoop, tolerance: float, grid: Array) -> Callable[[], Array]:
    settings = make_settings(loop.manifest, tolerance=tolerance, output_step=float(grid[1]))
    problem, x0 = constants(loop, settings), initial_state(loop.evaluator, settings)
    memory, progress = make_memory(problem, x0), Progress()
    advance = make_loop(loop.evaluator, problem, progress, memory)
    if not isinstance(advance, CompiledLoop):
        return lambda: _fresh(loop, problem, x0)

    def run() -> Array:
        advance.restart(x0)
        advance(ALL_STEPS)
        if progress.status != Status.DONE:
            raise RuntimeError("our own run failed")
        return memory.rows

    return run


def _fresh(loop: ClosedLoop, problem: Problem, x0: Array) -> Array:
    memory = make_memory(problem, x0)
    make_loop(loop.evaluator, problem, Progress(), memory)(ALL_STEPS)
    return memory.rows


def constants(loop: ClosedLoop, settings: Settings, *, whole: bool = False) -> Problem:
    """Return a run's constants; without `whole`, no integral of e^2 and no peaks inside steps."""
    actuator = make_actuator(loop.evaluator.call("actuation", settings.p)[0])
    problem = make_problem(loop.evaluator, settings, actuator)
    return problem if whole else replace(problem, n_nodes=0, n_searched=0)
