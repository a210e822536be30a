"""The continuous closed loop, step by step: the readable twin of ``kernels/c/continuous.c``.

Inside one saturation mode the loop is smooth, so a step is a polynomial: the ``taylor`` kernel gives its
coefficients, for all states and for v. A step ends where its last terms would exceed the tolerance, or
earlier where v passes a threshold of its mode: at that root of the polynomial the state is known as well as
at the step's end, and the next step begins there in the neighbouring mode. Output rows are values of the
polynomial.

Three rules keep it honest. The rates are continuous across a switch, since w is continuous in v, so the
polynomial must agree at its end with the kernels evaluated there; if not, the step is halved. A step
that starts on a threshold, to rounding, goes to the side that the first non-zero derivative of v points to.
And where rounding alone would decide between two modes, so that time stands still, one short step leaves the
thresholds alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator, Kernel
from pmjoint_codegen.simulate.polynomial import first_crossing, leading_zeros, note_extremum, note_value
from pmjoint_codegen.simulate.problem import Memory, Problem, Progress
from pmjoint_codegen.simulate.status import Status
from pmjoint_codegen.simulate.steps import allowed_step, arrive, bounds, scales
from pmjoint_codegen.simulate.steps import values as values_at

DEFECT: Final = 64.0  # a step's polynomial may miss the kernels at its end by this multiple of the tolerance
SMALLEST_STEP: Final = 1e-14  # relative to max(1 s, t): below it, time does not move
UNDECIDED_STEP: Final = 1e-7  # s; the step that leaves the thresholds alone
ROUNDED_UP: Final = 1.0 + 1e-12  # factor that covers the rounding of a sum of magnitudes, generously


def continuous_loop(
    evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory
) -> Callable[[int], None]:
    """Prepare a run of the continuous loop.

    Returns:
        A function that advances it by at most the given number of steps; `progress` says whether and how it
        ended.
    """
    return _Loop(evaluator, problem, progress, memory).advance


def _may_exceed(start: float, rise: float, reach: float, peak: float) -> bool:
    """Whether a channel may exceed its peak inside a step.

    The larger end of its straight line, and what its higher terms, bounded by `reach`, can add.
    """
    beside = reach * ROUNDED_UP - abs(start) - abs(rise)
    return max(abs(start), abs(start + rise)) + beside > peak


class _Loop:
    """One run; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.taylor: Kernel = evaluator.kernel("taylor")
        self.reference: Kernel = evaluator.kernel("reference")
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self.c: Array = np.empty(0)  # coefficients at t
        self.scales: Array = np.empty(0)  # of X and v at t, for relative errors
        self.reach: Array = np.empty(0)  # what X and v cannot exceed within the step on trial
        self.X: Array = memory.state[: problem.n_states].copy()

    def advance(self, budget: int) -> None:
        progress, problem = self.progress, self.problem
        with np.errstate(all="ignore"):  # what overflows is found by the checks below, as in C
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

    def expand(self, t: float, X: Array, mode: int) -> Array:
        """Taylor coefficients at (t, X) in a mode, shape (N + 1, nX + 1)."""
        self.progress.evaluations += 1
        (c,) = self.taylor(np.array([t]), X, self.problem.modes[mode], self.problem.p)
        return c.reshape(self.problem.order + 1, self.problem.n_states + 1)

    def start(self) -> None:
        """First call: the mode at t = 0 and the coefficients there."""
        progress, problem = self.progress, self.problem
        c = self.expand(0.0, self.X, 0)
        progress.mode = int(np.sum(c[0, -1] > problem.thresholds))
        progress.first_mode = progress.mode
        self.c = self.expand(0.0, self.X, progress.mode)
        if not np.all(np.isfinite(self.c[:2])):
            progress.status = Status.NON_FINITE
        for i, value in enumerate(self.c[0].tolist()):
            note_value(value, 0.0, i, self.memory.peaks, self.memory.peak_times)

    def step(self) -> None:
        """One step to the first threshold at most; halved until its end agrees with the kernels there."""
        progress, problem = self.progress, self.problem
        remaining = problem.horizon - progress.t
        smallest = SMALLEST_STEP * max(progress.t, 1.0)
        undecided = progress.idle > problem.n_thresholds
        self.scales = scales(self.c)
        h = allowed_step(self.c, self.scales, problem.tolerance, problem.safety)
        h = min(h, UNDECIDED_STEP) if undecided else h
        h = h if h < remaining else remaining
        while True:
            self.reach = bounds(self.c, h)
            index, tau = (-1, h) if undecided else self.first_passage(h)
            if index >= 0 and tau == 0.0:
                self.cross(index, progress.t)
                progress.idle += 1
                self.c = self.expand(progress.t, self.X, progress.mode)
                return
            end = progress.t + tau if tau < remaining else problem.horizon
            mode = progress.mode + (0 if index < 0 else 1 if index == progress.mode else -1)
            values, slopes = arrive(self.c, tau)
            trial = values[:-1]
            following = self.expand(end, trial, mode)
            if self.agrees(values, slopes, following, tau):
                self.accept(trial, following, tau, end)
                progress.touching = -1
                if index >= 0:
                    self.cross(index, end)
                return
            progress.rejected += 1
            h = 0.5 * tau
            if not h >= smallest:
                finite = bool(np.all(np.isfinite(following[:2])))
                progress.status = Status.STALLED if finite else Status.NON_FINITE
                return

    def first_passage(self, h: float) -> tuple[int, float]:
        """The threshold that v passes first within h, or -1; the time until then, or h."""
        progress, problem = self.progress, self.problem
        found, tau = -1, h
        if self.stays(h):
            return found, tau
        if progress.mode > 0:
            when = self.passes(progress.mode - 1, -1, tau)
            if when is not None:
                found, tau = progress.mode - 1, when
        if progress.mode < problem.n_thresholds:
            when = self.passes(progress.mode, 1, tau)
            if when is not None:
                found, tau = progress.mode, when
        return found, tau

    def stays(self, h: float) -> bool:
        """Whether v certainly keeps between the thresholds of its mode up to h.

        `reach` bounds its terms: a straight line, and no more beside it than the higher terms can add.
        """
        mode, thresholds = self.progress.mode, self.problem.thresholds
        low = float(thresholds[mode - 1]) if mode > 0 else -math.inf
        high = float(thresholds[mode]) if mode < len(thresholds) else math.inf
        v = float(self.c[0, -1])
        rise = float(self.c[1, -1]) * h
        beside = float(self.reach[-1]) * ROUNDED_UP - abs(v) - abs(rise)
        least = v + (rise if rise < 0.0 else 0.0) - beside
        most = v + (rise if rise > 0.0 else 0.0) + beside
        return self.progress.touching < 0 and least > low and most < high

    def passes(self, index: int, outward: int, h: float) -> float | None:
        """When v passes a threshold outwards (+1 above the mode, -1 below), from 0 to before h, or None.

        On the threshold, to rounding, the first derivative of v that does not vanish decides, and the zero at
        the start is divided out before the search.
        """
        q = self.c[:, -1].tolist()
        q[0] = 0.0 if self.progress.touching == index else q[0] - float(self.problem.thresholds[index])
        zeros = leading_zeros(q, h)
        if q[zeros] * outward > 0.0:
            return 0.0
        return first_crossing(q[zeros:], h)

    def agrees(self, values: Array, slopes: Array, following: Array, tau: float) -> bool:
        """Whether the polynomial agrees with the kernels at its end, as far as the tolerance asks.

        Compared are the slopes of the states and the value of v. High gains leave more rounding in v than its
        present value tells, so that its scale is its largest value so far. Nothing agrees with NaN.
        """
        allowed = DEFECT * self.problem.tolerance
        missed = tau * np.abs(slopes[:-1] - following[1, :-1]) * self.scales[:-1]
        v = abs(float(values[-1]) - float(following[0, -1]))
        return bool(np.all(missed <= allowed)) and v <= allowed * max(float(self.memory.peaks[-1]), 1.0)

    def accept(self, trial: Array, following: Array, tau: float, end: float) -> None:
        """Take a step: output rows, integral of e^2, state."""
        progress, problem = self.progress, self.problem
        self.write_rows(end)
        self.integrate_error(tau)
        self.note_peaks(following, tau)
        self.X, self.c = trial, following
        if np.any(np.abs(trial) > problem.divergence):
            progress.status = Status.DIVERGED
        progress.idle = 0 if end > progress.t else progress.idle + 1
        progress.t = end
        progress.steps += 1

    def note_peaks(self, following: Array, tau: float) -> None:
        """Peaks of X and v over a step: at its end, and inside."""
        c, t, peaks, times = self.c, self.progress.t, self.memory.peaks, self.memory.peak_times
        for i in range(c.shape[1]):
            note_value(float(following[0, i]), t + tau, i, peaks, times)
            line = float(c[0, i]), float(c[1, i]) * tau
            if i < self.problem.n_searched and _may_exceed(*line, float(self.reach[i]), float(peaks[i])):
                note_extremum(c[:, i].tolist(), t, tau, i, peaks, times)

    def write_rows(self, until: float) -> None:
        """Output rows up to a time."""
        progress, problem = self.progress, self.problem
        stop = int(np.searchsorted(problem.times, until, side="right"))
        rows = slice(progress.row, max(stop, progress.row))
        tau = problem.times[rows, np.newaxis] - progress.t
        self.memory.rows[rows] = values_at(self.c[:, :-1], tau)
        progress.row = rows.stop

    def integrate_error(self, size: float) -> None:
        """Add the integral of (y - y_r)^2 over the step."""
        total = 0.0
        instants = size * self.problem.nodes
        values = values_at(self.c[:, :1], instants[:, np.newaxis])[:, 0]
        rows = zip(instants.tolist(), values.tolist(), self.problem.weights.tolist(), strict=True)
        for tau, y, weight in rows:
            e = y - float(self.reference(np.array([self.progress.t + tau]), self.problem.p)[0][0])
            total += weight * (e * e)
        self.progress.integral += size * total

    def cross(self, index: int, t: float) -> None:
        """V leaves the mode through a threshold at time t."""
        self.progress.mode += 1 if index == self.progress.mode else -1
        self.progress.touching = index
        self.note_switch(t, self.progress.mode)

    def note_switch(self, t: float, mode: int) -> None:
        """Write down a change of mode; a touch, there and back at one instant, is none."""
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
