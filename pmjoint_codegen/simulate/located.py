"""What a run locates besides its states: switches of the saturation, intervals of stick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.loops.problem import Memory, Progress


def switches_of(actuator: Actuator, memory: Memory, state: Progress) -> tuple[tuple[float, int], ...]:
    """The switches at which u enters or leaves a limit; those of other channels only are omitted."""
    found = []
    before = actuator.labels[state.first_mode]
    for i in range(state.switches):
        label = actuator.labels[int(memory.switch_modes[i])]
        if label != before:
            found.append((float(memory.switch_times[i]), label))
        before = label
    return tuple(found)


@dataclass(frozen=True)
class Holds:
    """When which kink held the plant.

    Attributes:
        begins: s.
        ends: s, of the same shape; the last may be where the run ends.
        kinks: which, of the same shape.
    """

    begins: Array
    ends: Array
    kinks: npt.NDArray[np.int64]

    __repr__ = brief

    @classmethod
    def of(cls, memory: Memory, state: Progress) -> Holds:
        """Copy what a run has recorded: its memory may serve the next."""
        if not state.holds:
            return cls(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64))
        times = np.append(memory.hold_times[: state.holds], state.t)
        count = len(times) // 2
        kinks = memory.hold_kinks[: state.holds : 2].copy()
        return cls(times[: 2 * count : 2], times[1 : 2 * count : 2], kinks)

    def flags(self, t: Array, n_kinks: int) -> Array:
        """1 for the kink that holds the plant at each instant, ends included, shape (len(t), n_kinks)."""
        found = np.zeros((len(t), n_kinks))
        place = np.searchsorted(self.begins, t, side="right") - 1
        rows = np.flatnonzero(place >= 0)
        rows = rows[t[rows] <= self.ends[place[rows]]]
        found[rows, self.kinks[place[rows]]] = 1.0
        return found

    def intervals(self) -> tuple[tuple[float, float], ...]:
        """(from, to) of each, s."""
        return tuple(zip(self.begins.tolist(), self.ends.tolist(), strict=True))
