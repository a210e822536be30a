"""One step of the continuous loop: its size, its end, and bounds along it.

The twin of ``loops/c/steps.c``: same arithmetic, same order. Coefficients are those of powers of the time
since the step's start, row k for order k, one column a channel.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.constants import LEAST_SHRINK, MOST_SHRINK


def arrive(c: Array, tau: float) -> tuple[Array, Array]:
    """Values and slopes of all channels at tau, shape (channels,) each.

    Even and odd powers apart, ``p = E(tau^2) + tau O(tau^2)``: half as long a chain as one Horner scheme.
    """
    square = tau * tau
    even, odd = _ends(c)
    even_slope, odd_slope = np.zeros_like(even), np.zeros_like(odd)
    for k in range(_top(c), 0, -2):
        odd_slope = odd_slope * square + odd
        odd = odd * square + c[k - 1]
        even_slope = even_slope * square + even
        even = even * square + c[k - 2]
    return even + tau * odd, odd + (2.0 * tau) * (even_slope + tau * odd_slope)


def values(c: Array, tau: float | Array) -> Array:
    """Values as `arrive` gives them; for tau of shape (rows, 1), shape (rows, channels)."""
    square = tau * tau
    even, odd = (end + np.zeros_like(tau) for end in _ends(c))
    for k in range(_top(c), 0, -2):
        odd = odd * square + c[k - 1]
        even = even * square + c[k - 2]
    result: Array = even + tau * odd
    return result


def bounds(c: Array, tau: float) -> Array:
    """Sums of the magnitudes of the terms at tau >= 0: bounds on all values up to tau."""
    return values(np.abs(c), tau)


def spread(c: Array, R: float) -> Array:
    """How far channels can move from their start while time is anywhere in a disc of radius R."""
    total = np.abs(c[-1])
    for row in c[-2:0:-1]:
        total = total * R + np.abs(row)
    return np.asarray(total * R)


def _top(c: Array) -> int:
    """The highest even order."""
    order = len(c) - 1
    return order - order % 2


def _ends(c: Array) -> tuple[Array, Array]:
    """Indices at which the schemes of the even and the odd powers begin."""
    top = _top(c)
    return c[top], c[top + 1] if len(c) > top + 1 else np.zeros_like(c[top])


def scales(c: Array) -> Array:
    """Powers of two from 1/max(1, |c_0|) to twice that, shape (channels,)."""
    result: Array = np.ldexp(1.0, 1 - np.frexp(np.fmax(np.abs(c[0]), 1.0))[1])
    return result


def allowed_step(c: Array, relative: Array, tolerance: float, safety: float) -> float:
    """The step, s, that keeps the last two terms below the tolerance (Jorba and Zou 2005).

    The roots are computed to no more digits than a safety factor has.

    Args:
        c: shape (N + 1, channels).
        relative: as `scales` gives them.
        tolerance: for every channel, relative to max(1, |value|).
        safety: factor on the result.
    """
    order = len(c) - 1
    allowed = _rough_log2(tolerance)
    last, before = (_rough_log2(_norm(c[k], relative)) for k in (order, order - 1))
    root = (allowed - last) * (1.0 / order)
    other = (allowed - before) * (1.0 / (order - 1))
    return safety * _rough_exp2(root if root < other else other)


def shrink(miss: float, order: int) -> float:
    """Factor on a step whose error is `miss` times the allowed one, by the error's order: 0.55 to 0.95."""
    factor = MOST_SHRINK * _rough_exp2(_rough_log2(miss) * (-1.0 / order))
    return MOST_SHRINK if factor > MOST_SHRINK else factor if factor > LEAST_SHRINK else LEAST_SHRINK


def _norm(row: Array, relative: Array) -> float:
    """The largest |c_k| of a row, relative to max(1, |c_0|); NaN is ignored."""
    return float(np.fmax.reduce(np.abs(row) * relative, initial=0.0))


def _rough_log2(a: float) -> float:
    """log2 of a non-negative number, to 0.01; 0 counts as tiny, infinity as huge."""
    (bits,) = struct.unpack("<q", struct.pack("<d", a))
    (m,) = struct.unpack("<d", struct.pack("<q", bits & 0x000FFFFFFFFFFFFF | 0x3FF0000000000000))
    whole = float((bits >> 52) - 1023)
    result: float = whole + ((2.0 - m * (1.0 / 3.0)) * m - 5.0 / 3.0)
    return result


def _rough_exp2(a: float) -> float:
    """2^a to 0.1 %, |a| < 1000."""
    n = round(a)
    f = a - n
    return math.ldexp(((f * 0.0558 + 0.2402) * f + 0.6931) * f + 1.0, n)
