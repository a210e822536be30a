"""numba: the loop written by hand in Python and compiled at run time, for SciPy and by itself (RK4)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from benchmarks import paper
from benchmarks.paper import PLANT, X0, Array, Sines
from benchmarks.peers.solver import Solver, load

STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5)  # s; each divides 0.01 s


@cache
def field() -> Callable[[float, Array, float, float, float], Array]:
    """Return the compiled right-hand side (t, X, d1, b0, u_max) -> X'; raises ImportError without numba."""
    numba = load("numba")

    # numba compiles the very functions of `paper`; it takes neither keyword calls nor properties in them.
    control, rates = numba.njit(paper.control), numba.njit(paper.rates)
    sines = Sines

    def right(t: float, X: Array, d1: float, b0: float, limit: float) -> Array:
        known = sines(np.sin(t), np.cos(t), np.sin(X[1]))
        all_ = (X[0], X[1], X[2], X[3], X[4], X[5], X[6], X[7], X[8], X[9])
        v = control(all_, known, d1, b0)
        u = min(max(v, -limit), limit)
        return np.array(rates(all_, u, v, known, d1, b0))

    compiled: Callable[[float, Array, float, float, float], Array] = numba.njit(right)
    compiled(0.0, np.array(X0), *PLANT)
    return compiled


def runge_kutta() -> Solver:
    """Return the classical fourth-order method with a fixed step, wholly compiled; it steps over switches."""
    march = _march()

    def make(step: float, grid: Array) -> Callable[[], Array]:
        each = round(grid[1] / step)
        return lambda: march(np.array(X0), step, each, len(grid), *PLANT)

    return Solver("numba, RK4", STEPS, make)


@cache
def _march() -> Callable[..., Array]:
    numba = load("numba")

    right = field()

    def march(X: Array, h: float, each: int, rows: int, d1: float, b0: float, limit: float) -> Array:
        out = np.empty((rows, 10))
        out[0] = X
        for row in range(1, rows):
            for i in range(each):
                t = ((row - 1) * each + i) * h
                a = right(t, X, d1, b0, limit)
                b = right(t + 0.5 * h, X + 0.5 * h * a, d1, b0, limit)
                c = right(t + 0.5 * h, X + 0.5 * h * b, d1, b0, limit)
                d = right(t + h, X + h * c, d1, b0, limit)
                X = X + h / 6.0 * (a + 2.0 * (b + c) + d)
            out[row] = X
        return out

    compiled: Callable[..., Any] = numba.njit(march)
    return compiled
