"""The closed loop with a controller that is asked sample by sample, and the plant here.

The plant takes the guarded steps of `pmjoint_codegen.loops`, with sensor, actuator and delays where the model
has them. The controller is any program: its command acts until the next sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import ACTING, CLOCK, COMMAND, MEASURED, NEXT, U, actuator_of, make_chain
from pmjoint_codegen.loops.chained import ChainedLoop
from pmjoint_codegen.loops.problem import Memory, Problem, Progress, make_memory, own_parameters
from pmjoint_codegen.loops.status import Status, sentence
from pmjoint_codegen.simulate.run import make_problem
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.simulate.start import initial_state

Answering = Callable[[Sequence[float]], tuple[float, float, float]]  # reading, y_r -> v, command, u
_BUDGET: Final = 1 << 40  # samples; the horizon ends a run


class AnsweredLoop(ChainedLoop):
    """A sampled run whose controller is a program.

    Attributes:
        ask: gives v, command and u for a reading and the reference with its derivatives.
        readings: what it was asked, a row a sample.
    """

    def __init__(
        self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory, ask: Answering
    ) -> None:
        super().__init__(evaluator, problem, progress, memory)
        self.ask = ask
        self.readings: list[list[float]] = []

    def take_sample(self, k: int) -> tuple[float, Array]:
        """Measure, ask, command: v; the controller's state is the program's own."""
        chain, held = self.chain, self.memory.held
        if k == 0:
            held[COMMAND], held[NEXT] = chain.rest, 0.0
            held[ACTING:] = chain.channels(self.limits, chain.rest)
        held[CLOCK] = k * chain.period
        y_r = self.follow(float(held[CLOCK]))
        held[MEASURED] = chain.read(float(self.memory.sample[0]), k)
        given = [float(held[MEASURED]), *y_r.tolist()]
        self.readings.append(given)
        v, held[COMMAND], held[U] = self.ask(given)
        sent = chain.channels(self.limits, float(held[COMMAND]))
        self.memory.history[k % self.problem.n_history] = sent
        return v, self.memory.sample[self.problem.n_plant :].copy()


def answered_run(evaluator: Evaluator, settings: Settings, ask: Answering) -> tuple[Array, Array]:
    """Close the loop around a controller.

    Args:
        evaluator: of the plant's kernels.
        settings: of a sampled run with a row for each sample.
        ask: the controller; see `AnsweredLoop`.

    Returns:
        What it was asked, shape (samples, 2 + rho): readings, references; and the plant's states at the
        samples, shape (samples, nx).

    Raises:
        SimulationError: the run ended early.
    """
    chain = make_chain(evaluator.manifest, settings.parameters, settings.sample_time)
    problem = make_problem(evaluator, settings, actuator_of(evaluator, settings.p))
    # As if every model had sensor, actuator and clock, so that one loop serves all.
    problem = own_parameters(replace(problem, chain=chain.vector(), n_history=chain.history))
    memory, progress = make_memory(problem, initial_state(evaluator, settings)), Progress()
    loop = AnsweredLoop(evaluator, problem, progress, memory, ask)
    loop.advance(_BUDGET)
    if progress.status != Status.DONE:
        told = sentence(
            Status(progress.status),
            t=progress.t,
            divergence=settings.divergence,
            max_steps=settings.max_steps,
            max_switches=settings.max_switches,
            state=evaluator.manifest.states[0].name,
            kink="",
        )
        raise SimulationError(told, where=f"{evaluator.manifest.name} around a controller")
    asked = np.array(loop.readings)
    return asked, memory.rows[: len(asked), : problem.n_plant].copy()
