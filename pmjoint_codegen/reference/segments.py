"""A command as coefficients of y_r between break points, for the kernels.

On a segment that begins at t_k the reference is ``P(tau) + exp(-a tau) Q(tau)``, tau = t - t_k. Without a
filter Q is 0 and P the command. With the filter x_i' = a (x_{i-1} - x_i), i = 1 .. rho + 1, y_r = x_{rho+1},
and the command x_0 = c + s tau, the solution is x_i = c + s (tau - i/a) + q_i with

    q_i(tau) = exp(-a tau) sum_{j < i} (a tau)^j / j! q_{i-j}(0),

so the filter's state is known at every break point without integration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.reference.command import Command
from pmjoint_codegen.reference.spline import half_degree, spline_pieces

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Segments:
    """A reference, ready for the loops.

    Attributes:
        command: what it comes from.
        breaks: instants at which a segment begins, s, all later than 0; shape (segments - 1,).
        rows: shape (segments, entries), the kernels' parameters of each: t_k, a, then P and Q, constant terms
            first.
        shapes: shape (segments, degree + 1), the command itself, in powers of t - t_k.
    """

    command: Command
    breaks: Array
    rows: Array
    shapes: Array

    __repr__ = brief

    def places(self, t: Array) -> npt.NDArray[np.intp]:
        """The segment of each instant; a break point belongs to the segment that begins there."""
        return np.searchsorted(self.breaks, t, side="right")

    def values(self, t: Array) -> Array:
        """The unfiltered command, shape (...), at instants of the same shape."""
        place = self.places(t)
        tau, total = t - self.rows[place, 0], np.zeros(np.shape(t))
        for k in range(self.shapes.shape[1] - 1, -1, -1):
            total = total * tau + self.shapes[place, k]
        return total


def inside(segments: Segments | None, horizon: float) -> tuple[Array, Array]:
    """Break points before a horizon, and the rows of the segments up to there; empty for an expression."""
    if segments is None:
        return np.empty(0), np.empty((0, 0))
    count = int(np.searchsorted(segments.breaks, horizon, side="left"))
    return segments.breaks[:count], np.ascontiguousarray(segments.rows[: count + 1])


def degrees(rho: int) -> tuple[int, int]:
    """Degrees of P and of Q for a law that needs rho derivatives."""
    return 2 * half_degree(rho) - 1, rho


def make_segments(command: Command, rho: int) -> Segments:
    """Compute the segments of a command from t = 0 on.

    Args:
        command: with finite numbers and ascending instants.
        rho: derivatives that the law needs.

    Raises:
        UsageError: too few points for a spline that is smooth enough, or numbers that overflow.
    """
    t, y = np.array(command.t), np.array(command.y)
    with np.errstate(all="ignore"):  # what is not finite is refused below
        starts, shapes = _pieces(command, t, y, rho)
        rows = _rows(command.filter, starts, shapes, rho)
    if not np.all(np.isfinite(rows)):
        raise UsageError(
            f"{command.text}: has no finite coefficients",
            where="reference",
            remedy="points farther apart, or smaller values",
        )
    first = int(np.searchsorted(starts, 0.0, side="right")) - 1
    return Segments(command, starts[first + 1 :].copy(), rows[first:].copy(), shapes[first:].copy())


def _pieces(command: Command, t: Array, y: Array, rho: int) -> tuple[Array, Array]:
    """Starts of all pieces, and the command on each in powers of the time since then."""
    m = half_degree(rho)
    shapes = np.zeros((len(t) + 1, 2 * m))
    shapes[0, 0], shapes[1:, 0] = y[0], y
    if command.shape == "linear":
        shapes[1:-1, 1] = np.diff(y) / np.diff(t)
    elif command.shape == "spline" and len(t) > 1:
        if len(t) < m:
            raise UsageError(
                f"{command.text}: too few for {rho} continuous derivatives",
                where="reference",
                remedy=f"allowed: at least {m} points, or a filter",
            )
        shapes[1:-1] = spline_pieces(t, y, m)
    return np.concatenate([[min(0.0, t[0]) - 1.0 if t[0] <= 0 else 0.0], t]), shapes


def _rows(a: float | None, starts: Array, shapes: Array, rho: int) -> Array:
    p, q = degrees(rho)
    rows = np.zeros((len(starts), 2 + p + 1 + q + 1))
    rows[:, 0] = starts
    if a is None:
        rows[:, 2 : 3 + p] = shapes
        return rows
    c, slope = shapes[:, 0], shapes[:, 1]
    rows[:, 1] = a
    rows[:, 2], rows[:, 3] = c - slope * ((rho + 1) / a), slope
    rows[:, 3 + p :] = _filtered(a, starts, c, slope, rho + 1)
    return rows


def _filtered(a: float, starts: Array, c: Array, slope: Array, stages: int) -> Array:
    """Coefficients of Q on every piece, shape (pieces, stages); the filter starts at the first value.

    Plain numbers: a few of them for each of many pieces.
    """
    powers = [a**j / math.factorial(j) for j in range(stages)]
    lags = [i / a for i in range(1, stages + 1)]
    state, found = [0.0] * stages, np.zeros((len(starts), stages))
    values, slopes, steps = c.tolist(), slope.tolist(), np.diff(starts).tolist()
    for k in range(len(values)):
        found[k] = [powers[j] * state[stages - 1 - j] for j in range(stages)]
        if k + 1 == len(values):
            break
        h = steps[k]
        decay, terms = math.exp(-a * h), [1.0]
        for j in range(1, stages):
            terms.append(terms[-1] * (a * h) / j)
        jump, change = values[k] + slopes[k] * h - values[k + 1], slopes[k] - slopes[k + 1]
        moved = [
            math.fsum(terms[j] * state[i - j] for j in range(i + 1)) * decay if decay else 0.0
            for i in range(stages)
        ]
        state = [moved[i] + (jump - change * lags[i]) for i in range(stages)]
    return found
