"""Polynomials of one Taylor step: evaluation, step size, and the first change of sign.

The twin of ``loops/c/polynomial.c``: same arithmetic, same order. Coefficients are those of powers of the
time since the step's start, row k for order k, one column per channel.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.constants import CLOSE, JUMPED, LET_GO, MAX_DEPTH, MAX_REFINEMENTS, ON_KINK

EPSILON: Final = sys.float_info.epsilon


def evaluate(c: Array, tau: float | Array) -> Array:
    """Sum of ``c[k] tau^k`` by Horner.

    Args:
        c: shape (N + 1, channels).
        tau: time since the step's start, s; a number, or shape (rows, 1).

    Returns:
        Shape (channels,) or (rows, channels).
    """
    value: Array = c[-1] + np.zeros_like(tau)
    for row in c[-2::-1]:
        value = value * tau + row
    return value


def step_size(c: Array, tolerance: float, safety: float) -> float:
    """The step, s, that keeps the last two terms below the tolerance (Jorba and Zou 2005); may be infinite.

    Args:
        c: shape (N + 1, channels).
        tolerance: for every channel, relative to max(1, |value|).
        safety: factor on the result.
    """
    scale = np.maximum(np.abs(c[0]), 1.0)
    size = math.inf
    for k in (len(c) - 2, len(c) - 1):
        norm = float(np.max(np.abs(c[k]) / scale, initial=0.0))
        if norm > 0.0:
            size = min(size, math.pow(tolerance / norm, 1.0 / k))
    return size * safety


def leading_zeros(q: Sequence[float], h: float) -> int:
    """How many of the lowest coefficients are zero, or rounding, relative to the terms at h.

    Args:
        q: coefficients; the highest does not count.
        h: length of the step, s.
    """
    degree = len(q) - 1
    for zeros in range(degree):
        power, size = 1.0, 0.0
        for coefficient in q[zeros:]:
            size += abs(coefficient) * power
            power *= h
        if not (abs(q[zeros]) <= _noise(degree - zeros, size) and size <= sys.float_info.max):
            return zeros
    return degree


def _noise(degree: int, size: float) -> float:
    """Bound on the rounding error at a zero of a polynomial whose terms add up to `size`."""
    return 4.0 * (degree + 1) * EPSILON * size


def first_crossing(q: Sequence[float], h: float) -> float | None:
    """The first tau in (0, h) at which ``sum q[k] tau^k`` changes its sign, or None; see `crossings`."""
    return next(crossings(q, h), None)


def crossings(q: Sequence[float], h: float) -> Iterator[float]:
    """Every tau in (0, h) at which ``sum q[k] tau^k`` changes its sign, ascending.

    A zero at h itself is left to the next step; a zero without change of sign does not count. A value within
    rounding of zero counts as zero.

    Args:
        q: coefficients, ``q[0]`` not zero.
        h: length of the step, s.
    """
    a = []
    power = 1.0
    rest = 0.0
    for k, coefficient in enumerate(q):
        a.append(coefficient * power)
        power *= h
        rest += abs(a[k]) if k > 0 else 0.0
    size = rest + abs(a[0])
    if len(a) < 2 or abs(a[0]) > rest or not size <= sys.float_info.max:
        return
    for root in _isolate(a, size):
        yield root * h


def _on_level(q: list[float], h: float, touching: int, outward: int) -> float:
    """The value of q at the start of a step: 0 where the run stands on q's zero; arguments as of `passes`.

    When a kink changes its side, the argument of another may jump past its zero without taking that value: it
    is well inside its new side. Outside, it is on its zero to rounding, however little it moves, as where
    a run comes to rest on the kink of abs.
    """
    rest, power = 0.0, 1.0
    for coefficient in q[1:]:
        power *= h
        rest += abs(coefficient) * power
    jumped = touching == ON_KINK and -q[0] * outward > JUMPED * rest
    return q[0] if touching == 0 or jumped else 0.0


def passes(q: list[float], level: float, touching: int, outward: int, h: float) -> float | None:
    """The time in [0, h) at which a polynomial passes a level, upwards (+1) or downwards (-1), or None.

    On the level, to rounding, the first derivative that does not vanish decides, and the zero at the start is
    divided out before the search.

    Args:
        q: coefficients.
        level: value to pass.
        touching: 0; 1 where the run stands on a threshold of v; `ON_KINK` where it stands on a kink; `LET_GO`
            where that has held it until now.
        outward: direction.
        h: size of the step, s.
    """
    q = [q[0] - level, *q[1:]]
    q[0] = _on_level(q, h, touching, outward)
    if touching == LET_GO and len(q) > 2 and q[1] * outward > 0.0:
        q[1] = 0.0  # it leaves at a rate of 0, to rounding
    zeros = leading_zeros(q, h)
    if q[zeros] * outward > 0.0:
        return 0.0
    return first_crossing(q[zeros:], h)


def note_peaks(c: Array, t: float, tau: float, end: Array, peaks: Array, peak_times: Array) -> None:
    """Keep the largest magnitudes over a step: at its end, and inside.

    Args:
        c: shape (N + 1, channels).
        t: the step's start, s.
        tau: its length, s.
        end: values at its end, shape (channels,).
        peaks: changed in place, shape (channels or more,).
        peak_times: changed in place, s.
    """
    for i in range(c.shape[1]):
        note_value(float(end[i]), t + tau, i, peaks, peak_times)
        note_extremum(c[:, i].tolist(), t, tau, i, peaks, peak_times)


def note_value(value: float, t: float, i: int, peaks: Array, peak_times: Array) -> None:
    """Keep the largest magnitude of channel i and its time; NaN counts as the largest."""
    if not abs(value) <= peaks[i]:
        peaks[i] = abs(value)
        peak_times[i] = t


def note_extremum(c: list[float], t: float, tau: float, i: int, peaks: Array, peak_times: Array) -> None:
    """The largest magnitude of one channel inside a step: it is where the slope changes its sign."""
    power, bound = 1.0, 0.0
    for coefficient in c:
        bound += abs(coefficient) * power
        power *= tau
    if not bound > peaks[i]:
        return
    for when in crossings([k * c[k] for k in range(1, len(c))], tau):
        value = c[-1]
        for coefficient in c[-2::-1]:
            value = value * when + coefficient
        note_value(value, t + when, i, peaks, peak_times)


def note_rate(c: list[float], t: float, tau: float, i: int, peaks: Array, peak_times: Array) -> None:
    """The largest magnitude of one channel's rate over a step, stored at index i: at its end, and inside."""
    rate = [k * c[k] for k in range(1, len(c))]
    end = rate[-1]
    for coefficient in rate[-2::-1]:
        end = end * tau + coefficient
    note_value(end, t + tau, i, peaks, peak_times)
    note_extremum(rate, t, tau, i, peaks, peak_times)


