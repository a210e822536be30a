"""The default limit on every state, beyond which a run is lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.pace import leading
from pmjoint_codegen.values import MATCHED, OBSERVER, ZERO, of_plant

DIVERGENCE: Final = 1e4  # in SI units of y; following a diverged run costs more than all before it
_USUAL_ORDER: Final = 2  # up to it, no state is much larger than y and its rate


def default_divergence(
    manifest: Manifest, values: Mapping[str, float], x0: Array, started: str = ZERO
) -> float:
    """The default limit on every |X_i|: 1e4, or more if a bounded run may need it.

    A pressure is at most P_max from P_0, a difference of two 2 P_max, both in Pa. The start is within it;
    a matched one has r_i of the size of ck^(i-1) y. The design's later states are as large as derivatives of
    y, and lambda is as large as these over b_m. Columns in mm or mV hold larger numbers than those in m or V.

    Args:
        manifest: the model.
        values: every parameter by name, as the kernels take it.
        x0: of the start's variables, shape (nx,).
        started: how the controller starts.
    """
    pressures = [item for item in manifest.states[: manifest.nx] if item.unit == "Pa"]
    start = 100.0 * max(map(abs, x0.tolist()), default=0.0)
    if started == MATCHED:
        rates = (values.get(f"ck{i}", 1.0) for i in range(1, manifest.rho + 1))  # a law may have none
        start *= max(1.0, *rates) ** (manifest.rho - 1)
    supply = 4.0 * of_plant(values, "P_max") if pressures and "P_max" in values else 0.0
    usual = DIVERGENCE * _derivatives(manifest, values) * max(1.0, 1.0 / abs(leading(manifest, values)))
    usual /= manifest.least_scale
    return min(max(usual, start, supply), float(np.finfo(np.float64).max))


def _derivatives(manifest: Manifest, values: Mapping[str, float]) -> float:
    """How much larger than y and its rate the design's states are: by the filters' bandwidth a derivative.

    Where a run starts in physical states, also by what one unit of these is in the design's.
    """
    n = manifest.n
    if OBSERVER in values:  # its last state is like derivative n of y
        return float(f"{max(1.0, values[OBSERVER]) ** n:.3g}")
    if n <= _USUAL_ORDER:
        return 1.0
    bandwidth = abs(values[f"k{n}"]) ** (1.0 / n)
    columns = {name: np.array([value]) for name, value in values.items()}
    points = np.vstack([np.zeros(manifest.nx), np.eye(manifest.nx)])
    states = manifest.start.states(points, columns)
    apart = np.abs(states[1:] - states[0])
    most = max(1.0, bandwidth ** (n - _USUAL_ORDER), apart[np.isfinite(apart)].max(initial=0.0))
    return float(f"{most:.3g}")  # a message names the limit
