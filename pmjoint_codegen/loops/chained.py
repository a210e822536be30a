"""The sampled closed loop with sensor, actuator and clock: the readable twin of ``loops/c/chained.c``.

What `pmjoint_codegen.loops.chain` says of a sample is done here; the plant in between takes the steps of a
long hold, cut where a delayed command begins to act.
"""

from __future__ import annotations

import math

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.chain import ACTING, CLOCK, COMMAND, NEXT, Chain, U
from pmjoint_codegen.loops.constants import SAME_INSTANT
from pmjoint_codegen.loops.controller import SampledLaw
from pmjoint_codegen.loops.polynomial import note_value
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.sampled import SampledLoop
from pmjoint_codegen.loops.status import Status


class ChainedLoop(SampledLoop):
    """One run; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        super().__init__(evaluator, problem, progress, memory)
        self.chain = Chain(*problem.chain.tolist())
        self.law = SampledLaw(evaluator, problem.p, problem.hold, self.chain)
        self.limits = problem.limits.reshape(-1, 4)

    def sample(self) -> None:
        """One sample: y read, v computed and commanded; the plant until the next, cut where w changes."""
        progress, problem, memory, k = self.progress, self.problem, self.memory, self.progress.sample
        t = self.chain.instant(k)
        progress.t = t
        progress.evaluations += 1
        self.enter_break(memory.held[ACTING:].copy(), t + self.slack)
        v, s_next = self.take_sample(k)
        note_value(v, t, problem.n_states, memory.peaks, memory.peak_times)
        if not math.isfinite(v):
            progress.status = Status.NON_FINITE
            return
        self.note_mode(t, v)
        due = self.take_due(t)
        if k == 0:
            memory.row_held[0] = memory.held
            self.note_beginning()
            if self.beyond():
                progress.status = Status.DIVERGED
        while progress.row < problem.n_rows and self.times[progress.row] <= t + self.slack:
            memory.row_held[progress.row] = memory.held
            self.next_row(t)
        if progress.row == problem.n_rows:
            progress.status = Status.DONE
        self.hold_pieces(t, self.chain.instant(k + 1), due)
        if progress.status == Status.RUNNING and progress.row == problem.n_rows:
            progress.status = Status.DONE
        if progress.status == Status.RUNNING:
            self.settle(s_next)
            progress.sample += 1

    def take_sample(self, k: int) -> tuple[float, Array]:
        """Measure, compute and command: v, and the controller's next states."""
        chain, problem, held = self.chain, self.problem, self.memory.held
        s = self.memory.sample[problem.n_plant :]
        if k == 0:  # before the first sample the command is 0, or what the limits leave of it
            held[COMMAND], held[NEXT] = chain.rest, 0.0
            held[ACTING:] = chain.channels(self.limits, chain.rest)
        held[CLOCK] = k * chain.period
        y_r = self.follow(float(held[CLOCK]))
        v = self.law.decide(s, y_r, chain.read(float(self.memory.sample[0]), k), k, held)[2]
        sent = chain.channels(self.limits, float(held[COMMAND]))
        self.memory.history[k % problem.n_history] = sent
        return float(v[0]), self.law.advance(s, y_r, held, float(held[U]), v)

    def follow(self, clock: float) -> Array:
        """y_r at the controller's own time, which may lie in another segment than the plant's."""
        problem, memory, now = self.problem, self.memory, self.progress.segment
        own = int(np.searchsorted(problem.breaks, clock + self.slack, side="right"))
        if own != now:
            memory.segment[:] = problem.segments[own]
        y_r = self.law.follow(clock)
        if own != now:
            memory.segment[:] = problem.segments[now]
        return y_r

    def take_due(self, t: float) -> float:
        """Let every command act that is due at t; the instant at which the next one is due."""
        chain, memory = self.chain, self.memory
        slack = SAME_INSTANT * chain.period
        while True:
            following = int(memory.held[NEXT])
            due = chain.instant(following) + chain.delay
            if following > self.progress.sample:
                return math.inf
            if due > t + slack:
                return due
            source = following - int(chain.samples)
            if source >= 0:
                memory.held[ACTING:] = memory.history[source % self.problem.n_history]
            memory.held[NEXT] = following + 1

    def note_beginning(self) -> None:
        """X(0), e(0) and y'(0), under the w that acts."""
        w = self.memory.held[ACTING:]
        found = self.rates(np.array([self.progress.t]), self.x, self.actuation(w), self.problem.p)
        self.note_start(float(found[1][0]), float(found[0][0]))

    def hold_pieces(self, t: float, end: float, due: float) -> None:
        """The plant from one sample to the next, cut where the command that acts changes."""
        progress, problem, memory = self.progress, self.problem, self.memory
        last = problem.horizon if problem.horizon < end - self.slack else end
        while progress.status == Status.RUNNING and progress.t < last:
            cut, before = due < end - self.slack and due < last, progress.row
            w = memory.held[ACTING:].copy()
            self.long_hold(w, due if cut else last, due if cut else end - self.slack, t)
            memory.row_held[before : progress.row] = memory.held
            if cut and progress.status == Status.RUNNING:
                due = self.take_due(due)
                self.enter_break(memory.held[ACTING:].copy(), progress.t)
