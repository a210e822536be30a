"""Stick: a kink that holds the run; see ``emit/stick.py``. The twin of ``loops/c/stick.c``.

Both loops use this. While a kink holds a run, its argument stays 0 and its channel is the side that does.
"""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator, Kernel
from pmjoint_codegen.loops.problem import Memory, Problem, Progress
from pmjoint_codegen.loops.status import Status


class Steps:
    """The kernels for a run's steps, for the present step.

    Args:
        evaluator: of the kernels.
        names: of the coefficients, their guard and the rates.
        progress: of the run.
    """

    def __init__(self, evaluator: Evaluator, names: tuple[str, str, str], progress: Progress) -> None:
        self._progress = progress
        self._moving = [evaluator.kernel(name) for name in names]
        held = [f"{name}_held" for name in names] if evaluator.manifest.can_hold else []
        self._held = [evaluator.kernel(name) for name in held]

    def _now(self, place: int) -> Kernel:
        return (self._moving if self._progress.held < 0 else self._held)[place]

    @property
    def taylor(self) -> Kernel:
        """Coefficients."""
        return self._now(0)

    @property
    def guard(self) -> Kernel:
        """Bounds their error."""
        return self._now(1)

    @property
    def rates(self) -> Kernel:
        """The right-hand side."""
        return self._now(2)


class Stick:
    """When kinks hold one run, and when they let go; its methods have the names of the C functions."""

    def __init__(self, evaluator: Evaluator, problem: Problem, progress: Progress, memory: Memory) -> None:
        self.kernel: Kernel | None = evaluator.kernel("holds") if evaluator.manifest.can_hold else None
        self.problem = problem
        self.progress = progress
        self.memory = memory
        self._places: Array = np.empty(0)

    def sided(self, actuation: Array) -> Array:
        """What the actuator does and the sides, as the kernels for the present step expect them."""
        held = self.progress.held >= 0
        return np.concatenate(
            [actuation, self.memory.sides if held else self.memory.sides[: self.problem.n_kinks]]
        )

    def can_hold(self, kink: int, x: Array, w: Array) -> tuple[bool, float]:
        """Whether a kink can hold the run at x under w, and the side with which it would."""
        if self.kernel is None:
            return False, 0.0
        sides = self.memory.sides[: self.problem.n_kinks]
        value, pull, places = self.kernel(
            np.array([self.progress.t]), x, np.concatenate([w, sides]), self.problem.p
        )
        self._places = places.reshape(self.problem.n_kinks, self.problem.n_plant)
        side = float(value[kink])
        return abs(side) <= 1.0 and float(pull[kink]) < 0.0, side

    def hold_on(self, kink: int, x: Array) -> None:
        """From now on a kink holds the run; x goes to its zero if one state alone decides that."""
        x[:] = self._places[kink]
        self.progress.held, self.progress.touching = kink, -1
        self._flag(kink, 1.0)

    def find_rest(self, arguments: list[float], x: Array, w: Array) -> bool:
        """Whether a kink begins to hold the run, as at a start from rest: its argument is exactly 0."""
        for kink, argument in enumerate(arguments):
            if argument == 0.0 and self.can_hold(kink, x, w)[0]:
                self.hold_on(kink, x)
                return True
        return False

    def find_out(self, arguments: list[float], x: Array, w: Array) -> None:
        """Whether the kink that holds the run still does under a new w; or whether another begins to."""
        if self.progress.held < 0:
            self.find_rest(arguments, x, w)
            return
        holds, side = self.can_hold(self.progress.held, x, w)
        if not holds:
            self.let_go(side, 0)

    def let_go(self, side: float, first: int) -> None:
        """The kink that holds the run lets go, to the side whose sign `side` has.

        Args:
            side: its channel.
            first: value of `touching` on kink 0.
        """
        kink = self.progress.held
        self.memory.sides[kink] = -1.0 if side < 0.0 else 1.0
        self.progress.held, self.progress.touching = -1, first + self.problem.n_kinks + kink
        self._flag(kink, 0.0)

    def meet(self, kink: int, x: Array, w: Array, side: float, first: int) -> None:
        """The run arrives at a kink, or the one that holds it has reached `side` and lets go.

        It stops there, or passes to the other side.

        Args:
            kink: which.
            x: plant states, changed in place.
            w: output of the actuator.
            side: channel of the kink.
            first: value of `touching` on kink 0.
        """
        progress, memory = self.progress, self.memory
        progress.flips += 1
        if progress.held == kink:
            self.let_go(side, first)
        elif progress.held < 0 and self.can_hold(kink, x, w)[0]:
            self.hold_on(kink, x)
        else:
            memory.sides[kink] *= -1.0
            memory.window[1] = -1.0
            progress.touching = first + kink
        if progress.flips > 2 * self.problem.n_kinks:
            progress.status = Status.SLIDING

    def _flag(self, kink: int, value: float) -> None:
        """Set a kink's flag, and record when."""
        progress, memory = self.progress, self.memory
        memory.sides[self.problem.n_kinks + kink] = value
        memory.window[1] = -1.0  # the right-hand side is another function
        if progress.holds < self.problem.max_switches:
            memory.hold_times[progress.holds] = progress.t
            memory.hold_kinks[progress.holds] = kink
            progress.holds += 1
        else:
            progress.status = Status.TOO_MANY_SWITCHES
