"""Peers that simulate the closed loop with its saturation: heyoka in batches, and a SciPy loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.algebra import arithmetic, evaluate, python_function
from benchmarks.cvodes import Array
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.manifest import Manifest


def heyoka_present() -> bool:
    """Say whether heyoka is installed."""
    return find_spec("heyoka") is not None


class Heyoka:
    """heyoka's adaptive Taylor integrator with located saturation events, one trajectory or many.

    The right-hand side is symbolic and compiled by heyoka for this processor. An event where v passes a limit
    changes two parameters, as the modes of our own loop do.
    """

    def __init__(self, manifest: Manifest, tapes: Mapping[str, Tape], tolerance: float, width: int) -> None:
        """Compile the integrator; `width` 1 takes heyoka's scalar one."""
        hy: Any = import_module("heyoka")
        self.width, self.size = width, manifest.nX
        self.count = len(manifest.parameters)
        self.limit = manifest.parameter_names.index(manifest.limit)
        states = hy.make_vars(*(f"s{i}" for i in range(self.size)))
        p = [hy.par[i] for i in range(self.count + 2)]
        operations = arithmetic(hy, hy.expression)
        rates = evaluate(tapes["closed_loop"], [[hy.time], states, p[self.count :], p], operations)[0]
        signals = evaluate(tapes["signals"], [[hy.time], states, p], operations)[0]
        v = signals[[item.name for item in manifest.signals].index("v")]
        shape = (self.size, width) if width > 1 else (self.size,)
        pars = (self.count + 2, width) if width > 1 else (self.count + 2,)
        event = hy.t_event_batch if width > 1 else hy.t_event
        integrator = hy.taylor_adaptive_batch if width > 1 else hy.taylor_adaptive
        events = [event(v + side * p[self.limit], callback=self._switch(side)) for side in (1.0, -1.0)]
        system = list(zip(states, rates, strict=True))
        self.integrator = integrator(
            system, np.zeros(shape), pars=np.zeros(pars), t_events=events, tol=tolerance
        )

    def _switch(self, side: float) -> Callable[..., bool]:
        """Change the mode of one lane; `side` 1 is the lower limit, -1 the upper one."""
        count, limit = self.count, self.limit

        def one(integrator: Any, sign: int) -> bool:
            outside = sign * side < 0
            integrator.pars[count] = -side * integrator.pars[limit] if outside else 0.0
            integrator.pars[count + 1] = 0.0 if outside else 1.0
            return True

        def batch(integrator: Any, sign: int, lane: int) -> bool:
            outside = sign * side < 0
            integrator.pars[count, lane] = -side * integrator.pars[limit, lane] if outside else 0.0
            integrator.pars[count + 1, lane] = 0.0 if outside else 1.0
            return True

        return batch if self.width > 1 else one

    def simulate(self, x0: Array, p: Array, v0: Array, horizon: float) -> Array:
        """Return X at the horizon, shape (runs, nX); v0 is v at t = 0, which tells the first mode."""
        final = np.empty_like(x0)
        limit = p[:, self.limit]
        g = np.stack([np.clip(v0, -limit, limit) * (np.abs(v0) > limit), (np.abs(v0) <= limit).astype(float)])
        ta = self.integrator
        for first in range(0, len(x0), self.width):
            lanes = slice(first, first + self.width) if self.width > 1 else first
            ta.state[:] = x0[lanes].T
            ta.pars[: self.count] = p[lanes].T
            ta.pars[self.count :] = g[:, lanes]
            if self.width > 1:
                ta.set_time(0.0)
            else:
                ta.time = 0.0
            ta.reset_cooldowns()
            ta.propagate_until(horizon)
            final[lanes] = ta.state.T
        return final


class Scipy:
    """scipy.integrate.solve_ivp in a loop; the right-hand side is straight Python, its fastest way."""

    def __init__(self, manifest: Manifest, tapes: Mapping[str, Tape], method: str, tolerance: float) -> None:
        """Make the right-hand side."""
        self.rates = python_function(tapes["closed_loop"], ("t", "X", "g", "p"))
        self.signals = python_function(tapes["signals"], ("t", "X", "p"))
        self.v = [item.name for item in manifest.signals].index("v")
        self.limit = manifest.parameter_names.index(manifest.limit)
        self.method, self.tolerance = method, tolerance

    def simulate(self, x0: Array, p: Array, horizon: float) -> Array:
        """Return X at the horizon, shape (runs, nX)."""
        solve_ivp: Any = import_module("scipy.integrate").solve_ivp
        final = np.empty_like(x0)
        for i, own in enumerate(p.tolist()):
            limit = own[self.limit]

            def rates(t: float, X: Array, own: list[float] = own, limit: float = limit) -> list[float]:
                time, state = (t,), X.tolist()
                u = min(max(self.signals(time, state, own)[self.v], -limit), limit)
                result: list[float] = self.rates(time, state, (u, 0.0), own)
                return result

            done = solve_ivp(
                rates, (0.0, horizon), x0[i], method=self.method, rtol=self.tolerance, atol=self.tolerance
            )
            final[i] = done.y[:, -1]
        return final
