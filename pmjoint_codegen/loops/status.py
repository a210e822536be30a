"""How a run ended, as a number that the loops set and a sentence for the user."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt

# of the largest |e|: a diverging joint's error grows exponentially, so the last is the largest
GROWING: Final = 0.95

Floats = npt.NDArray[np.float64]


class Status(IntEnum):
    """State of a run; the values are those of ``pmjoint_runtime.h``."""

    RUNNING = 0
    DONE = 1
    DIVERGED = 2
    NON_FINITE = 3
    STALLED = 4
    TOO_MANY_STEPS = 5
    TOO_MANY_SWITCHES = 6
    KERNEL_FAILED = 7
    SLIDING = 9  # 8 marks runs of a sweep that are not computed


_SENTENCES: Final = {
    Status.RUNNING: "interrupted at t = {t:.6g} s",
    Status.DONE: "reached the horizon, {t:.6g} s",
    Status.DIVERGED: "diverged: {state} passed {divergence:g} at t = {t:.6g} s",
    Status.NON_FINITE: "a state or the control stopped being a finite number after t = {t:.6g} s",
    Status.STALLED: "stalled at t = {t:.6g} s: no step that time can resolve is shown to follow the model, "
    "as where it is singular or nearly a jump, sigma(y) vanishes or a state grows without bound",
    Status.TOO_MANY_STEPS: "used up {max_steps} steps at t = {t:.6g} s",
    Status.TOO_MANY_SWITCHES: "used up {max_switches} saturation switches, or changes between stick "
    "and slip, at t = {t:.6g} s",
    Status.SLIDING: "stuck to the kink of sign({kink}) at t = {t:.6g} s: the rates on both sides point to "
    "it, but its side does not enter them as a factor alone, or another kink holds already; smooth it, such "
    "as tanh(({kink})/0.01)",
    Status.KERNEL_FAILED: "a generated kernel reported a failure at t = {t:.6g} s",
}


def sentence(
    status: Status,
    *,
    t: float,
    divergence: float,
    max_steps: int,
    max_switches: int,
    state: str = "a state",
    kink: str = "...",
) -> str:
    """Describe how a run ended.

    Args:
        status: of the run.
        t: time that it reached, s.
        divergence: bound on every state.
        max_steps: limit of the run.
        max_switches: limit of the run.
        state: name of the state that passed the bound.
        kink: argument of the kink that the run is stuck to.
    """
    return _SENTENCES[status].format(
        t=t, divergence=divergence, max_steps=max_steps, max_switches=max_switches, state=state, kink=kink
    )


def holds(
    status: npt.NDArray[Any], final_e: Floats, max_abs_e: Floats, final_saturated: Floats
) -> npt.NDArray[np.bool_]:
    """Whether a run reached the horizon without a diverging joint's input and error there.

    A diverging joint's input stays at its limit to the end, and its error is largest there. A bounded
    run may still be far from its reference: it has no settling time then.
    """
    bounded = (np.abs(final_e) < GROWING * max_abs_e) | (final_saturated == 0)
    return np.asarray((status == int(Status.DONE)) & bounded)
