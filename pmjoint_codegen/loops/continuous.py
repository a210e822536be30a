"""The continuous closed loop, step by step: the readable twin of ``loops/c/continuous.c``.

Inside one saturation mode, and on one side of every kink, the loop is smooth, so a step is a polynomial: the
``taylor`` kernel gives its coefficients, for all states, v, e and the arguments of kinks. A step ends where
its last terms would exceed the tolerance, or earlier where v passes a threshold of its mode or a kink's
argument passes 0. At that root of the polynomial the state is known as accurately as at the step's end; the
next step begins there in the neighbouring mode or on the other side. Output rows are values of the
polynomial.

Four rules make it reliable. Coefficients at a step's start miss narrow features inside the step, so the
``guard`` kernel bounds, on discs around the start, the error of the polynomials anywhere (`guard`); the step
is cut until that is small. At its end, and where there are singularities at two points inside, the
polynomials must agree with the kernels evaluated there. A step that starts on a threshold or kink, to
rounding, goes to the side that the first non-zero derivative points to; if both sides of a kink point
back, the run ends. Where rounding alone would decide between two modes and time would not advance, one
short step ignores the thresholds.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.constants import DEFECT, GROWTH, ROUNDED_UP, SMALLEST_STEP, UNDECIDED_STEP
from pmjoint_codegen.loops.polynomial import first_beyond, note_extremum, note_rate, note_value, passes
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.segments import enter_segments, next_break
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.loops.stepper import Stepper
from pmjoint_codegen.loops.steps import allowed_step, arrive, bounds, scales, shrink
from pmjoint_codegen.loops.steps import values as values_at
from pmjoint_codegen.loops.stick import Steps, Stick


def continuous_loop(
    evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory
) -> Callable[[int], None]:
    """Prepare a run of the continuous loop.

    Returns:
        A function that advances it by at most the given number of steps; `progress` records whether and how
        it ended.
    """
    return _Loop(evaluator, problem, progress, memory).advance


def _may_exceed(start: float, rise: float, term_sum: float, peak: float) -> bool:
    """Whether a channel may exceed its peak inside a step.

    The bound is the larger end of its linear part plus the most that the higher terms can add; the
    magnitudes of all terms add up to `term_sum`.
    """
    beside = term_sum * ROUNDED_UP - abs(start) - abs(rise)
    return max(abs(start), abs(start + rise)) + beside > peak


class _Loop:
    """One run; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.kernels = Steps(evaluator, ("taylor", "guard", "closed_loop"), progress)
        self.stepper = Stepper(self.kernels, problem, progress, memory)
        self.stick = Stick(evaluator, problem, progress, memory)
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self.c: Array = np.empty(0)  # coefficients at t
        self.scales: Array = np.empty(0)  # of the channels at t, for relative errors
        self.term_sums: Array = np.empty(0)  # bounds on the channels within the trial step
        self.sides: Array = memory.sides[: problem.n_kinks]
        self.v = problem.n_states  # indices of v and e among the channels
        self.e = problem.n_states + 1
        self.X: Array = memory.state[: problem.n_states].copy()

    def advance(self, budget: int) -> None:
        progress, problem = self.progress, self.problem
        with np.errstate(all="ignore"):  # the checks below find overflow, as in C
            if progress.evaluations == 0:
                self.start()
            for _ in range(budget):
                if progress.status != Status.RUNNING:
                    break
                if progress.steps + progress.rejected >= problem.max_steps:
                    progress.status = Status.TOO_MANY_STEPS
                    break
                self.step()
                if progress.status == Status.RUNNING and progress.row == problem.n_rows:
                    progress.status = Status.DONE

    def actuation(self, mode: int) -> Array:
        """A mode and the present sides, as the kernels expect them."""
        return self.stick.sided(self.problem.modes[mode])

    def delivered(self, v: float) -> Array:
        """The output w of the actuator at a value of v in the present mode."""
        mode = self.problem.modes[self.progress.mode]
        return np.asarray(mode[::2] + mode[1::2] * v)

    def expand(self, t: float, X: Array, mode: int) -> Array:
        """Taylor coefficients at (t, X) in a mode, shape (N + 1, channels)."""
        self.progress.evaluations += 1
        (c,) = self.kernels.taylor(np.array([t]), X, self.actuation(mode), self.problem.p)
        return c.reshape(self.problem.order + 1, self.problem.n_channels)

    def start(self) -> None:
        """First call: the sides and the mode at t = 0, and the coefficients there."""
        progress, problem = self.progress, self.problem
        self.sides[:] = 1.0
        for _ in range(problem.n_kinks + 1):  # an argument depends on the sides before its own
            c = self.expand(0.0, self.X, 0)
            self.sides[:] = np.where(c[0, self.e + 1 :] < 0.0, -1.0, 1.0)
        progress.mode = int(np.sum(c[0, self.v] > problem.thresholds))
        progress.first_mode = progress.mode
        self.c = self.expand(0.0, self.X, progress.mode)
        x, w = self.X[: problem.n_plant], self.delivered(float(self.c[0, self.v]))
        if self.stick.find_rest(self.c[0, self.e + 1 :].tolist(), x, w):
            self.c = self.expand(0.0, self.X, progress.mode)
        if not np.all(np.isfinite(self.c[:2])):
            progress.status = Status.NON_FINITE
        elif self.beyond():
            progress.status = Status.DIVERGED
        progress.band = problem.settled * abs(float(self.c[0, self.e]))
        for i, value in enumerate(self.c[0, : self.e + 1].tolist()):
            note_value(value, 0.0, i, self.memory.peaks, self.memory.peak_times)
        if problem.notes_rate:
            note_value(float(self.c[1, 0]), 0.0, self.e + 1, self.memory.peaks, self.memory.peak_times)

    def beyond(self) -> bool:
        """Whether any state is beyond its limit of divergence."""
        return bool(np.any(np.abs(self.X) > self.problem.reach))

    def step(self) -> None:
        """One step, to the first threshold or kink; cut until guard and points of comparison accept it."""
        progress, problem = self.progress, self.problem
        at = next_break(problem, progress)
        last = min(at, problem.horizon)  # where the step must end
        remaining = last - progress.t
        smallest = min(SMALLEST_STEP * max(progress.t, 1.0), remaining)
        undecided = progress.idle > problem.n_thresholds
        self.scales = scales(self.c)
        h = first = self.first_step(remaining)
        while True:
            h = self.stepper.guarded(
                self.c, progress.t, self.actuation(progress.mode), h, smallest, self.scales
            )
            if h == 0.0:
                finite = bool(np.all(np.isfinite(self.c)))
                progress.status = Status.STALLED if finite else Status.NON_FINITE
                return
            self.term_sums = bounds(self.c, h)
            index, tau = (-1, h) if undecided else self.first_passage(h)
            if index >= 0 and tau == 0.0:
                self.pass_at_once(index)
                return
            diverging, tau = first_beyond(self.c[:, : self.v], problem.reach, tau)
            index = -1 if diverging else index
            end = progress.t + tau if tau < remaining else last
            threshold = 0 <= index < problem.n_thresholds
            mode = progress.mode + (0 if not threshold else 1 if index == progress.mode else -1)
            values, slopes = arrive(self.c, tau)
            following = self.expand(end, values[: self.v], mode)
            miss = self.missed(values, slopes, following, tau)
            if miss <= 1.0:
                self.accept(values, following, tau, end)
                progress.status = Status.DIVERGED if diverging else progress.status
                progress.last_cut = h if h < first else math.inf
                progress.touching = -1
                if index >= 0:
                    self.cross(index, end, values)
                if index >= problem.n_thresholds:
                    self.c = self.expand(end, self.X, progress.mode)
                if end >= at and progress.status == Status.RUNNING:
                    self.enter()
                return
            progress.rejected += 1
            h = tau * shrink(miss, problem.order)
            if not h >= smallest:
                finite = bool(np.all(np.isfinite(following[:2])))
                progress.status = Status.STALLED if finite else Status.NON_FINITE
                return

    def first_step(self, remaining: float) -> float:
        """The first trial step: the length that the last coefficients allow, within the other limits."""
        progress, problem = self.progress, self.problem
        h = allowed_step(self.c, self.scales, problem.tolerance, problem.safety)
        h = min(h, GROWTH * progress.last_cut, problem.max_step)
        h = UNDECIDED_STEP if progress.idle > problem.n_thresholds and h > UNDECIDED_STEP else h
        return h if h < remaining else remaining

    def missed(self, values: Array, slopes: Array, following: Array, tau: float) -> float:
        """Error of the polynomials, relative to the allowed one, at the points of comparison and the end.

        Compared are the slopes of the states and the values of the other channels; above 1 the step is too
        long.
        """
        problem, n = self.problem, self.v
        at_end = np.concatenate([slopes[:n] - following[1, :n], values[n:] - following[0, n:]])
        most = self.stepper.largest(at_end, tau, self.scales)
        g = self.actuation(self.progress.mode)
        for part in problem.inside.tolist():
            at = tau * part
            most = max(most, self.stepper.defect(self.c, self.progress.t, g, at, tau, self.scales))
        return problem.lebesgue * most / (DEFECT * problem.tolerance)

    def first_passage(self, h: float) -> tuple[int, float]:
        """The threshold or kink that is passed first within h, or -1; the time until then, or h."""
        progress, problem = self.progress, self.problem
        found, tau = -1, h
        if not self.keeps_mode(h):
            for side in (-1, 1):
                index = progress.mode + (-1 if side < 0 else 0)
                if 0 <= index < problem.n_thresholds:
                    level = float(problem.thresholds[index])
                    when = passes(
                        self.c[:, self.v].tolist(), level, int(progress.touching == index), side, tau
                    )
                    found, tau = (found, tau) if when is None else (index, when)
        touching = progress.touching - problem.n_thresholds
        kink, tau = self.stepper.first_kink(self.c, self.term_sums, touching, h, tau)
        found = problem.n_thresholds + kink if kink >= 0 else found
        return found, tau

    def keeps_mode(self, h: float) -> bool:
        """Whether v certainly stays between the thresholds of its mode up to h."""
        mode, thresholds = self.progress.mode, self.problem.thresholds
        low = float(thresholds[mode - 1]) if mode > 0 else -math.inf
        high = float(thresholds[mode]) if mode < len(thresholds) else math.inf
        free = not 0 <= self.progress.touching < len(thresholds)
        return free and self.stepper.stays(self.c, self.term_sums, self.v, low, high, h)

    def pass_at_once(self, index: int) -> None:
        """A threshold or kink is passed at the very start of a step: the coefficients beyond it."""
        progress = self.progress
        self.cross(index, progress.t, self.c[0])
        progress.idle += index < self.problem.n_thresholds
        self.c = self.expand(progress.t, self.X, progress.mode)

    def enter(self) -> None:
        """At a break point of the reference: the coefficients beyond it; where it jumps, so do v and e."""
        progress, memory = self.progress, self.memory
        enter_segments(self.problem, progress, memory, progress.t)
        self.c = self.expand(progress.t, self.X, progress.mode)
        mode = int(np.sum(self.c[0, self.v] > self.problem.thresholds))
        if mode != progress.mode:
            progress.mode, progress.touching = mode, -1
            self.note_switch(progress.t, mode)
            self.c = self.expand(progress.t, self.X, mode)
        for i in (self.v, self.e):
            note_value(float(self.c[0, i]), progress.t, i, memory.peaks, memory.peak_times)

    def accept(self, values: Array, following: Array, tau: float, end: float) -> None:
        """Accept a step: output rows, metrics of e, peaks, state."""
        progress, problem = self.progress, self.problem
        self.write_rows(end)
        if problem.n_nodes:
            self.note_error(float(values[self.e]), tau, end)
        self.note_peaks(following, tau)
        self.X, self.c = values[: self.v], following
        if self.beyond():
            progress.status = Status.DIVERGED
        moved = end > progress.t
        progress.idle = 0 if moved else progress.idle + 1
        progress.flips = 0 if moved else progress.flips
        progress.t = end
        progress.steps += 1

    def note_peaks(self, following: Array, tau: float) -> None:
        """Peaks of X, v, e and y' over a step: at its end, and inside."""
        c, t, peaks, times = self.c, self.progress.t, self.memory.peaks, self.memory.peak_times
        for i in range(self.e + 1):
            note_value(float(following[0, i]), t + tau, i, peaks, times)
            line = float(c[0, i]), float(c[1, i]) * tau
            searched = i < self.problem.n_searched or i == self.v  # of v always: the guard scales by it
            if searched and _may_exceed(*line, float(self.term_sums[i]), float(peaks[i])):
                note_extremum(c[:, i].tolist(), t, tau, i, peaks, times)
        if self.problem.notes_rate:
            note_rate(c[:, 0].tolist(), t, tau, self.e + 1, peaks, times)

    def write_rows(self, until: float) -> None:
        """Output rows up to a time."""
        progress, problem = self.progress, self.problem
        stop = int(np.searchsorted(problem.times, until, side="right"))
        rows = slice(progress.row, max(stop, progress.row))
        tau = problem.times[rows, np.newaxis] - progress.t
        self.memory.rows[rows] = values_at(self.c[:, : self.v], tau)
        progress.row = rows.stop

    def note_error(self, last: float, size: float, end: float) -> None:
        """Add the integral of e^2 over the step, and record when e is last outside its band."""
        progress, total = self.progress, 0.0
        instants = size * self.problem.nodes
        e = values_at(self.c[:, self.e : self.e + 1], instants[:, np.newaxis])[:, 0]
        for value, weight in zip(e.tolist(), self.problem.weights.tolist(), strict=True):
            total += weight * (value * value)
        progress.integral += size * total
        self.stepper.note_settled(self.c[:, self.e].tolist(), last, size, end)

    def cross(self, index: int, t: float, values: Array) -> None:
        """A threshold or a kink is passed at time t, where the channels have `values`."""
        progress, first = self.progress, self.problem.n_thresholds
        if index >= first:
            kink, x = index - first, self.X[: self.problem.n_plant]
            side = float(values[self.e + 1 + kink])
            self.stick.meet(kink, x, self.delivered(float(values[self.v])), side, first)
            return
        progress.touching = index
        progress.mode += 1 if index == progress.mode else -1
        self.note_switch(t, progress.mode)

    def note_switch(self, t: float, mode: int) -> None:
        """Record a change of mode; a touch, there and back at one instant, is none."""
        progress, memory = self.progress, self.memory
        n = progress.switches
        before = memory.switch_modes[n - 2] if n > 1 else progress.first_mode
        if n > 0 and memory.switch_times[n - 1] == t and before == mode:
            progress.switches -= 1
        elif t == 0.0:
            progress.first_mode = mode
        elif n < self.problem.max_switches:
            memory.switch_times[n] = t
            memory.switch_modes[n] = mode
            progress.switches += 1
        else:
            progress.status = Status.TOO_MANY_SWITCHES
