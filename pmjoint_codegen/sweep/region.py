"""Which runs keep the joint bounded, and the border beyond which no controller can."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from pmjoint_codegen.loops.status import holds
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.blocks import blocks

if TYPE_CHECKING:
    import xarray as xr

ENDS: Final = ("status", "final_e", "max_abs_e", "final_saturated")  # arguments of `holds`, in the dataset


@dataclass(frozen=True)
class Border:
    """``|x1 + x2/slope| = offset``: outside, the limit is less than what the unstable mode may need.

    With the worst disturbance it does need more; with a helpful one of that size, the limit may be enough up
    to an offset of (b0 u_max + D_max)/d1.

    Attributes:
        slope: sqrt(d1), 1/s.
        offset: (b0 u_max - D_max)/d1, in the unit of x1.
    """

    slope: float
    offset: float


def border(manifest: Manifest, values: Mapping[str, float]) -> Border | None:
    """The border of the paper's plant, ``x1'' = d1 x1 + b0 u + d``, where ``d1 > 0``; None for other plants.

    Args:
        manifest: the model.
        values: the plant's values of the parameters that are the same in all runs.
    """
    needed = ("d1", "b0", manifest.limit)
    sizes = (manifest.n, manifest.m, manifest.nx, manifest.nw)
    if sizes != (2, 0, 2, 1) or manifest.leading != "b0" or any(name not in values for name in needed):
        return None
    d1, b0, limit = (values[name] for name in needed)
    if d1 <= 0:
        return None
    return Border(math.sqrt(d1), (abs(b0) * limit - (manifest.disturbance_bound or 0.0)) / d1)


def held(dataset: xr.Dataset) -> xr.DataArray:
    """Which runs of a dataset keep the joint bounded; see `holds`."""
    return dataset["status"].copy(data=holds(*(dataset[name].values for name in ENDS)))


def held_share(dataset: xr.Dataset) -> float:
    """Share of a dataset's runs that keep the joint bounded, from 0 to 1; read part by part."""
    lengths = dataset["status"].sizes
    held_runs = sum(
        int(held(dataset.isel(dict(zip(lengths, part.selection, strict=True)))).sum())
        for part in blocks(tuple(lengths.values()))
    )
    return held_runs / dataset["status"].size
