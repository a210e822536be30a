"""diffrax on JAX: compiled by XLA, adaptive; many runs at once by vmap. It steps over the switches."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from benchmarks.paper import PLANT, X0, Array, Sines, control, rates
from benchmarks.peers.solver import Solver, load

SETTINGS = tuple(10.0**-k for k in range(5, 14))
MANY = 1_000_000


@cache
def _solve() -> Callable[..., Any]:
    """(X0, d1, b0, instants, tolerance) -> states at the instants; raises ImportError without JAX."""
    diffrax = load("diffrax")
    jax = load("jax")
    jnp = load("jax.numpy")

    jax.config.update("jax_enable_x64", True)

    def right(t: Any, X: Any, plant: Any) -> Any:
        d1, b0 = plant
        known = Sines(jnp.sin(t), jnp.cos(t), jnp.sin(X[1]))
        parts = [X[i] for i in range(len(X0))]
        v = control(parts, known, d1, b0)
        return jnp.stack(rates(parts, jnp.clip(v, -PLANT[2], PLANT[2]), v, known, d1, b0))

    def solve(start: Any, d1: Any, b0: Any, instants: Any, tolerance: Any) -> Any:
        steps = diffrax.PIDController(rtol=tolerance, atol=tolerance)
        saved = diffrax.SaveAt(ts=instants)
        term = diffrax.ODETerm(right)
        return diffrax.diffeqsolve(
            term, diffrax.Dopri8(), 0.0, instants[-1], 1e-3, start, (d1, b0),
            saveat=saved, stepsize_controller=steps, max_steps=MANY,
        ).ys  # fmt: skip

    return solve


@cache
def one() -> Callable[..., Any]:
    """Return the solution of one run, compiled."""
    jax = load("jax")

    compiled: Callable[..., Any] = jax.jit(_solve())
    return compiled


@cache
def many() -> Callable[..., Any]:
    """Return the solutions of many runs at once, compiled."""
    jax = load("jax")

    compiled: Callable[..., Any] = jax.jit(jax.vmap(_solve(), (0, 0, 0, None, None)))
    return compiled


def solver() -> Solver:
    """Return diffrax's Dopri8 for one run."""
    import numpy as np

    run = one()

    def make(tolerance: float, grid: Array) -> Callable[[], Array]:
        return lambda: np.asarray(run(np.array(X0), *PLANT[:2], grid, tolerance))

    return Solver("diffrax Dopri8", SETTINGS, make)


def run_many(x0: Array, d1: Array, b0: Array, horizon: float, tolerance: float) -> Array:
    """Integrate all runs at once; final states, shape (runs, 10)."""
    import numpy as np

    return np.asarray(many()(x0, d1, b0, np.array([horizon]), tolerance))[:, -1]


def control_many(X: Array, y_r: Array) -> Callable[[], Array]:
    """Return a call that evaluates v for all rows at once; X of shape (runs, 10), y_r (runs, 3)."""
    jax = load("jax")
    import numpy as np

    jax.config.update("jax_enable_x64", True)

    def law(state: Any, reference: Any) -> Any:
        return control([state[i] for i in range(len(X0))], Sines(reference[0], reference[1], 0.0), *PLANT[:2])

    compiled = jax.jit(jax.vmap(law))
    rows, references = load("jax.numpy").asarray(X), load("jax.numpy").asarray(y_r)
    return lambda: np.asarray(compiled(rows, references))
