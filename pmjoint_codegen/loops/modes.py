"""The actuator's saturation modes: (10), as intervals of v between thresholds.

Channel j of the actuator's output is ``w_j = clip(offset_j + slope_j v, lower_j, upper_j)``; channel 0
is u. Every limit of every channel is reached at one value of v, a threshold. Between neighbouring thresholds
all channels are affine in v, so the closed loop is smooth: that interval is a mode.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array


@dataclass(frozen=True)
class Actuator:
    """The modes of one actuator.

    Attributes:
        limits: shape (nw, 4), offset, slope, lower and upper limit of every channel.
        thresholds: shape (T,), values of v, ascending.
        modes: shape (T + 1, 2 nw), offset and slope of every channel in every mode.
        labels: one for every mode: -1, 0 or 1 where u is at its lower limit, inside, at its upper limit.
    """

    limits: Array
    thresholds: Array
    modes: Array
    labels: tuple[int, ...]

    @property
    def channels(self) -> int:
        """Number of channels, nw."""
        return len(self.limits)


def make_actuator(limits: Array) -> Actuator:
    """Find the modes from the ``actuation`` kernel's result.

    Args:
        limits: shape (4 nw,): offset, slope, lower, upper, channel by channel.
    """
    channels = [tuple(map(float, row)) for row in np.reshape(limits, (-1, 4))]
    reached = sorted({value for channel in channels for value in _thresholds(*channel)})
    ends = [-np.inf, *reached, np.inf]
    spans = list(pairwise(ends))
    return Actuator(
        limits=np.array(channels),
        thresholds=np.array(reached, dtype=np.float64),
        modes=np.array(
            [[value for channel in channels for value in _affine(channel, *span)] for span in spans]
        ),
        labels=tuple(_side(channels[0], *span) for span in spans),
    )


def _thresholds(offset: float, slope: float, lower: float, upper: float) -> list[float]:
    if slope == 0.0:
        return []
    values = [(limit - offset) / slope for limit in (lower, upper)]
    return [value + 0.0 for value in values if np.isfinite(value)]  # + 0.0 makes -0 and 0 one threshold


def _side(channel: tuple[float, ...], low: float, high: float) -> int:
    """-1, 0 or 1: the channel's limit for v in (low, high)."""
    offset, slope, lower, upper = channel
    if slope == 0.0:
        return int(offset > upper) - int(offset < lower)
    rising = 1 if slope > 0.0 else -1
    at_lower, at_upper = sorted(((lower - offset) / slope, (upper - offset) / slope))
    if high <= at_lower:
        return -rising
    return rising if low >= at_upper else 0


def _affine(channel: tuple[float, ...], low: float, high: float) -> tuple[float, float]:
    offset, slope, lower, upper = channel
    side = _side(channel, low, high)
    return {-1: (lower, 0.0), 0: (offset, slope), 1: (upper, 0.0)}[side]
