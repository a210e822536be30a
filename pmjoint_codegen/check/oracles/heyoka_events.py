"""What a run of heyoka notes: the changes that its events find, and its deviation from its equations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.oracles.heyoka_kinks import Kinks, SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.heyoka_rests import Rests
from pmjoint_codegen.check.trajectory import ACCURACY

Array = npt.NDArray[np.float64]

TRUSTED: Final = (
    0.1 * ACCURACY
)  # allowed deviation of a run from its equations: the defect's integral, relative
LEAVING: Final = 1e-8  # s; (10/s^2) LEAVING^2 is about the rounding of a state of 1
MOST_FLIPS: Final = 10_000  # of sides in a run; more is sliding by ever shorter steps


class Deviation:
    """How far a run is from its equations: the defects of its parts."""

    def __init__(self) -> None:
        """Start at none."""
        self._total, self._worst, self._place = 0.0, -1.0, 0.0

    def add(self, times: Array, defects: Array) -> None:
        """Add those of some steps, shape (steps,), between instants in s."""
        sizes = np.where(np.isnan(defects), np.inf, defects)
        self._total += float(np.sum(defects))
        if len(sizes) and float(np.max(sizes)) > self._worst:
            self._worst, self._place = float(np.max(sizes)), float(times[int(np.argmax(sizes))])

    def trust(self) -> None:
        """Raise `UntrustedError` if a run deviates from its equations."""
        if not self._total <= TRUSTED:
            raise UntrustedError(
                f"leaves its equations by {self._total:.3g} in all, most of it near t = {self._place:.6g} s"
            )


class Crossings:
    """The data that the events of a solver share with the run.

    Attributes:
        found: (t in s, mode that begins) in order.
        along: (t in s, parameters from there on) in order; the first is the start's.
        ended: why the run ended.
        mode: the present one.
        rest: a kink that begins to hold the run, or lets go, and its side from there on.
        left: the kink that let go where the run begins, or -1.
    """

    def __init__(self) -> None:
        """Start without findings."""
        self._modes: list[list[float]] = []
        self._first = 0
        self.mode = 0
        self.found: list[tuple[float, int]] = []
        self.along: list[tuple[float, Array]] = []
        self.ended: UntrustedError | None = None
        self.rest: tuple[int, float] | None = None
        self.left = -1

    def begin(
        self, modes: list[list[float]], mode: int, t: float, given: Array, first: int, left: int = -1
    ) -> None:
        """Prepare for a run.

        Args:
            modes: offsets and slopes of every channel, for every mode.
            mode: the first.
            t: s.
            given: parameters at the start: the reference's segment, offsets and slopes, sides, limit.
            first: how many of them belong to the segment.
            left: the kink that lets go here, or -1.
        """
        self.mode, self._first, self.left = mode, first, left
        self._modes, self.found, self.along, self.ended = modes, [], [(t, given.copy())], None
        self.rest = None

    def crossing(self, place: int) -> Callable[[Any, int], bool]:
        """The callback for a crossing of a threshold by v: the mode on its other side begins."""

        def crossed(solver: Any, direction: int) -> bool:
            mode = place + 1 if direction > 0 else place
            given = self.along[-1][1].copy()
            given[self._first : self._first + len(self._modes[mode])] = self._modes[mode]
            self.found.append((float(solver.time), mode))
            self.mode = mode
            return self._go_on(solver, given)

        return crossed

    def letting_go(self, place: int, side: float) -> Callable[[Any, int], bool]:
        """The callback for an end of what the kink that holds the run can do."""

        def let_go(_solver: Any, direction: int) -> bool:
            if direction * side < 0.0:
                return True
            self.rest = place, side
            return False

        return let_go

    def flipping(self, kinks: Kinks, rests: Rests | None, place: int) -> Callable[[Any, int], bool]:
        """The callback for a zero of a kink's argument: it holds, or its other side begins."""

        def flipped(solver: Any, direction: int) -> bool:
            t, given = float(solver.time), self.along[-1][1].copy()
            # The argument of a kink that lets go grows with the square of time: its zeros here are rounding.
            if place == self.left and t - self.along[0][0] <= LEAVING:
                return True
            if rests is not None and rests.holds(place, t, np.array(solver.state), given):
                self.rest = place, 0.0
                return False
            try:
                if direction == 0 or len(self.along) > MOST_FLIPS:
                    raise (
                        SlidingError(t) if direction else UntrustedError(f"rests on a kink at t = {t:.6g} s")
                    )
                sides = kinks.flip(place, float(direction), t, np.array(solver.state), given.copy())
            except UntrustedError as error:
                self.ended = error
                return False
            given[kinks.sides] = sides
            return self._go_on(solver, given)

        return flipped

    def _go_on(self, solver: Any, given: Array) -> bool:
        solver.pars[: len(given)] = given
        self.along.append((float(solver.time), given))
        return True
