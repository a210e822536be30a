"""The peer: CasADi's CVODES on the same closed loop and output grid, in the best setting found for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.paper import X0, Array
from benchmarks.peers.solver import Solver
from benchmarks.reference import ROOT
from pmjoint_codegen.kernels.interpreted import rebuild
from pmjoint_codegen.kernels.tape import read_tapes
from pmjoint_codegen.manifest import Manifest

METHODS = ("adams", "bdf")
TOLERANCES = tuple(10.0**exponent for exponent in range(-6, -14, -1))


def closed_loop(folder: Path) -> dict[str, Any]:
    """Return the saturated closed loop as one CasADi DAE in t and X, with common terms shared.

    Args:
        folder: a generated one; the functions are those that its C was made from.
    """
    tapes = read_tapes((folder / "kernels.tape").read_text(encoding="utf-8"))
    manifest = Manifest.read(folder)
    names = [signal.name for signal in manifest.signals]
    values = {item.name: item.value for item in manifest.parameters}
    p, limit = np.array(list(values.values())), values[manifest.limit]
    field, signals = rebuild(tapes["closed_loop"]), rebuild(tapes["signals"])
    t, state = ca.SX.sym("t"), ca.SX.sym("X", field.numel_in(1))
    v = signals(t, state, p)[names.index("v")]
    u = ca.fmin(ca.fmax(v, -limit), limit)
    return {"t": t, "x": state, "ode": ca.cse(field(t, state, ca.vertcat(u, 0), p)[0])}


def solvers() -> Iterator[Solver]:
    """Yield CVODES with both of its methods.

    The right-hand side is interpreted: compiling it (CasADi's jit) changes times by less than their scatter.
    """
    dae = closed_loop(ROOT / "generated" / "paper")
    for method in METHODS:
        yield Solver(f"CasADi CVODES, {method}", TOLERANCES, partial(_make, dae, method))


def _make(dae: dict[str, Any], method: str, tolerance: float, grid: Array) -> Callable[[], Array]:
    options: dict[str, Any] = {
        "abstol": tolerance,
        "reltol": tolerance,
        "linear_multistep_method": method,
        "max_num_steps": 1_000_000,
    }
    solver = ca.integrator("peer", "cvodes", dae, grid[0], grid[1:], options)
    return lambda: np.vstack([X0, solver(x0=X0)["xf"].full().T])
