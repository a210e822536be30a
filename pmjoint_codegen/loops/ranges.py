"""Estimates that stay in their ranges: which states they are, and how near an end they may come.

In exact arithmetic an estimate never reaches an end, where its gain vanishes. In doubles a step may carry it
across, by less than the tolerance; beyond, its gain has the other sign, and it would run away. So a step
ends inside.
"""

from __future__ import annotations

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.constants import RANGE_MARGIN
from pmjoint_codegen.manifest import Manifest

_HAT, _LOW, _HIGH = "_hat", "_low", "_high"


def ranged_states(manifest: Manifest) -> Array:
    """Index of each estimate with a range among the states, and of its ends among the parameters.

    Returns:
        Shape (estimates, 3).
    """
    names, found = manifest.parameter_names, []
    for place in range(*manifest.blocks.get("Theta", (0, 0))):
        name = manifest.states[place].name.removesuffix(_HAT)
        if f"{name}{_LOW}" in names:
            found.append((place, names.index(f"{name}{_LOW}"), names.index(f"{name}{_HIGH}")))
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def ranges_of(manifest: Manifest, p: Array) -> Array:
    """Index of each such state, and the least and greatest value that a step may end with.

    Args:
        manifest: of the model.
        p: parameters, shape (np,).

    Returns:
        Shape (estimates, 3).
    """
    found = ranged_states(manifest)
    low, high = p[found[:, 1].astype(int)], p[found[:, 2].astype(int)]
    margin = RANGE_MARGIN * (np.abs(low) + np.abs(high))
    return np.ascontiguousarray(np.column_stack([found[:, 0], low + margin, high - margin]))


def keep_in_ranges(ranges: Array, X: Array) -> None:
    """Put the states that a step has carried to an end of their range, or beyond, inside it."""
    for place, low, high in ranges.tolist():
        value = float(X[int(place)])
        X[int(place)] = low if value < low else high if value > high else value


def keep_rows_in_ranges(ranges: Array, rows: Array) -> None:
    """The same for output rows, shape (rows, nX): inside a step they have the step's own error."""
    for place, low, high in ranges.tolist():
        np.clip(rows[:, int(place)], low, high, out=rows[:, int(place)])
