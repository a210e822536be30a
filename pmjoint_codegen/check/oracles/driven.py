"""The sampled loop of `simulate` with an exported controller in the place of the law.

The plant and its steps are those of the readable loop, with compiled kernels. Only v and u come from the
exported C, which sees nothing but y and the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import actuator_of
from pmjoint_codegen.loops.problem import Memory, Problem, Progress, make_memory, own_parameters
from pmjoint_codegen.loops.sampled import SampledLoop
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import make_problem
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.simulate.start import initial_state

BUDGET: Final = 1000  # samples from one look at the progress to the next


@dataclass(frozen=True)
class DrivenRun:
    """A run with the exported controller, one row a sample.

    Attributes:
        x: states of the plant, shape (rows, nx).
        s: states of the controller, shape (rows, ns).
        v, u: shape (rows,).
        steps: of the plant's integration.
    """

    x: Array
    s: Array
    v: Array
    u: Array
    steps: int


@dataclass(frozen=True)
class _Journal:
    """The exported controller, and what it gave at each sample."""

    loaded: Exported
    rows: list[Array]

    def step(self, y: float, y_r: Array) -> tuple[float, Array]:
        """One sample: v, and the state that it belongs to."""
        out = self.loaded.output
        self.loaded.step(y, y_r)
        s = self.loaded.states
        self.rows.append(np.concatenate([s, [out.v, out.u]]))
        return float(out.v), s


class _Loop(SampledLoop):
    """A loop without sensor, actuator and clock of its own, whose samples the exported controller takes."""

    def __init__(
        self, journal: _Journal, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory
    ) -> None:
        super().__init__(evaluator, problem, progress, memory)
        self._journal = journal
        self._reference = evaluator.kernel("reference")
        self._taylor = evaluator.kernel("plant_taylor")
        self._rows = evaluator.manifest.hold_order + 1
        self.kernel = self._sampled

    def _sampled(self, t: Array, X: Array, _hold: Array, p: Array) -> tuple[Array, ...]:
        """What the kernel ``sample`` gives; in place of the next state the present one, which nobody uses."""
        x = X[: self.problem.n_plant]
        v, s = self._journal.step(float(x[0]), self._reference(t, p)[0])
        offset, slope, lower, upper = self.problem.limits.reshape(-1, 4).T
        w = np.fmin(np.fmax(offset + slope * v, lower), upper)
        w[0] = self._journal.loaded.output.u
        sides = np.ones(self.problem.n_kinks)
        for j in range(self.problem.n_kinks):
            sides[j] = np.sign(self.rates(t, x, np.concatenate([w, sides]), p)[2][j])
        c = self._taylor(t, x, np.concatenate([w, sides]), p)[0]
        return np.array([v]), w, c[: self._rows * self.problem.n_channels], s


def drive(loaded: Exported, evaluator: Evaluator, settings: Settings) -> DrivenRun | str:
    """Run the closed loop with an initialised controller; or say why it ended early.

    Args:
        loaded: the controller, after `init`.
        evaluator: of the kernels of the plant.
        settings: of the run, sampled.
    """
    problem = own_parameters(make_problem(evaluator, settings, actuator_of(evaluator, settings.p)))
    memory, progress = make_memory(problem, initial_state(evaluator, settings)), Progress()
    journal = _Journal(loaded, [])
    loop = _Loop(journal, evaluator, problem, progress, memory)
    while progress.status == Status.RUNNING:
        loop.advance(BUDGET)
    if progress.status != Status.DONE:
        why = Status(progress.status).name
        return f"the run with the exported controller ended at {progress.t:.6g} s: {why}"
    found, nx = np.array(journal.rows), problem.n_plant
    return DrivenRun(
        memory.rows[:, :nx], found[:, :-2], found[:, -2].copy(), found[:, -1].copy(), progress.steps
    )
