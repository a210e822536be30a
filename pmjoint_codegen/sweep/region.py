"""Which runs keep the joint bounded, and the border beyond which no controller can."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.blocks import blocks
from pmjoint_codegen.sweep.metrics import HELD
from pmjoint_codegen.values import Rule, evaluate

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Border:
    """``|x1 + x2/slope| = offset``: outside, the limit is less than what the unstable mode may need.

    With the worst disturbance it does need more; with a helpful one of that size, the limit may be enough up
    to an offset of (|b_0| u_max + D_max)/slope^2.

    Attributes:
        slope: the unstable pole, 1/s: sqrt(a_2) where a_1 = 0.
        offset: (|b_0| u_max - D_max)/slope^2, in the unit of x1.
    """

    slope: float
    offset: float


def border(manifest: Manifest, values: Mapping[str, float]) -> Border | None:
    """The border of a plant ``x1' = x2 + a_1 x1, x2' = a_2 x1 + b_0 u + d`` with one unstable pole.

    q = x1 + x2/slope obeys ``q' = slope q + (b_0 u + d)/slope``, whatever a_1 is.

    Args:
        manifest: the model.
        values: the plant's values of the parameters that are the same in all runs.

    Returns:
        None for other plants, for a limit that differs to both sides, and where a value that it needs varies.
    """
    rule = Rule("linear", "finite", manifest.linear, "", "")
    needed = {*rule.names & {*manifest.parameter_names}, *manifest.limit_parameters}
    if not manifest.linear or any(name not in values for name in needed):
        return None
    lower, upper = manifest.limits(values)
    columns = {name: np.array([values[name]]) for name in needed}
    a_1, a_2, b_0 = (float(np.ravel(evaluate(tree, columns))[0]) for tree in rule.trees)
    if a_2 <= 0 or lower != -upper:  # the product of the poles is -a_2
        return None
    slope = (a_1 + math.sqrt(a_1**2 + 4 * a_2)) / 2
    square = a_2 + a_1 * slope  # of the pole, without rounding where a_1 = 0
    return Border(slope, (abs(b_0) * upper - (manifest.disturbance_bound or 0.0)) / square)


def held(dataset: xr.Dataset) -> xr.DataArray:
    """Which runs of a dataset keep the joint bounded, by its variable; the rule is `holds`."""
    return dataset[HELD] == 1


def held_share(dataset: xr.Dataset) -> float:
    """Share of a dataset's runs that keep the joint bounded, from 0 to 1; read part by part."""
    lengths = dataset["status"].sizes
    held_runs = sum(
        int(held(dataset.isel(dict(zip(lengths, part.selection, strict=True)))).sum())
        for part in blocks(tuple(lengths.values()))
    )
    return held_runs / dataset["status"].size