def exceeds(c: Sequence[float], limit: float, tau: float) -> float | None:
    """The time at which a channel's magnitude passes `limit` inside a step of size tau, or None."""
    power, bound = 1.0, 0.0
    for coefficient in c:
        bound += abs(coefficient) * power
        power *= tau
    if not bound > limit:
        return None
    found = None
    for side in (-1.0, 1.0):
        when = first_crossing([c[0] + side * limit, *c[1:]], tau)
        found, tau = (found, tau) if when is None else (when, when)
    return found


def first_beyond(c: Array, limits: Array | float, tau: float) -> tuple[bool, float]:
    """Whether any channel's magnitude passes its limit inside a step of size tau, and the first time, or tau.

    Args:
        c: shape (N + 1, channels).
        limits: shape (channels,), or one on all of them.
        tau: s.
    """
    found = False
    for column, limit in zip(c.T.tolist(), np.broadcast_to(limits, c.shape[1]).tolist(), strict=True):
        when = exceeds(column, limit, tau)
        found, tau = (found, tau) if when is None else (True, when)
    return found, tau


def last_outside(c: Sequence[float], tau: float, band: float) -> float | None:
    """The last time in [0, tau) at which a channel's magnitude falls below `band`, or None."""
    power, bound = 1.0, 0.0
    for coefficient in c:
        bound += abs(coefficient) * power
        power *= tau
    if not bound > band:
        return None
    roots = [root for side in (-1.0, 1.0) for root in crossings([c[0] + side * band, *c[1:]], tau)]
    return max(roots, default=None)


