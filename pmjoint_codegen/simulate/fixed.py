"""The constants of a run that follow from the model, its controller and the tolerance alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pmjoint_codegen.loops import quadrature
from pmjoint_codegen.loops.guard import HOLD_RATIOS, discs, hold_factors
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.record import reports_rate
from pmjoint_codegen.values import SETTLED


def fixed_constants(manifest: Manifest, *, sampled: bool, tolerance: float) -> dict[str, Any]:
    """Fields of a `Problem` by name: those that no parameter, start, horizon or sample time changes.

    Args:
        manifest: the model.
        sampled: whether the controller is.
        tolerance: local error, relative to max(1, |value|).
    """
    order, hold_order = (manifest.plant_order, manifest.hold_order) if sampled else (manifest.order, 0)
    guard = manifest.guards["plant_taylor" if sampled else "taylor"]
    around = discs(guard, tolerance)
    rule = quadrature.long_steps()
    return {
        "n_plant": manifest.nx,
        "n_states": manifest.nX,
        "n_channels": (manifest.nx + 1 if sampled else manifest.nX + 2) + len(manifest.kinks),
        "n_rates": manifest.nx if sampled else manifest.nX,
        "n_kinks": len(manifest.kinks),
        "n_actuated": manifest.nw,
        "order": order,
        "nodes": np.array(rule.nodes),
        "weights": np.array(rule.weights),
        "n_nodes": len(rule.nodes),
        "n_searched": manifest.nX + 2,
        "notes_rate": int(reports_rate(manifest)),
        "inside": np.array(guard.inside),
        "n_inside": len(guard.inside),
        "lebesgue": guard.lebesgue,
        "ratios": np.array(around.ratios),
        "factors": np.array(around.factors),
        "n_ratios": len(around.ratios),
        "settled": SETTLED,
        "hold_ratios": np.array(HOLD_RATIOS),
        "hold_rate_factors": np.array(hold_factors(hold_order)),
        "hold_value_factors": np.array(hold_factors(hold_order + 1)),
        "n_hold_ratios": len(HOLD_RATIOS),
        "tolerance": tolerance,
        "safety": _safety(order),
        "hold_fraction": _hold_fraction(hold_order, tolerance) if sampled else 0.0,
    }


def _safety(order: int) -> float:
    """Factor on a step of Taylor polynomials of an order; Jorba and Zou (2005)."""
    return math.exp(-0.7 / (order - 1))


def _hold_fraction(order: int, tolerance: float) -> float:
    """`Problem.hold_fraction`: terms fall to the tolerance at the last order, what follows lies below it."""
    return _safety(order) * math.pow(tolerance, 1.0 / order)
