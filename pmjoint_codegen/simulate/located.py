"""What a run locates besides its states: switches of the saturation, intervals of stick."""

from __future__ import annotations

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


def sticks_of(memory: Memory, state: Progress) -> tuple[tuple[float, float], ...]:
    """The intervals in which a kink held the plant, s; the last may still go on where the run ends."""
    times = [*memory.hold_times[: state.holds].tolist(), state.t]
    return tuple(zip(times[::2], times[1::2], strict=False))
