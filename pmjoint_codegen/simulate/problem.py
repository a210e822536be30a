"""What the loops work on: the run's constants, where it stands, and the memory that it writes.

The three records mirror the structs of ``pmjoint_runtime.h``, field by field, so that the C loops and their
Python twins take the same. Arrays are C-contiguous float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.evaluator import Array

PADDING: Final = 3  # numbers behind a row of channels, so that blocks of four may read and write past it


@dataclass(frozen=True)
class Problem:
    """What does not change during a run.

    Attributes:
        n_plant: plant states x, first in X.
        n_states: plant states, then controller states: length of X.
        n_actuated: channels of w; the first is u.
        n_reference: rho + 1.
        order: N, the highest Taylor coefficient.
        n_thresholds: length of `thresholds`.
        thresholds: values of v at which a channel of w enters or leaves a limit, ascending.
        modes: shape (n_thresholds + 1, 2 nw), offset and slope of every channel of w inside a mode.
        p: parameters.
        hold: matrices of `sampled_update`; empty for the continuous loop.
        nodes: quadrature nodes on (0, 1); a hold that is one step has its own three.
        weights: of the nodes; they add up to 1.
        n_nodes: number of them; 0 leaves the integral of e^2 out.
        n_searched: for the continuous loop, channels, of X and v, whose largest magnitudes are searched for
            inside steps too; the others' are those at the ends of steps.
        times: output instants, s: the first 0, the last the horizon.
        n_rows: length of `times`.
        sample_time: s; 0 for the continuous loop.
        tolerance: local error, relative to max(1, |value|).
        safety: factor on the step that the last two coefficients allow.
        hold_reach: part of the radius of convergence up to which a hold is one step of the lower order N of
            ``sample``: its N-th power is the tolerance.
        divergence: |X_i| above it ends the run.
        max_steps: limit.
        max_switches: limit.
    """

    n_plant: int
    n_states: int
    n_actuated: int
    n_reference: int
    order: int
    n_thresholds: int
    thresholds: Array
    modes: Array
    p: Array
    hold: Array
    nodes: Array
    weights: Array
    n_nodes: int
    n_searched: int
    times: Array
    n_rows: int
    sample_time: float
    tolerance: float
    safety: float
    hold_reach: float
    divergence: float
    max_steps: int
    max_switches: int

    @property
    def horizon(self) -> float:
        """Last output instant, s."""
        return float(self.times[-1])


@dataclass
class Progress:
    """Where a run stands: the only record that changes, besides the memory.

    Attributes:
        t: time reached, s.
        integral: of e^2 from 0 to t, in y's unit squared times s.
        status: a `Status`.
        mode: index of the interval of v between thresholds.
        first_mode: mode at t = 0.
        touching: threshold on which v stands at t, or -1.
        idle: switches since time last moved.
        row: output rows written.
        steps: accepted steps of the state.
        rejected: steps tried again at half the size.
        evaluations: calls of the Taylor kernel.
        switches: changes of mode.
        sample: index of the next sample.
        buffer: which half of the coefficient memory is current.
    """

    t: float = 0.0
    integral: float = 0.0
    status: int = 0
    mode: int = 0
    first_mode: int = 0
    touching: int = -1
    idle: int = 0
    row: int = 1
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    switches: int = 0
    sample: int = 0
    buffer: int = 0


@dataclass(frozen=True)
class Memory:
    """Arrays that a run writes.

    Attributes:
        coefficients: Taylor coefficients of two steps.
        state: X at t.
        trial: X and v, in the sampled loop x and e, at the end of a step on trial.
        slope: of the continuous loop: rates of X and v at the end of a step.
        reach: sums of the magnitudes of their terms there, continuous loop.
        scales: of X and v at the start of a step, for relative errors, continuous loop.
        reference: y_r and its derivatives, continuous loop.
        w: what the actuator delivers, sampled loop.
        sample: X at the last sample, sampled loop.
        rows: shape (n_rows, nX), X at the output instants; the first row comes filled in.
        held: shape (n_rows, nX), X at the last sample before each output instant, sampled loop.
        held_times: shape (n_rows,), the instants of `held`, s.
        peaks: shape (nX + 1,), largest |X_i| and |v| so far; sampled loop: (nX + 2,), that of |e| last.
        peak_times: of the same shape, their instants, s.
        switch_times: s.
        switch_modes: mode after each switch.
    """

    coefficients: Array
    state: Array
    trial: Array
    slope: Array
    reach: Array
    scales: Array
    reference: Array
    w: Array
    sample: Array
    rows: Array
    held: Array
    held_times: Array
    peaks: Array
    peak_times: Array
    switch_times: Array
    switch_modes: npt.NDArray[np.int64]


def make_memory(problem: Problem, x0: Array) -> Memory:
    """Allocate the memory of a run and fill in its start.

    Args:
        problem: of the run.
        x0: X(0), shape (nX,).
    """
    n, rows = problem.n_states, problem.n_rows
    held_rows, peaks = (rows, n + 2) if problem.sample_time else (0, n + 1)
    memory = Memory(
        coefficients=np.zeros(2 * ((problem.order + 1) * (n + 1) + PADDING)),
        state=x0.copy(),
        trial=np.zeros(n + 1 + PADDING),
        slope=np.zeros(n + 1 + PADDING),
        reach=np.zeros(n + 1 + PADDING),
        scales=np.zeros(n + 1 + PADDING),
        reference=np.zeros(problem.n_reference),
        w=np.zeros(problem.n_actuated),
        sample=x0.copy(),
        rows=np.empty((rows, n)),
        held=np.empty((held_rows, n)),
        held_times=np.zeros(held_rows),
        peaks=np.zeros(peaks),
        peak_times=np.zeros(peaks),
        switch_times=np.empty(problem.max_switches),
        switch_modes=np.empty(problem.max_switches, dtype=np.int64),
    )
    memory.rows[0] = x0
    memory.held[:1] = x0
    return memory
