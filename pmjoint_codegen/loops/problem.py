"""The data of the loops: a run's constants, its progress, and the memory that it writes.

The three records mirror the structs of ``pmjoint_runtime.h``, field by field, so that the C loops and their
Python twins share them. Arrays are C-contiguous float64.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.constants import PADDING


@dataclass(frozen=True)
class Problem:
    """The constants of a run.

    Attributes:
        n_plant: plant states x, first in X.
        n_states: plant states, then controller states: length of X.
        n_channels: of the Taylor kernel: X, v, e (sampled: x, e), then the arguments of kinks.
        n_rates: channels that have rates: nX (sampled: nx).
        n_kinks: arguments of kinks.
        n_actuated: channels of w; the first is u.
        order: N, the highest Taylor coefficient.
        n_thresholds: length of `thresholds`.
        thresholds: values of v at which a channel of w enters or leaves a limit, ascending.
        modes: shape (n_thresholds + 1, 2 nw), offset and slope of every channel of w inside a mode.
        p: parameters.
        breaks: instants at which the reference's next segment begins, s, inside the run.
        segments: shape (n_breaks + 1, n_segment), what ends p on each.
        n_breaks: length of `breaks`.
        n_segment: entries at the end of p that a segment sets; 0 if the reference is an expression. A run
            writes them: see `own_parameters`.
        hold: matrices of `sampled_update`; empty for the continuous loop.
        chain: `Chain.vector` for the sampled loop with sensor, actuator and clock; empty for the others.
        limits: shape (4 nw,), offset, slope, lower and upper limit of every channel of w.
        n_history: commands that are kept, since they act later; 0 without a chain.
        nodes: quadrature nodes on (0, 1); a hold that is one step has its own three.
        weights: of the nodes; they add up to 1.
        n_nodes: number of them; 0 leaves out the integral of e^2 and when e settles.
        n_searched: for the continuous loop, channels of X, v and e whose largest magnitudes are also searched
            for inside steps; the others' are those at the ends of steps.
        notes_rate: whether the largest magnitude of the rate of y, channel 0, is recorded; 0 or 1.
        inside: points of a step, as fractions of it, at which it is compared with the rates, besides its end.
        n_inside: number of them.
        lebesgue: factor on the largest defect found there.
        ratios: radii of discs, as multiples of a step.
        factors: bound on a step's error, as multiples of the nonlinear part on the disc.
        n_ratios: number of discs.
        max_step: s; infinite by default.
        settled: fraction of |e(0)|: e has settled once it stays within it.
        times: output instants, s: the first 0, the last the horizon.
        n_rows: length of `times`.
        sample_time: s; 0 for the continuous loop.
        hold_ratios: radii of discs, as multiples of a hold; the first also for windows over many holds.
        hold_rate_factors: bound on the error of a hold of the order of ``sample``, without points of
            comparison, as a multiple of the nonlinear part on the disc: of rates;
            hold_value_factors: of values.
        n_hold_ratios: number of discs.
        tolerance: local error, relative to max(1, |value|).
        safety: factor on the step that the last two coefficients allow.
        hold_fraction: of the radius of convergence; up to it a hold is one step of the lower order N of
            ``sample``. Its N-th power is the tolerance.
        divergence: of a sampled run: |X_i| above it ends the run, at the instant of passing for the channels
            searched.
        reach: of a continuous one: the same state by state, shape (nX,); infinite where one may go anywhere.
        max_steps: limit.
        max_switches: limit.
    """

    n_plant: int
    n_states: int
    n_channels: int
    n_rates: int
    n_kinks: int
    n_actuated: int
    order: int
    n_thresholds: int
    thresholds: Array
    modes: Array
    p: Array
    breaks: Array
    segments: Array
    n_breaks: int
    n_segment: int
    hold: Array
    chain: Array
    limits: Array
    n_history: int
    nodes: Array
    weights: Array
    n_nodes: int
    n_searched: int
    notes_rate: int
    inside: Array
    n_inside: int
    lebesgue: float
    ratios: Array
    factors: Array
    n_ratios: int
    max_step: float
    settled: float
    times: Array
    n_rows: int
    sample_time: float
    hold_ratios: Array
    hold_rate_factors: Array
    hold_value_factors: Array
    n_hold_ratios: int
    tolerance: float
    safety: float
    hold_fraction: float
    divergence: float
    reach: Array
    max_steps: int
    max_switches: int

    @property
    def horizon(self) -> float:
        """Last output instant, s."""
        return float(self.times[-1])


@dataclass
class Progress:
    """The progress of a run: the only record that changes, besides the memory.

    Attributes:
        t: time reached, s.
        integral: of e^2 from 0 to t, in y's unit squared times s.
        band: |e| within which it has settled.
        settled: the last instant so far at which |e| exceeds the band, s.
        last_cut: the last step, if the guard cut it, else infinite, s.
        status: a `Status`.
        mode: index of the interval of v between thresholds.
        first_mode: mode at t = 0.
        touching: threshold that v is on at t, n_thresholds + j on kink j, n_kinks more if it has let go, or
            -1.
        idle: switches since time last advanced.
        flips: changes of side at kinks since time last advanced.
        row: output rows written.
        steps: accepted steps of the state.
        rejected: steps repeated at half the size.
        evaluations: calls of the Taylor kernel.
        switches: changes of mode.
        sample: index of the next sample.
        buffer: which half of the coefficient memory is current.
        disc: the disc that proved the last step sound.
        held: the kink that holds the run, or -1.
        holds: how often a kink has begun to hold it, or has let go.
        segment: index of the reference's present segment.
    """

    t: float = 0.0
    integral: float = 0.0
    band: float = 0.0
    settled: float = 0.0
    last_cut: float = math.inf
    status: int = 0
    mode: int = 0
    first_mode: int = 0
    touching: int = -1
    idle: int = 0
    flips: int = 0
    row: int = 1
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    switches: int = 0
    sample: int = 0
    buffer: int = 0
    disc: int = 0
    held: int = -1
    holds: int = 0
    segment: int = 0


@dataclass(frozen=True)
class Memory:
    """Arrays that a run writes.

    Attributes:
        coefficients: Taylor coefficients of two steps.
        state: X at t.
        trial: values of the channels at the end of a trial step.
        slope: their slopes there.
        term_sums: sums of the magnitudes of their terms there.
        scales: of the channels at the start of a step, for relative errors.
        majorants: how far the channels can go on a disc.
        rest: nonlinear parts on it, and defects.
        rates: values inside a step.
        g: the mode, then sides, continuous loop.
        w: the actuator's output, then sides.
        window: shape (2 + 2 nx,), for which the guard is known: t and its radius, x and its radii;
        sampled loop.
        segment: shape (n_segment,), the end of the problem's p.
        sides: on which side of each kink the run is, +1 or -1; then 1 for the one that holds it.
        holds: results of the kernel that says whether a kink holds.
        hold_times: when one begins to hold the run, lets go, and so on, s; empty without kinks.
        hold_kinks: which; of the same shape.
        sample: X at the last sample, sampled loop.
        rows: shape (n_rows, nX), X at the output instants; the first row is filled in at the start.
        row_samples: shape (n_rows, nX), X at the last sample before each output instant, sampled loop.
        row_sample_times: shape (n_rows,), the instants of `row_samples`, s.
        held: shape (6 + nw,), what is held since the last sample, with a chain; see `loops.chain`.
        row_held: shape (n_rows, 6 + nw), the same at the output instants.
        history: shape (n_history, nw), w of the last commands.
        peaks: shape (nX + 3,), largest |X_i|, |v|, |e| and, if requested, |dy/dt| so far.
        peak_times: of the same shape, their instants, s.
        switch_times: s.
        switch_modes: mode after each switch.
    """

    coefficients: Array
    state: Array
    trial: Array
    slope: Array
    term_sums: Array
    scales: Array
    majorants: Array
    rest: Array
    rates: Array
    g: Array
    w: Array
    window: Array
    segment: Array
    sides: Array
    holds: Array
    hold_times: Array
    hold_kinks: npt.NDArray[np.int64]
    sample: Array
    rows: Array
    row_samples: Array
    row_sample_times: Array
    held: Array
    row_held: Array
    history: Array
    peaks: Array
    peak_times: Array
    switch_times: Array
    switch_modes: npt.NDArray[np.int64]


def own_parameters(problem: Problem) -> Problem:
    """The problem with a p that one run may write; the same problem if none does."""
    return replace(problem, p=problem.p.copy()) if problem.n_segment else problem


def make_memory(problem: Problem, x0: Array) -> Memory:
    """Allocate the memory of a run and fill in its start.

    Args:
        problem: of the run.
        x0: X(0), shape (nX,).
    """
    n, rows = problem.n_states, problem.n_rows
    sampled_rows, padded = rows if problem.sample_time else 0, problem.n_channels + PADDING
    memory = Memory(
        coefficients=np.zeros(2 * ((problem.order + 1) * problem.n_channels + PADDING)),
        state=x0.copy(),
        trial=np.zeros(padded),
        slope=np.zeros(padded),
        term_sums=np.zeros(padded),
        scales=np.zeros(padded),
        majorants=np.zeros(padded),
        rest=np.zeros(padded),
        rates=np.zeros(padded),
        g=np.zeros(2 * (problem.n_actuated + problem.n_kinks)),
        w=np.zeros(problem.n_actuated + 2 * problem.n_kinks),
        window=np.full(2 + 2 * problem.n_plant, -1.0),
        segment=problem.p[len(problem.p) - problem.n_segment :],
        sides=np.repeat([1.0, 0.0], problem.n_kinks),
        holds=np.zeros(problem.n_kinks * (2 + problem.n_plant)),
        hold_times=np.empty(problem.max_switches if problem.n_kinks else 0),
        hold_kinks=np.empty(problem.max_switches if problem.n_kinks else 0, dtype=np.int64),
        sample=x0.copy(),
        rows=np.empty((rows, n)),
        row_samples=np.empty((sampled_rows, n)),
        row_sample_times=np.zeros(sampled_rows),
        held=np.zeros(6 + problem.n_actuated if problem.n_history else 0),
        row_held=np.zeros((rows if problem.n_history else 0, 6 + problem.n_actuated)),
        history=np.zeros((problem.n_history, problem.n_actuated)),
        peaks=np.zeros(n + 3),
        peak_times=np.zeros(n + 3),
        switch_times=np.empty(problem.max_switches),
        switch_modes=np.empty(problem.max_switches, dtype=np.int64),
    )
    memory.rows[0] = x0
    memory.row_samples[:1] = x0
    return memory
