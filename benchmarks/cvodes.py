"""The peer: CasADi's CVODES on the same closed loop and output grid, in the best setting found for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import read_tapes
from pmjoint_codegen.manifest import Manifest

Array = npt.NDArray[np.float64]

METHODS = ("adams", "bdf")
TOLERANCES = tuple(10.0**exponent for exponent in range(-6, -14, -1))


@dataclass(frozen=True)
class Entry:
    """One setting of CVODES: its label, and a call that returns the states on the grid (rows, states)."""

    label: str
    run: Callable[[], Array]


def closed_loop(folder: Path, limit: float, p: Array) -> dict[str, Any]:
    """Return the saturated closed loop as one CasADi DAE in t and X, with common terms shared.

    Args:
        folder: a generated one; the functions are those that its C was made from.
        limit: u_max, V.
        p: parameters, in the kernels' order.
    """
    tapes = read_tapes((folder / "kernels.tape").read_text(encoding="utf-8"))
    names = [signal.name for signal in Manifest.read(folder).signals]
    field, signals = rebuild(tapes["closed_loop"]), rebuild(tapes["signals"])
    t, state = ca.SX.sym("t"), ca.SX.sym("X", field.numel_in(1))
    v = signals(t, state, p)[names.index("v")]
    u = ca.fmin(ca.fmax(v, -limit), limit)
    return {"t": t, "x": state, "ode": ca.cse(field(t, state, ca.vertcat(u, 0), p))}


def entries(dae: dict[str, Any], x0: Array, grid: Array) -> Iterator[Entry]:
    """Yield CVODES in every setting, the loosest tolerance first.

    The right-hand side is interpreted: compiling it (CasADi's jit) changes times by less than their scatter.

    Args:
        dae: of `closed_loop`.
        x0: initial states.
        grid: output instants, s, the first of which is the initial one.
    """
    for tolerance in TOLERANCES:
        for method in METHODS:
            options: dict[str, Any] = {
                "abstol": tolerance,
                "reltol": tolerance,
                "linear_multistep_method": method,
                "max_num_steps": 1_000_000,
            }
            solver = ca.integrator("peer", "cvodes", dae, grid[0], grid[1:], options)
            yield Entry(f"{method} at {tolerance:.0e}", lambda solver=solver: integrate(solver, x0))  # type: ignore[misc]


def integrate(solver: Any, x0: Array) -> Array:
    """Integrate once; return the states at every instant of the grid, the first included."""
    result: Array = np.vstack([x0, solver(x0=x0)["xf"].full().T])
    return result
