"""The sampled closed loop, as on a microcontroller: the readable twin of ``loops/c/sampled.c``.

At ``t_k = k T`` the controller measures y, computes v of (29) and applies w, which is constant until the next
sample. Filters and compensator advance by their exact zero-order-hold discretisation. The plant and the error
follow their Taylor polynomials: those computed with the sample if the guard shows the hold to be short
enough, else steps of a higher order, guarded like those of the continuous loop and ending at kinks.
Output rows between samples show the plant's states at that instant and the controller's as of the sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.constants import DEFECT, GROWTH, SAME_INSTANT, SMALLEST_STEP, WINDOW
from pmjoint_codegen.loops.polynomial import (
    evaluate,
    first_beyond,
    note_peaks,
    note_rate,
    note_value,
    step_size,
)
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.quadrature import short_integral
from pmjoint_codegen.loops.segments import enter_segments, next_break
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.loops.stepper import Stepper
from pmjoint_codegen.loops.steps import bounds, scales, shrink, spread
from pmjoint_codegen.loops.stick import Steps, Stick


def sampled_loop(
    evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory
) -> Callable[[int], None]:
    """Prepare a run of the sampled loop.

    Returns:
        A function that advances it by at most the given number of samples; `progress` records whether and how
        it ended.
    """
    return SampledLoop(evaluator, problem, progress, memory).advance


class SampledLoop:
    """One run; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.kernel = evaluator.kernel("sample")
        self.rates = evaluator.kernel("plant")
        self.guard = evaluator.kernel("plant_guard")
        self.kernels = Steps(evaluator, ("plant_taylor", "plant_guard", "plant"), progress)
        self.stepper = Stepper(self.kernels, problem, progress, memory)
        self.stick = Stick(evaluator, problem, progress, memory)
        self.windows = evaluator.manifest.windows
        self.e = problem.n_plant  # index of e among the channels
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self.x: Array = memory.sample[: problem.n_plant].copy()  # plant states at t
        self.slack = SAME_INSTANT * problem.sample_time
        # Python numbers: the loop reads them one by one.
        self.times: list[float] = problem.times.tolist()
        self.nodes: list[tuple[float, float]] = list(
            zip(problem.nodes.tolist(), problem.weights.tolist(), strict=True)
        )
        self.thresholds: list[float] = problem.thresholds.tolist()

    def advance(self, budget: int) -> None:
        """Take at most `budget` samples."""
        with np.errstate(all="ignore"):  # what overflows is found by the checks below, as in C
            for _ in range(budget):
                if self.progress.status != Status.RUNNING:
                    break
                self.sample()

    def sample(self) -> None:
        """One sample: y measured, v computed, w constant until the next; the plant advances in between."""
        progress, problem, memory = self.progress, self.problem, self.memory
        t = progress.sample * problem.sample_time
        end = (progress.sample + 1) * problem.sample_time
        rows_until = end - self.slack
        entered = enter_segments(problem, progress, memory, t + self.slack)
        v, w, flat, s_next = self.kernel(np.array([t]), memory.sample, problem.hold, problem.p)
        c = self.channels(flat)
        if entered:
            self.note_jump(float(c[0, self.e]), t)
        progress.t = t
        progress.evaluations += 1
        if progress.sample == 0:
            self.note_start(float(c[0, self.e]), float(c[1, 0]))
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
        """Coefficients as rows of powers; columns are x, then e, then the arguments of kinks."""
        return flat.reshape(-1, self.problem.n_channels)

    def note_start(self, e: float, rate: float) -> None:
        """X(0), e(0) and y'(0)."""
        for i, value in enumerate(self.memory.sample.tolist()):
            note_value(value, 0.0, i, self.memory.peaks, self.memory.peak_times)
        peaks, times, last = self.memory.peaks, self.memory.peak_times, self.problem.n_states + 1
        note_value(e, 0.0, last, peaks, times)
        if self.problem.notes_rate:
            note_value(rate, 0.0, last + 1, peaks, times)
        self.progress.band = self.problem.settled * abs(e)

    def enter_break(self, w: Array, until: float) -> None:
        """Take the segments of the reference that have begun by `until`; only e may jump."""
        if enter_segments(self.problem, self.progress, self.memory, until):
            t, sides = self.progress.t, self.memory.sides[: self.problem.n_kinks]
            found = self.rates(np.array([t]), self.x, np.concatenate([w, sides]), self.problem.p)
            self.note_jump(float(found[1][0]), t)

    def note_jump(self, e: float, t: float) -> None:
        """At a break point of the reference, e may jump; the guard of e is known for the segment before."""
        self.memory.window[1] = -1.0
        note_value(e, t, self.problem.n_states + 1, self.memory.peaks, self.memory.peak_times)

    def note_mode(self, t: float, v: float) -> None:
        """Record the mode of v at a sample, and its change."""
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
        self.memory.row_samples[row] = self.memory.sample
        self.memory.row_sample_times[row] = t_sample
        self.progress.row += 1
        result: Array = self.memory.rows[row]
        return result

    def hold(self, c: Array, w: Array, length: float, end: float, rows_until: float) -> None:
        """Integrate the plant under constant w for the time `length`, to `end`; `c` are the sample's own."""
        for kink, value in enumerate(c[0, self.e + 1 :].tolist()):
            self.set_side(kink, -1.0 if value < 0.0 else 1.0)
        broken = next_break(self.problem, self.progress) < min(rows_until, end)
        whole = self.progress.held < 0 and not broken and length <= self.problem.max_step
        if not (whole and self.smooth(c, length) and self.within(c, length) and self.shown(c, w, length)):
            self.long_hold(w, end, rows_until, self.progress.t)
            return
        progress = self.progress
        diverging, length = first_beyond(c[:, : self.e], self.problem.divergence, length)
        trial = self.try_step(c, length)
        if progress.status == Status.RUNNING:
            progress.integral += short_integral(c[:, self.e].tolist(), length)
            until = progress.t + length if diverging else end
            self.accept(c, trial, length, until, rows_until, progress.t)
            progress.status = Status.DIVERGED if diverging else progress.status

    def actuation(self, w: Array) -> Array:
        """The vector w and the present sides, as the kernels of the plant expect them."""
        return self.stick.sided(w)

    def within(self, c: Array, length: float) -> bool:
        """Whether a hold is one step: the last term is below the tolerance, the one before in proportion."""
        ratio = length / self.problem.hold_fraction
        power = ratio
        for _ in range(2, len(c) - 1):
            power = power * ratio
        before, last = (float(np.divide(1.0, q)) for q in (power, power * ratio))
        scale = np.maximum(np.abs(c[0]), 1.0)
        return bool(np.all(np.abs(c[-2]) <= before * scale) and np.all(np.abs(c[-1]) <= last * scale))

    def smooth(self, c: Array, tau: float) -> bool:
        """Whether no kink is met: every argument stays away from 0."""
        arguments = c[:, self.e + 1 :]
        return bool(np.all(spread(arguments, tau) < np.abs(arguments[0])))

    def shown(self, c: Array, w: Array, length: float) -> bool:
        """Whether the guard shows a hold to be one step of the sample's own coefficients.

        A window that the guard has evaluated once serves many holds; inside it, variations are at most twice
        the nonlinear part.
        """
        problem, t, n = self.problem, self.progress.t, self.problem.n_plant
        window, x = self.memory.window, c[:, : problem.n_plant]
        R = float(problem.hold_ratios[0]) * problem.sample_time
        if self.windows and self.covered(window, x, t, R):
            return True
        if self.windows:
            window[:2] = t + R, 2.0 * R
            window[2 : 2 + n], window[2 + n :] = x[0], WINDOW * spread(x, R)
            around = float(window[0]), window[2 : 2 + n].copy(), float(window[1]), window[2 + n :].copy()
            if 2.0 * self.hold_miss(w, *around, problem.sample_time, 0) <= 1.0:
                return True
        window[1] = -1.0  # none
        for disc, ratio in enumerate(problem.hold_ratios.tolist()):
            radius = ratio * length
            if self.hold_miss(w, t, x[0].copy(), radius, spread(x, radius), length, disc) <= 1.0:
                return True
        return False

    def covered(self, window: Array, x: Array, t: float, R: float) -> bool:
        """Whether the guard's window contains the disc of radius R around t."""
        n = self.problem.n_plant
        inside = np.all(np.abs(x[0] - window[2 : 2 + n]) + spread(x, R) <= window[2 + n :])
        return bool(abs(t - window[0]) + R <= window[1] and inside)

    def hold_miss(
        self, w: Array, t: float, x: Array, R: float, spreads: Array, length: float, disc: int
    ) -> float:
        """A hold's error relative to the allowed one, from the guard on discs of time and of each x."""
        problem, n = self.problem, self.problem.n_plant
        (rest,) = self.guard(np.array([t]), x, self.actuation(w), problem.p, np.array([R]), spreads)
        rates = float(problem.hold_rate_factors[disc]) * rest[:n] * length
        values = float(problem.hold_value_factors[disc]) * rest[n:]
        misses = np.concatenate([rates, values])
        most = float(np.max(misses)) if np.all(np.isfinite(misses)) else math.inf
        return most / (DEFECT * problem.tolerance)

    def long_hold(self, w: Array, end: float, rows_until: float, t_sample: float) -> None:
        """Integrate the plant under constant w to `end` in as many steps as it takes."""
        progress, problem = self.progress, self.problem
        smallest = SMALLEST_STEP * max(end, 1.0)
        progress.touching, progress.flips, progress.last_cut = -1, 0, math.inf
        self.stick.find_out(self.find_sides(w), self.x, w)
        while progress.t < end and progress.status == Status.RUNNING:
            at = next_break(problem, progress)
            last = at if at < min(rows_until, end) else end  # where the step must end
            left = last - progress.t
            c = self.channels(
                self.kernels.taylor(np.array([progress.t]), self.x, self.actuation(w), problem.p)[0]
            )
            progress.evaluations += 1
            tau, kink = self.long_step(c, w, left, smallest)
            if progress.status != Status.RUNNING:
                return
            if tau > 0.0:
                diverging, tau = first_beyond(c[:, : self.e], problem.divergence, tau)
                trial = self.try_step(c, tau)
                if progress.status != Status.RUNNING:
                    return
                progress.integral += self.long_integral(c, tau)
                until = progress.t + tau if tau < left else last
                self.accept(c, trial, tau, until, rows_until, t_sample)
                progress.touching, progress.flips = -1, 0
                progress.status = Status.DIVERGED if diverging else progress.status
            if last == at and progress.t >= at and progress.status == Status.RUNNING:
                self.enter_break(w, progress.t)
            if kink >= 0 and progress.status == Status.RUNNING:
                side = float((trial if tau > 0.0 else c[0])[self.e + 1 + kink])
                self.stick.meet(kink, self.x, w, side, 0)

    def find_sides(self, w: Array) -> list[float]:
        """The sides of all kinks at the state, where an argument of 0 leaves its side; the arguments."""
        sides, count = self.memory.sides, self.problem.n_kinks
        arguments: list[float] = []
        for j in range(count):  # an argument depends on the sides before its own
            given = np.concatenate([w, sides[:count]])
            arguments = self.rates(np.array([self.progress.t]), self.x, given, self.problem.p)[2].tolist()
            value = arguments[j]
            self.set_side(j, -1.0 if value < 0.0 else 1.0 if value > 0.0 else float(sides[j]))
        return arguments

    def set_side(self, kink: int, side: float) -> None:
        """Put a kink on a side.

        On the other side the right-hand side is another function: the guard's window is invalid.
        """
        if self.memory.sides[kink] != side:
            self.memory.window[1] = -1.0
        self.memory.sides[kink] = side

    def long_step(self, c: Array, w: Array, left: float, smallest: float) -> tuple[float, int]:
        """The length of a step of a long hold, up to `left` or the first kink, and that kink or -1.

        It is 0 at a kink that is passed at once, or if the run ends.
        """
        progress, problem, stepper = self.progress, self.problem, self.stepper
        h = step_size(c, problem.tolerance, problem.safety)
        h = first = min(h, GROWTH * progress.last_cut, problem.max_step, left)
        least = min(smallest, left)
        relative = scales(c)
        while True:
            h = stepper.guarded(c, progress.t, self.actuation(w), h, least, relative)
            if h == 0.0:
                finite = bool(np.all(np.isfinite(c)))
                progress.status = Status.STALLED if finite else Status.NON_FINITE
                return 0.0, -1
            kink, tau = stepper.first_kink(c, bounds(c, h), progress.touching, h, h)
            if kink >= 0 and tau == 0.0:
                return 0.0, kink
            miss = self.missed(c, w, tau, relative)
            if miss <= 1.0:
                progress.last_cut = h if h < first else math.inf
                return tau, kink
            progress.rejected += 1
            h = tau * shrink(miss, problem.order)

    def missed(self, c: Array, w: Array, tau: float, relative: Array) -> float:
        """The error of a step of a long hold relative to the allowed one; above 1 it is too long."""
        problem, t, actuation = self.problem, self.progress.t, self.actuation(w)
        points = [*(tau * part for part in problem.inside.tolist()), tau]
        most = max(self.stepper.defect(c, t, actuation, at, tau, relative) for at in points)
        return problem.lebesgue * most / (DEFECT * problem.tolerance)

    def long_integral(self, c: Array, size: float) -> float:
        """Integral of e^2 over one step of a hold with several steps."""
        total = 0.0
        for node, weight in self.nodes:
            e = float(evaluate(c[:, self.e : self.e + 1], size * node)[0])
            total += weight * (e * e)
        return size * total

    def try_step(self, c: Array, tau: float) -> Array:
        """The end of a trial step, shape (channels,), or the status that forbids it."""
        trial = evaluate(c, tau)
        if not np.all(np.isfinite(trial[: self.e])):
            self.progress.status = Status.NON_FINITE
        elif self.progress.steps >= self.problem.max_steps:
            self.progress.status = Status.TOO_MANY_STEPS
        return trial

    def accept(
        self, c: Array, trial: Array, tau: float, until: float, rows_until: float, t_sample: float
    ) -> None:
        """Accept a step of the plant: output rows, peaks, state."""
        progress = self.progress
        while progress.row < self.problem.n_rows:
            time = self.times[progress.row]
            if not (time <= until and time < rows_until):
                break
            self.next_row(t_sample)[: self.problem.n_plant] = evaluate(c[:, : self.e], time - progress.t)
        x, e, place = slice(0, self.e), slice(self.e, self.e + 1), self.problem.n_states + 1
        for channels, places in ((x, x), (e, slice(place, place + 1))):  # after X and v comes e
            note_peaks(
                c[:, channels],
                progress.t,
                tau,
                trial[channels],
                self.memory.peaks[places],
                self.memory.peak_times[places],
            )
        if self.problem.notes_rate:
            peaks, times = self.memory.peaks, self.memory.peak_times
            note_rate(c[:, 0].tolist(), progress.t, tau, place + 1, peaks, times)
        self.stepper.note_settled(c[:, self.e].tolist(), float(trial[self.e]), tau, until)
        self.x = trial[: self.e].copy()
        progress.t = until
        progress.steps += 1

    def settle(self, s_next: Array) -> None:
        """The state at the next sample, and its peaks; or the status that ends the run."""
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
