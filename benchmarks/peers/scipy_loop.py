"""SciPy: LSODA and DOP853, with a right-hand side that numba has compiled where numba is there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import odeint, solve_ivp

from benchmarks.paper import PLANT, X0, Array, Sines, control, rates
from benchmarks.peers import numba_loop
from benchmarks.peers.solver import Solver

SETTINGS = tuple(10.0**-k for k in range(5, 14))
MANY = 1_000_000

Field = Callable[[float, Array, float, float, float], Array]


def field() -> tuple[Field, str]:
    """Return the right-hand side and what compiled it."""
    try:
        return numba_loop.field(), "numba"
    except ImportError:
        return plain, "Python"


def plain(t: float, X: Array, d1: float, b0: float, limit: float) -> Array:
    """Return the rates, uncompiled."""
    known = Sines(np.sin(t), np.cos(t), np.sin(X[1]))
    v = control(X, known, d1, b0)
    u = min(max(v, -limit), limit)
    return np.array(rates(X, u, v, known, d1, b0))


def solvers() -> list[Solver]:
    """Return LSODA through `odeint`, whose loop is compiled, and through `solve_ivp`; DOP853."""
    right, compiled_by = field()

    def lsoda(tolerance: float, grid: Array) -> Callable[[], Array]:
        return lambda: odeint_run(right, np.array(X0), PLANT, grid, tolerance)

    def ivp(method: str, right: Field = right) -> Callable[[float, Array], Callable[[], Array]]:
        def make(tolerance: float, grid: Array) -> Callable[[], Array]:
            def run() -> Array:
                found = solve_ivp(
                    right,
                    (0.0, grid[-1]),
                    X0,
                    method,
                    t_eval=grid,
                    args=PLANT,
                    rtol=tolerance,
                    atol=tolerance,
                )
                states: Array = found.y.T
                return states

            return run

        return make

    with_ = f"right-hand side {compiled_by}"
    python = Solver("SciPy LSODA (solve_ivp), right-hand side Python", SETTINGS, ivp("LSODA", plain))
    return [
        Solver(f"SciPy LSODA (odeint), {with_}", SETTINGS, lsoda),
        Solver(f"SciPy LSODA (solve_ivp), {with_}", SETTINGS, ivp("LSODA")),
        *([python] if right is not plain else []),
        Solver(f"SciPy DOP853, {with_}", SETTINGS, ivp("DOP853")),
    ]


def odeint_run(right: Field, x0: Array, plant: tuple[float, ...], grid: Array, tolerance: float) -> Array:
    """Integrate once with LSODA; states on the grid."""
    states: Array = odeint(
        right, x0, grid, args=plant, tfirst=True, rtol=tolerance, atol=tolerance, mxstep=MANY
    )
    return states


def solve_ivp_run(x0: Array, plant: tuple[float, ...], grid: Array, tolerance: float) -> Array:
    """Integrate once as one writes it first: `solve_ivp`, LSODA, rates in Python; states on the grid."""
    found = solve_ivp(
        plain, (0.0, grid[-1]), x0, "LSODA", t_eval=grid, args=plant, rtol=tolerance, atol=tolerance
    )
    states: Array = found.y.T
    return states
