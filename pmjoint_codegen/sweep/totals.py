"""A finished sweep in a few numbers, read part by part: how runs ended, and quantiles of bounded runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.loops.metrics import REPORTED
from pmjoint_codegen.loops.status import holds
from pmjoint_codegen.sweep.blocks import blocks
from pmjoint_codegen.sweep.metrics import status_meanings
from pmjoint_codegen.sweep.region import ENDS
from pmjoint_codegen.sweep.validity import Mask

if TYPE_CHECKING:
    import zarr

PERCENTS: Final = {"p5": 5.0, "median": 50.0, "p95": 95.0}


@dataclass(frozen=True)
class Totals:
    """The outcome of all runs.

    Attributes:
        status: number of runs by how they ended, in words; only endings that occurred.
        held: number of runs that keep the joint bounded.
        quantiles: of these runs, by metric and by quantile; None if no run has the metric.
    """

    status: Mapping[str, int]
    held: int
    quantiles: Mapping[str, Mapping[str, float] | None]


def totals(dataset: Path) -> Totals:
    """Count and sort; memory holds one byte per run and one metric of the bounded runs at a time.

    Args:
        dataset: folder of ``sweep.zarr``.
    """
    import zarr

    arrays = {name: zarr.open_array(dataset / name, mode="r") for name in {*ENDS, *REPORTED}}
    shape = arrays["status"].shape
    held = np.zeros(arrays["status"].size, dtype=np.bool_)
    counts: Counter[int] = Counter()
    for part in blocks(shape):
        status, *ends = (np.asarray(arrays[name][part.selection]).reshape(-1) for name in ENDS)
        held[part.start : part.stop] = holds(status, *ends)
        values, numbers = np.unique(status, return_counts=True)
        counts.update(dict(zip(values.tolist(), numbers.tolist(), strict=True)))
    return Totals(
        status={words: counts[value] for value, words in status_meanings().items() if counts[value]},
        held=int(held.sum()),
        quantiles={name: _quantiles(arrays[name], held) for name in REPORTED},
    )


def _quantiles(array: zarr.Array[Any], held: Mask) -> Mapping[str, float] | None:
    """Quantiles of the finite values among the bounded runs."""
    values = np.empty(int(held.sum()))
    count = 0
    for part in blocks(array.shape):
        piece = np.asarray(array[part.selection]).reshape(-1)[held[part.start : part.stop]]
        piece = piece[np.isfinite(piece)]
        values[count : count + len(piece)] = piece
        count += len(piece)
    if not count:
        return None
    found = np.percentile(values[:count], list(PERCENTS.values()), overwrite_input=True)
    return dict(zip(PERCENTS, found.tolist(), strict=True))