def _isolate(a: list[float], size: float) -> Iterator[float]:
    """Descartes' rule on [0, 1], halving where it is inconclusive, from left to right: the roots in order."""
    degree = len(a) - 1
    noise = _noise(degree, size)
    before = 0
    stack = [(_to_bernstein(a), 0.0, 1.0)]
    while stack:
        b, low, width = stack.pop()
        changes, first, last = _variations(b, noise)
        if before != 0 and first != 0 and first != before:
            yield low  # the sign changed at the border, to rounding
            before = first
        if changes <= 1 or width <= math.ldexp(1.0, -MAX_DEPTH):
            if changes == 1:
                start = _guess(b, low, width, first, noise)
                yield _refine(a, start, low, low + width, first, 0.25 * EPSILON * size)
            elif first != last:
                yield low + 0.5 * width
            before = last if last != 0 else before
            continue
        left, right = _halve(b)
        width *= 0.5
        stack += [(right, low + width, width), (left, low, width)]


def _to_bernstein(a: list[float]) -> list[float]:
    """Bernstein coefficients on [0, 1], ``b_j = sum_k C(j,k)/C(n,k) a_k``, as running differences."""
    degree = len(a) - 1
    b = []
    binomial = 1.0
    for k in range(degree + 1):
        b.append(a[k] / binomial)
        binomial = binomial * (degree - k) / (k + 1)
    for level in range(1, degree + 1):
        for j in range(degree, level - 1, -1):
            b[j] += b[j - 1]
    return b


def _variations(b: list[float], noise: float) -> tuple[int, int, int]:
    """Sign changes among b without noise; the first and the last sign that is not noise (0: none)."""
    signs = [1 if value > noise else -1 for value in b if abs(value) > noise]
    if not signs:
        return 0, 0, 0
    changes = sum(one != other for one, other in pairwise(signs))
    return changes, signs[0], signs[-1]


def _halve(b: list[float]) -> tuple[list[float], list[float]]:
    """De Casteljau: the Bernstein coefficients of both halves."""
    degree = len(b) - 1
    left, right = list(b), [0.0] * (degree + 1)
    right[degree] = left[degree]
    for level in range(1, degree + 1):
        for j in range(degree, level - 1, -1):
            left[j] = 0.5 * (left[j - 1] + left[j])
        right[degree - level] = left[degree]
    return left, right


def _guess(b: list[float], low: float, width: float, before: int, noise: float) -> float:
    """Where the polyline through the Bernstein coefficients leaves a side: close to a root."""
    degree = len(b) - 1
    other = (j for j in range(1, degree) if abs(b[j]) > noise and (b[j] > 0.0) != (before > 0))
    j = next(other, degree)
    rise = b[j - 1] - b[j]
    return low + width * ((j - 1) + b[j - 1] / rise) / degree if rise != 0.0 else math.nan


def _refine(a: list[float], start: float, low: float, high: float, before: int, noise: float) -> float:
    """The root in (low, high), where the sign `before` ends: Newton's method, kept inside by bisection.

    Its last step is not repeated: the remaining error is the square of a relative error below `CLOSE`.
    """
    s = start if low < start < high else 0.5 * (low + high)
    for _ in range(MAX_REFINEMENTS):
        value, slope = a[-1], 0.0
        for coefficient in a[-2::-1]:
            slope = slope * s + value
            value = value * s + coefficient
        newton = s - value / slope if slope != 0.0 else math.nan
        if abs(value) <= noise:
            return s
        if (value > 0.0) == (before > 0):
            low = s
        else:
            high = s
        inside = low < newton < high
        if abs(newton - s) <= CLOSE * s:
            return newton if inside else s
        s = newton if inside else 0.5 * (low + high)
    return s
