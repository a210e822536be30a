"""The sampled closed loop, what a microcontroller does: the readable twin of ``kernels/c/sampled.c``.

At ``t_k = k T`` the controller takes y, computes v of (29) and delivers w, which is held until the next
sample; filters and compensator go on by their exact zero-order-hold discretisation, the plant and the error
follow their Taylor polynomials: those that come with the sample where the hold is short enough for them, else
several steps of a higher order. Output rows between samples show the plant's states as they are and
everything of the controller as held.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.simulate.continuous import SMALLEST_STEP
from pmjoint_codegen.simulate.polynomial import evaluate, note_peaks, note_value, step_size
from pmjoint_codegen.simulate.problem import Memory, Problem, Progress
from pmjoint_codegen.simulate.quadrature import short_steps
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
        self.kernel = evaluator.kernel("sample")
        self.plant_taylor = evaluator.kernel("plant_taylor")
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self.x: Array = memory.sample[: problem.n_plant].copy()  # plant states at t
        self.slack = SAME_INSTANT * problem.sample_time
        # Python numbers: the loop looks at them one by one.
        self.times: list[float] = problem.times.tolist()
        self.nodes: list[tuple[float, float]] = list(
            zip(problem.nodes.tolist(), problem.weights.tolist(), strict=True)
        )
        self.thresholds: list[float] = problem.thresholds.tolist()

    def advance(self, budget: int) -> None:
        with np.errstate(all="ignore"):  # what overflows is found by the checks below, as in C
            for _ in range(budget):
                if self.progress.status != Status.RUNNING:
                    break
                self.sample()

    def sample(self) -> None:
        """One sample: y taken, v computed, w held until the next; the plant goes on in between."""
        progress, problem, memory = self.progress, self.problem, self.memory
        t = progress.sample * problem.sample_time
        end = (progress.sample + 1) * problem.sample_time
        rows_until = end - self.slack
        v, w, flat, s_next = self.kernel(np.array([t]), memory.sample, problem.hold, problem.p)
        c = self.channels(flat)
        progress.t = t
        progress.evaluations += 1
        if progress.sample == 0:
            self.note_start(c)
        note_value(float(v[0]), t, problem.n_states, memory.peaks, memory.peak_times)
        if not math.isfinite(v[0]):
            progress.status = Status.NON_FINITE
            return
        self.note_mode(t, float(v[0]))
        if progress.sample == 0 and self.beyond():
            progress.status = Status.DIVERGED
        while progress.row < problem.n_rows and self.times[progress.row] <= t + self.slack:
            self.next_row(t)
        if progress.row == problem.n_rows:
            progress.status = Status.DONE
            return
        if progress.status != Status.RUNNING:
            return
        if problem.horizon < rows_until:  # ends inside this hold
            self.hold(c, w, problem.horizon - t, problem.horizon, rows_until)
        else:
            self.hold(c, w, problem.sample_time, end, rows_until)
        if progress.status == Status.RUNNING and progress.row == problem.n_rows:
            progress.status = Status.DONE
        if progress.status == Status.RUNNING:
            self.settle(s_next)
            progress.sample += 1

    def channels(self, flat: Array) -> Array:
        """Coefficients as rows of powers; columns are x, then e."""
        return flat.reshape(-1, self.problem.n_plant + 1)

    def note_start(self, c: Array) -> None:
        """X(0) and e(0)."""
        for i, value in enumerate(self.memory.sample.tolist()):
            note_value(value, 0.0, i, self.memory.peaks, self.memory.peak_times)
        note_value(float(c[0, -1]), 0.0, -1, self.memory.peaks, self.memory.peak_times)

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

    def next_row(self, t_sample: float) -> Array:
        """The next output row, as at the last sample; the caller fills in the plant's states in between."""
        row = self.progress.row
        self.memory.rows[row] = self.memory.sample
        self.memory.held[row] = self.memory.sample
        self.memory.held_times[row] = t_sample
        self.progress.row += 1
        result: Array = self.memory.rows[row]
        return result

    def hold(self, c: Array, w: Array, length: float, end: float, rows_until: float) -> None:
        """Integrate the plant under constant w for the time `length`, to `end`; `c` are the sample's own."""
        if not self.within(c, length):
            self.long_hold(w, end, rows_until)
            return
        trial = self.try_step(c, length)
        if self.progress.status == Status.RUNNING:
            self.progress.integral += integral(c[:, -1].tolist(), length)
            self.accept(c, trial, length, end, rows_until, self.progress.t)

    def within(self, c: Array, length: float) -> bool:
        """Whether a hold is one step: the last term is below the tolerance, the one before in proportion."""
        ratio = length / self.problem.hold_reach
        power = ratio
        for _ in range(2, len(c) - 1):
            power = power * ratio
        before, last = (float(np.divide(1.0, q)) for q in (power, power * ratio))
        scale = np.maximum(np.abs(c[0]), 1.0)
        return bool(np.all(np.abs(c[-2]) <= before * scale) and np.all(np.abs(c[-1]) <= last * scale))

    def long_hold(self, w: Array, end: float, rows_until: float) -> None:
        """Integrate the plant under constant w to `end` in as many steps as the tolerance demands."""
        progress, problem = self.progress, self.problem
        t_sample = progress.t
        smallest = SMALLEST_STEP * max(end, 1.0)
        while progress.t < end:
            left = end - progress.t
            c = self.channels(self.plant_taylor(np.array([progress.t]), self.x, w, problem.p)[0])
            progress.evaluations += 1
            size = step_size(c, problem.tolerance, problem.safety)
            whole = not size < left
            tau = left if whole else size
            trial = self.try_step(c, tau)
            if progress.status == Status.RUNNING and not whole and tau < smallest:
                progress.status = Status.STALLED
            if progress.status != Status.RUNNING:
                return
            progress.integral += self.long_integral(c, tau)
            self.accept(c, trial, tau, end if whole else progress.t + tau, rows_until, t_sample)

    def long_integral(self, c: Array, size: float) -> float:
        """Integral of e^2 over a step of a hold that takes several."""
        total = 0.0
        for node, weight in self.nodes:
            e = float(evaluate(c[:, -1:], size * node)[0])
            total += weight * (e * e)
        return size * total

    def try_step(self, c: Array, tau: float) -> Array:
        """The end of a step on trial, shape (channels,), or the status that forbids it."""
        trial = evaluate(c, tau)
        if not np.all(np.isfinite(trial[:-1])):
            self.progress.status = Status.NON_FINITE
        elif self.progress.steps >= self.problem.max_steps:
            self.progress.status = Status.TOO_MANY_STEPS
        return trial

    def accept(
        self, c: Array, trial: Array, tau: float, until: float, rows_until: float, t_sample: float
    ) -> None:
        """Take a step of the plant: output rows, peaks, state."""
        progress = self.progress
        while progress.row < self.problem.n_rows:
            time = self.times[progress.row]
            if not (time <= until and time < rows_until):
                break
            self.next_row(t_sample)[: self.problem.n_plant] = evaluate(c[:, :-1], time - progress.t)
        for channels in (slice(0, -1), slice(-1, None)):  # x in the first entries of the peaks, e in the last
            note_peaks(
                c[:, channels],
                progress.t,
                tau,
                trial[channels],
                self.memory.peaks[channels],
                self.memory.peak_times[channels],
            )
        self.x = trial[:-1]
        progress.t = until
        progress.steps += 1

    def settle(self, s_next: Array) -> None:
        """The state at the next sample, and its peaks; or the status that forbids going on."""
        sample, problem = self.memory.sample, self.problem
        sample[: problem.n_plant] = self.x
        sample[problem.n_plant :] = s_next
        if not np.all(np.isfinite(sample)):
            self.progress.status = Status.NON_FINITE
            return
        for i, value in enumerate(sample.tolist()):
            note_value(value, self.progress.t, i, self.memory.peaks, self.memory.peak_times)
        if self.beyond():
            self.progress.status = Status.DIVERGED

    def beyond(self) -> bool:
        """Whether any state has passed the limit of divergence."""
        return bool(np.any(np.abs(self.memory.sample) > self.problem.divergence))


def integral(c: list[float], size: float) -> float:
    """Integral of e^2 over a hold that is one step, by three Gauss nodes.

    Args:
        c: Taylor coefficients of e.
        size: of the step, s.
    """
    a, power, total = [c[0]], size, 0.0
    for coefficient in c[1:]:
        a.append(coefficient * power)
        power = power * size
    rule = short_steps()
    for node, weight in zip(rule.nodes, rule.weights, strict=True):
        e = a[-1]
        for coefficient in a[-2::-1]:
            e = e * node + coefficient
        total = total + e * e * weight
    return size * total
