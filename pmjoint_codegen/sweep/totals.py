"""A finished sweep in a few numbers, read part by part: how runs ended, and quantiles of bounded runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.loops.metrics import REPORTED
from pmjoint_codegen.sweep.blocks import blocks
from pmjoint_codegen.sweep.metrics import HELD, status_meanings
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
        counts: how many of these runs have the metric: a run that has not settled has no settling time.
    """

    status: Mapping[str, int]
    held: int
    quantiles: Mapping[str, Mapping[str, float] | None]
    counts: Mapping[str, int]


def totals(dataset: Path) -> Totals:
    """Count and sort; memory holds one byte per run and one metric of the bounded runs at a time.

    Args:
        dataset: folder of ``sweep.zarr``.
    """
    import zarr

    names = {"status", HELD, *REPORTED}
    arrays = {name: zarr.open_array(dataset / name, mode="r") for name in names}
    shape = arrays["status"].shape
    held = np.zeros(arrays["status"].size, dtype=np.bool_)
    counts: Counter[int] = Counter()
    for part in blocks(shape):
        status, kept = (np.asarray(arrays[name][part.selection]).reshape(-1) for name in ("status", HELD))
        held[part.start : part.stop] = kept == 1
        values, numbers = np.unique(status, return_counts=True)
        counts.update(dict(zip(values.tolist(), numbers.tolist(), strict=True)))
    found = {name: _quantiles(arrays[name], held) for name in REPORTED}
    return Totals(
        status={words: counts[value] for value, words in status_meanings().items() if counts[value]},
        held=int(held.sum()),
        quantiles={name: quantiles for name, (quantiles, _) in found.items()},
        counts={name: count for name, (_, count) in found.items()},
    )


def _quantiles(array: zarr.Array[Any], held: Mask) -> tuple[Mapping[str, float] | None, int]:
    """Quantiles of the finite values among the bounded runs, and their number."""
    values = np.empty(int(held.sum()))
    count = 0
    for part in blocks(array.shape):
        piece = np.asarray(array[part.selection]).reshape(-1)[held[part.start : part.stop]]
        piece = piece[np.isfinite(piece)]
        values[count : count + len(piece)] = piece
        count += len(piece)
    if not count:
        return None, 0
    found = np.percentile(values[:count], list(PERCENTS.values()), overwrite_input=True)
    return dict(zip(PERCENTS, found.tolist(), strict=True)), count
