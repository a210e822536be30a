"""heyoka: Taylor integration compiled at run time, with saturation switches located as events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.paper import PLANT, STATES, X0, Array, Sines, control, rates
from benchmarks.peers.solver import Solver, load

LIMIT = PLANT[2]
SETTINGS = tuple(10.0**-k for k in np.arange(5.0, 15.1, 0.5))
LANES = 8


def solver() -> Solver:
    """Return the integrator for one run; raises ImportError without heyoka."""
    load("heyoka")

    return Solver("heyoka, events located", SETTINGS, _make)


def initial_modes(x0: Array, d1: Array, b0: Array) -> Array:
    """Return offset, slope, d1, b0 of every run: what its equations hold as parameters, shape (runs, 4)."""
    v = control(list(x0.T), Sines(0.0, 1.0, 0.0), d1, b0)
    free = np.abs(v) < LIMIT
    return np.stack([np.where(free, 0.0, np.sign(v) * LIMIT), np.where(free, 1.0, 0.0), d1, b0], axis=1)


def single(tolerance: float) -> Any:
    """Return an integrator for one run at a time; its parameters are as `initial_modes` gives them."""
    hy = load("heyoka")

    v, equations = _system()
    events = [
        hy.t_event(v - side * LIMIT, callback=lambda ta, rising, side=side: _switch(ta.pars, side, rising))
        for side in (1, -1)
    ]
    return hy.taylor_adaptive(
        equations, list(X0), pars=[0.0, 1.0, *PLANT[:2]], t_events=events, tol=tolerance
    )


def batch(tolerance: float, width: int = LANES) -> Any:
    """Return an integrator for `width` runs side by side."""
    hy = load("heyoka")

    v, equations = _system()
    events = [
        hy.t_event_batch(
            v - side * LIMIT,
            callback=lambda ta, rising, lane, side=side: _switch(ta.pars[:, lane], side, rising),
        )
        for side in (1, -1)
    ]
    start, parameters = np.zeros((len(X0), width)), np.zeros((4, width))
    return hy.taylor_adaptive_batch(equations, start, pars=parameters, t_events=events, tol=tolerance)


def _system() -> tuple[Any, list[tuple[Any, Any]]]:
    hy = load("heyoka")

    X = hy.make_vars(*STATES)
    sines = Sines(hy.sin(hy.time), hy.cos(hy.time), hy.sin(X[1]))
    v = control(X, sines, hy.par[2], hy.par[3])
    u = hy.par[0] + hy.par[1] * v
    return v, list(zip(X, rates(X, u, v, sines, hy.par[2], hy.par[3]), strict=True))


def _switch(pars: Any, side: int, rising: int) -> bool:
    """Enter the limit at `side`, or leave it: u = pars[0] + pars[1] v."""
    outwards = (rising > 0) == (side > 0)
    pars[0] = side * LIMIT if outwards else 0.0
    pars[1] = 0.0 if outwards else 1.0
    return True


def _make(tolerance: float, grid: Array) -> Callable[[], Array]:
    ta = single(tolerance)
    start = np.array(X0)
    parameters = initial_modes(start[np.newaxis], *(np.array([value]) for value in PLANT[:2]))[0]

    def run() -> Array:
        ta.time = 0.0
        ta.state[:] = start
        ta.pars[:] = parameters
        ta.reset_cooldowns()
        if len(grid) == 2:
            ta.propagate_until(grid[-1])
            return np.stack([start, ta.state])
        states: Array = ta.propagate_grid(grid)[-1]
        return states

    return run


def run_single(ta: Any, x0: Array, parameters: Array, horizon: float) -> Array:
    """Integrate run after run; final states, shape (runs, 10)."""
    final = np.empty_like(x0)
    for i in range(len(x0)):
        ta.time = 0.0
        ta.state[:] = x0[i]
        ta.pars[:] = parameters[i]
        ta.reset_cooldowns()
        ta.propagate_until(horizon)
        final[i] = ta.state
    return final


def run_batch(ta: Any, x0: Array, parameters: Array, horizon: float) -> Array:
    """Integrate group after group of lanes; final states, shape (runs, 10). Runs fill the groups exactly."""
    final = np.empty_like(x0)
    width = ta.batch_size
    for first in range(0, len(x0), width):
        ta.set_time(0.0)
        ta.state[:] = x0[first : first + width].T
        ta.pars[:] = parameters[first : first + width].T
        ta.reset_cooldowns()
        ta.propagate_until(horizon)
        final[first : first + width] = ta.state.T
    return final
