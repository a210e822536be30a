"""Where a run counts as lost: the default limit on its states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.values import MATCHED, ZERO, of_plant

DIVERGENCE: Final = 1e4  # in the states' units; following a diverged run costs more than all before it


def default_divergence(
    manifest: Manifest, values: Mapping[str, float], x0: Array, started: str = ZERO
) -> float:
    """The default limit on every |X_i|: 1e4, or more if a bounded run may need it.

    A pressure is at most P_max from P_0, a difference of two 2 P_max, both in Pa. The start is within it;
    a matched one has r_i of the size of ck^(i-1) y. The filter lambda follows u, which may be in Pa. Physical
    states of order one reach the design's coordinates by way of a transformation, which may be steep.
    """
    pressures = [item for item in manifest.states[: manifest.nx] if item.unit == "Pa"]
    start = 100.0 * max(map(abs, x0.tolist()), default=0.0)
    if started == MATCHED:
        start *= max(1.0, *(values[f"ck{i}"] for i in range(1, manifest.rho + 1))) ** (manifest.rho - 1)
    supply = 4.0 * of_plant(values, "P_max") if pressures and "P_max" in values else 0.0
    inputs = 10.0 * max(map(abs, manifest.limits(values)))
    found = (DIVERGENCE, start, supply, inputs, 100.0 * _steepness(manifest, values))
    return min(max(found), float(np.finfo(np.float64).max))


def _steepness(manifest: Manifest, values: Mapping[str, float]) -> float:
    """The largest coordinate of the design where one physical state is 1; 0 if states are coordinates."""
    if manifest.start.terms == manifest.start.names:
        return 0.0
    columns = {name: np.full(manifest.nx, value) for name, value in values.items()}
    sizes = np.abs(manifest.start.states(np.eye(manifest.nx), columns))
    return float(np.max(sizes, initial=0.0, where=np.isfinite(sizes)))
