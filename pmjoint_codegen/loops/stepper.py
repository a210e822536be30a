"""Whether a step follows the right-hand side throughout, and where it meets a kink: for both loops.

The twin of ``loops/c/guard.c``: same arithmetic, same order. The step is that of a Taylor kernel whose
first channels have rates and whose others are values; see `guard`.
"""

from __future__ import annotations

import math

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.constants import DEFECT, LET_GO, ON_KINK, ROUNDED_UP
from pmjoint_codegen.loops.polynomial import last_outside, passes
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.steps import arrive, bounds, shrink
from pmjoint_codegen.loops.stick import Steps


class Stepper:
    """Checks steps of one run.

    Args:
        kernels: for the present step.
        problem: of the run.
        progress: of the run.
        memory: of the run.
    """

    def __init__(self, kernels: Steps, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.kernels = kernels
        self.problem = problem
        self.progress = progress
        self.memory = memory

    def guarded(
        self, c: Array, t: float, actuation: Array, h: float, smallest: float, scales: Array
    ) -> float:
        """The longest step up to h that the guard shows to follow the right-hand side, or 0.

        Its polynomials then do so throughout if their defect at the points of comparison is small.
        """
        problem = self.problem
        now = np.array([t])
        order = problem.order + problem.n_inside + 1
        allowed = 1.0 / (DEFECT * problem.tolerance)
        start = np.ascontiguousarray(c[0, : problem.n_rates])
        while h >= smallest:
            best = 0.0
            likely = self.progress.disc
            for disc in [likely, *(i for i in range(problem.n_ratios) if i != likely)]:  # the last one first
                R = float(problem.ratios[disc]) * h
                P = bounds(c[1:], R)[: problem.n_rates] * R
                (rest,) = self.kernels.guard(now, start, actuation, problem.p, np.array([R]), P)
                miss = float(problem.factors[disc]) * self.largest(rest, h, scales) * allowed
                if miss <= 1.0:
                    self.progress.disc = disc
                    return h
                best = max(best, shrink(miss, order))
            h = h * best
        return 0.0

    def largest(self, values: Array, h: float, scales: Array) -> float:
        """The largest of values, each relative to its channel's scale; for rates, over a step of size h.

        Infinite if one is NaN. High gains leave more rounding in v than its present value shows, so its scale
        is its peak so far.
        """
        problem, scale = self.problem, scales.copy()
        scale[: problem.n_rates] = h * scale[: problem.n_rates]
        if not problem.sample_time:
            scale[problem.n_states] = 1.0 / max(float(self.memory.peaks[problem.n_states]), 1.0)
        sizes = np.abs(values) * scale
        return float(np.max(sizes)) if np.all(np.isfinite(sizes)) else math.inf

    def defect(self, c: Array, t: float, actuation: Array, at: float, tau: float, scales: Array) -> float:
        """How far the polynomials are from the right-hand side at a time of a step of size tau from t."""
        n = self.problem.n_rates
        values, slopes = arrive(c, at)
        now, start = np.array([t + at]), np.ascontiguousarray(values[:n])
        found = self.kernels.rates(now, start, actuation, self.problem.p)
        return self.largest(np.concatenate([slopes[:n], values[n:]]) - np.concatenate(found), tau, scales)

    def first_kink(
        self, c: Array, term_sums: Array, touching: int, h: float, tau: float
    ) -> tuple[int, float]:
        """The kink that is passed first within h and before tau, or -1; the time until then, or tau.

        One that holds the run is found where it lets go. At the start, the run is on kink `touching`, or
        n_kinks more if that has just let go. Where rounding alone moves the run from side to side, as at rest
        on the kink of abs, a kink is passed at the tolerance.
        """
        count, tolerance = self.problem.n_kinks, self.problem.tolerance
        first, found = self.problem.n_channels - count, -1
        for j, side in enumerate(self.memory.sides[:count].tolist()):
            if j == self.progress.held:
                goes, tau = self.lets_go(c, term_sums, first + j, h, tau)
                found = j if goes else found
                continue
            low, high = (0.0, math.inf) if side > 0.0 else (-math.inf, 0.0)
            on = ON_KINK if touching == j else LET_GO if touching == count + j else 0
            level = 0.0
            if self.progress.flips > count and all(abs(c[:2, first + j]) <= tolerance):
                on, level = 0, -side * tolerance
            if on or not self.stays(c, term_sums, first + j, low, high, h):
                when = passes(c[:, first + j].tolist(), level, on, -1 if side > 0.0 else 1, tau)
                found, tau = (found, tau) if when is None else (j, when)
        return found, tau

    def lets_go(self, c: Array, term_sums: Array, channel: int, h: float, tau: float) -> tuple[bool, float]:
        """Whether the side of a kink that holds the run leaves [-1, 1] before tau, and when, or tau."""
        found = False
        if self.stays(c, term_sums, channel, -1.0, 1.0, h):
            return found, tau
        for side in (-1, 1):
            when = passes(c[:, channel].tolist(), float(side), 0, side, tau)
            found, tau = (found, tau) if when is None else (True, when)
        return found, tau

    def note_settled(self, c: list[float], last: float, tau: float, end: float) -> None:
        """The last instant so far at which e is outside its band.

        Args:
            c: coefficients of e over a step from the present t.
            last: e at its end.
            tau: its size, s.
            end: its end, s.
        """
        progress = self.progress
        if abs(last) > progress.band:
            progress.settled = end
            return
        when = last_outside(c, tau, progress.band)
        progress.settled = progress.settled if when is None else progress.t + when

    def stays(self, c: Array, term_sums: Array, channel: int, low: float, high: float, h: float) -> bool:
        """Whether a channel certainly stays between two values up to h.

        The bound is its linear part plus the most that the higher terms can add; `term_sums` bounds them.
        """
        start = float(c[0, channel])
        rise = float(c[1, channel]) * h
        beside = float(term_sums[channel]) * ROUNDED_UP - abs(start) - abs(rise)
        least = start + (rise if rise < 0.0 else 0.0) - beside
        most = start + (rise if rise > 0.0 else 0.0) + beside
        return least > low and most < high
