"""The changes within a run of heyoka's loop: its events' callbacks, and what they record."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.oracles.heyoka_kinks import Kinks, SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.heyoka_rests import Rests

Array = npt.NDArray[np.float64]

MOST_FLIPS: Final = 10_000  # of sides in a run; more is sliding by ever shorter steps


class Crossings:
    """The data that the events of a solver share with the run.

    Attributes:
        found: (t in s, mode that begins) in order.
        along: (t in s, parameters from there on) in order; the first is the start's.
        ended: why the run ended.
        rest: a kink that begins to hold the run, or lets go, and its side from there on.
    """

    def __init__(self) -> None:
        """Start without findings."""
        self._modes: list[list[float]] = []
        self.found: list[tuple[float, int]] = []
        self.along: list[tuple[float, Array]] = []
        self.ended: UntrustedError | None = None
        self.rest: tuple[int, float] | None = None

    def begin(self, modes: list[list[float]], t: float, given: Array) -> None:
        """Prepare for a run.

        Args:
            modes: offsets and slopes of every channel, for every mode.
            t: s.
            given: parameters at the start: offsets and slopes, sides, limit.
        """
        self._modes, self.found, self.along, self.ended = modes, [], [(t, given.copy())], None
        self.rest = None

    def crossing(self, place: int) -> Callable[[Any, int], bool]:
        """The callback for a crossing of a threshold by v: the mode on its other side begins."""

        def crossed(solver: Any, direction: int) -> bool:
            mode = place + 1 if direction > 0 else place
            given = self.along[-1][1].copy()
            given[: len(self._modes[mode])] = self._modes[mode]
            self.found.append((float(solver.time), mode))
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
            given[len(given) - 1 - kinks.count : len(given) - 1] = sides
            return self._go_on(solver, given)

        return flipped

    def _go_on(self, solver: Any, given: Array) -> bool:
        solver.pars[: len(given)] = given
        self.along.append((float(solver.time), given))
        return True
