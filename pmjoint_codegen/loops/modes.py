"""The actuator's saturation modes: (10), as intervals of v between thresholds.

Channel j of the actuator's output is ``w_j = clip(offset_j + slope_j v, lower_j, upper_j)``; channel 0
is u. Every limit of every channel is reached at one value of v, a threshold. Between neighbouring thresholds
all channels are affine in v, so the closed loop is smooth: that interval is a mode.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

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


class Valve(NamedTuple):
    """A valve with a dead zone, between v and the channels behind u; see `pmjoint_derive.valve`.

    Attributes:
        dead_zone: the width that the controller adds.
        own: the valve's own.
        lower: limit of the command, at most 0.
        upper: limit of the command, at least 0.
    """

    dead_zone: float
    own: float
    lower: float
    upper: float


def make_actuator(limits: Array, valve: Valve | None = None) -> Actuator:
    """Find the modes from the ``actuation`` kernel's result.

    Args:
        limits: shape (4 nw,): offset, slope, lower, upper, channel by channel.
        valve: channels other than u follow its output; None: they follow v.
    """
    channels = [tuple(map(float, row)) for row in np.reshape(limits, (-1, 4))]
    points = [] if valve is None else _valve_points(valve)
    reached = {*points, *_thresholds(*channels[0])}
    for low, high in pairwise([-np.inf, *points, np.inf]):
        behind = [_behind(channel, valve, low, high) for channel in channels[1:]]
        reached |= {value for channel in behind for value in _thresholds(*channel) if low < value < high}
    ends = sorted(reached)
    spans = list(pairwise([-np.inf, *ends, np.inf]))
    return Actuator(
        limits=np.array(channels),
        thresholds=np.array(ends, dtype=np.float64),
        modes=np.array(
            [
                [
                    value
                    for j, channel in enumerate(channels)
                    for value in _affine(channel if j == 0 else _behind(channel, valve, *span), *span)
                ]
                for span in spans
            ]
        ),
        labels=tuple(_side(channels[0], *span) for span in spans),
    )


def _valve_points(valve: Valve) -> list[float]:
    """Values of v at which the valve's output bends or jumps, ascending."""
    more = valve.own - valve.dead_zone  # of v that is lost beyond what the controller adds
    right = {value for value in (more, valve.upper - valve.dead_zone) if value > 0.0}
    left = {value for value in (-more, valve.lower + valve.dead_zone) if value < 0.0}
    return sorted({0.0} | right | left)


def _behind(
    channel: tuple[float, ...], valve: Valve | None, low: float, high: float
) -> tuple[float, float, float, float]:
    """A channel behind the valve as a function of v in (low, high), in which the valve is affine."""
    offset, slope, lower, upper = channel
    if valve is None:
        return offset, slope, lower, upper
    before, gain = _through(valve, low, high)
    return offset + slope * before, slope * gain, lower, upper


def _through(valve: Valve, low: float, high: float) -> tuple[float, float]:
    """Offset and slope of the valve's output for v in (low, high)."""
    more = valve.own - valve.dead_zone
    if low >= 0.0:
        if low >= valve.upper - valve.dead_zone:  # the command is at its limit
            return max(valve.upper - valve.own, 0.0), 0.0
        return (-more, 1.0) if low >= more else (0.0, 0.0)
    if high <= valve.lower + valve.dead_zone:
        return min(valve.lower + valve.own, 0.0), 0.0
    return (more, 1.0) if high <= -more else (0.0, 0.0)


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
