"""The sampled closed loop, what a microcontroller does: the readable twin of ``kernels/c/sampled.c``.

At ``t_k = k T`` the controller takes y, computes v of (29) and delivers w, which is held until the next
sample; filters and compensator go on by their exact zero-order-hold discretisation, the plant is integrated
inside the hold by Taylor steps. Output rows between samples show the plant's states as they are and
everything of the controller as held.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.simulate.continuous import SMALLEST_STEP
from pmjoint_codegen.simulate.polynomial import differentiate, evaluate, note_peaks, note_value, step_size
from pmjoint_codegen.simulate.problem import Memory, Problem, Progress
from pmjoint_codegen.simulate.status import Status

SAME_INSTANT: Final = (
    1e-9  # output instants closer to a sample than this fraction of the sample time are the sample
)


def sampled_loop(
    evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory
) -> Callable[[int], None]:
    """Prepare a run of the sampled loop.

    Returns:
        A function that advances it by at most the given number of samples; `progress` says whether and how it
        ended.
    """
    return _Loop(evaluator, problem, progress, memory).advance


class _Loop:
    """One run; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.plant_taylor = evaluator.kernel("plant_taylor")
        self.reference = evaluator.kernel("reference")
        self.law = evaluator.kernel("law")
        self.update = evaluator.kernel("sampled_update")
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self.x: Array = memory.sample[: problem.n_plant].copy()  # plant states at t
        self.w: Array = np.zeros(problem.n_actuated)
        self.slack = SAME_INSTANT * problem.sample_time
        # Python numbers: the loop looks at them one by one.
        self.times: list[float] = problem.times.tolist()
        self.nodes: list[tuple[float, float]] = list(
            zip(problem.nodes.tolist(), problem.weights.tolist(), strict=True)
        )
        self.thresholds: list[float] = problem.thresholds.tolist()
        self.limits: list[list[float]] = problem.limits.tolist()

    def advance(self, budget: int) -> None:
        with np.errstate(all="ignore"):  # what overflows is found by the checks below, as in C
            for _ in range(budget):
                if self.progress.status != Status.RUNNING:
                    break
                self.sample()

    def sample(self) -> None:
        """One sample: y taken, v computed, w held until the next; the plant goes on in between."""
        progress, problem = self.progress, self.problem
        t = progress.sample * problem.sample_time
        end = (progress.sample + 1) * problem.sample_time
        rows_until = end - self.slack
        v = self.control(t)
        self.note_sample(t, float(v[0]))
        if not math.isfinite(v[0]):
            progress.status = Status.NON_FINITE
            return
        self.actuate(float(v[0]))
        self.note_mode(t, float(v[0]))
        progress.t = t
        while progress.row < problem.n_rows and self.times[progress.row] <= t + self.slack:
            self.next_row(t)
        if progress.row == problem.n_rows:
            progress.status = Status.DONE
            return
        if problem.horizon < rows_until:
            end = problem.horizon  # ends inside this hold
        self.hold(end, rows_until)
        if progress.status == Status.RUNNING and progress.row == problem.n_rows:
            progress.status = Status.DONE
        if progress.status == Status.RUNNING:
            self.settle(v)
            progress.sample += 1

    def control(self, t: float) -> Array:
        """V of (29) from the sampled y and the controller's own states, shape (1,)."""
        sample, problem = self.memory.sample, self.problem
        (y_r,) = self.reference(np.array([t]), problem.p)
        return self.law(sample[:1], sample[problem.n_plant :], y_r, problem.p)[2]

    def actuate(self, v: float) -> None:
        """What the actuator delivers for v: (10) for every channel of w."""
        for j, (offset, slope, lower, upper) in enumerate(self.limits):
            free = offset + slope * v
            self.w[j] = lower if free < lower else upper if free > upper else free

    def note_mode(self, t: float, v: float) -> None:
        """Keep the mode of v at a sample, and its change."""
        progress, memory = self.progress, self.memory
        mode = sum(v > threshold for threshold in self.thresholds)
        if progress.sample == 0:
            progress.first_mode = mode
        elif mode != progress.mode and progress.switches < self.problem.max_switches:
            memory.switch_times[progress.switches] = t
            memory.switch_modes[progress.switches] = mode
            progress.switches += 1
        elif mode != progress.mode:
            progress.status = Status.TOO_MANY_SWITCHES
        progress.mode = mode

    def note_sample(self, t: float, v: float) -> None:
        """Keep the peaks of what changes at samples only."""
        for i, value in enumerate([*self.memory.sample.tolist(), v]):
            note_value(value, t, i, self.memory.peaks, self.memory.peak_times)

    def next_row(self, t_sample: float) -> Array:
        """The next output row, as at the last sample; the caller fills in the plant's states in between."""
        row = self.progress.row
        self.memory.rows[row] = self.memory.sample
        self.memory.held[row] = self.memory.sample
        self.memory.held_times[row] = t_sample
        self.progress.row += 1
        result: Array = self.memory.rows[row]
        return result

    def hold(self, end: float, rows_until: float) -> None:
        """Integrate the plant under constant w up to `end`."""
        progress, problem = self.progress, self.problem
        t_sample = progress.t
        smallest = SMALLEST_STEP * max(end, 1.0)
        while progress.t < end and progress.status == Status.RUNNING:
            remaining = end - progress.t
            (flat,) = self.plant_taylor(np.array([progress.t]), self.x, self.w, problem.p)
            progress.evaluations += 1
            c = flat.reshape(problem.order + 1, problem.n_plant)
            tau = step_size(c, problem.tolerance, problem.safety)
            whole = not tau < remaining
            tau = remaining if whole else tau
            trial = evaluate(c, tau)
            if not np.all(np.isfinite(trial)):
                progress.status = Status.NON_FINITE
            elif not whole and tau < smallest:
                progress.status = Status.STALLED
            elif progress.steps >= problem.max_steps:
                progress.status = Status.TOO_MANY_STEPS
            else:
                self.accept(c, trial, tau, end if whole else progress.t + tau, rows_until, t_sample)

    def accept(
        self, c: Array, trial: Array, tau: float, until: float, rows_until: float, t_sample: float
    ) -> None:
        """Take a step of the plant: output rows, integral of e^2, state."""
        progress = self.progress
        while progress.row < self.problem.n_rows:
            time = self.times[progress.row]
            if not (time <= until and time < rows_until):
                break
            self.next_row(t_sample)[: self.problem.n_plant] = evaluate(c, time - progress.t)
        self.integrate_error(c, tau)
        peaks, times = self.memory.peaks, self.memory.peak_times
        slopes = differentiate(c, tau)
        note_peaks(c, self.problem.n_searched, progress.t, tau, trial, slopes, peaks, times)
        self.x = trial
        progress.t = until
        progress.steps += 1

    def integrate_error(self, c: Array, size: float) -> None:
        """Add the integral of (y - y_r)^2 over a step of the plant."""
        total = 0.0
        y_coefficients: list[float] = c[:, 0].tolist()
        for node, weight in self.nodes:
            tau = size * node
            y = 0.0
            for coefficient in reversed(y_coefficients):
                y = y * tau + coefficient
            e = y - float(self.reference(np.array([self.progress.t + tau]), self.problem.p)[0][0])
            total += weight * (e * e)
        self.progress.integral += size * total

    def settle(self, v: Array) -> None:
        """The states at the next sample, or the status that forbids going on."""
        sample, problem = self.memory.sample, self.problem
        (s_next,) = self.update(sample[:1], sample[problem.n_plant :], self.w[:1], v, problem.hold, problem.p)
        sample[: problem.n_plant] = self.x
        sample[problem.n_plant :] = s_next
        if not np.all(np.isfinite(sample)):
            self.progress.status = Status.NON_FINITE
        elif np.any(np.abs(sample) > problem.divergence):
            self.progress.status = Status.DIVERGED
