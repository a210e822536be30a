"""A design before and after, on every plant: metrics for the table, trajectories for the figure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.metrics import REPORTED, Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.metrics import quantities, settled
from pmjoint_codegen.sweep.pace import too_fast_among
from pmjoint_codegen.tune.cost import CostFunction, cross
from pmjoint_codegen.tune.request import Request
from pmjoint_codegen.tune.search import Found, own_gains

MOST_DRAWN: Final = 40  # plants in a figure
ROWS: Final = 1500  # of a trajectory in a figure
TRANSIENT: Final = (1 / 40, 1 / 4)  # of the horizon: the least and the most that is enlarged


@dataclass(frozen=True)
class Comparison:
    """Both designs on every plant, the model's own plant first.

    Attributes:
        manifest: the model.
        request: of the tuning.
        found: the result of the search.
        before: gains of the model.
        metrics: shape (2, plants, columns): before, after.
    """

    manifest: Manifest
    request: Request
    found: Found
    before: Mapping[str, float]
    metrics: Array

    __repr__ = brief


@dataclass(frozen=True)
class Traces:
    """Trajectories of both designs.

    Attributes:
        t: s, shape (rows,).
        v: shape (2, plants, rows).
        e: shape (2, plants, rows).
    """

    t: Array
    v: Array
    e: Array

    __repr__ = brief


def compare(costing: CostFunction, found: Found) -> Comparison:
    """Simulate both designs on every plant."""
    before = own_gains(costing)
    metrics = costing.metrics(_both(before, found.gains))
    return Comparison(costing.library.manifest, costing.request, found, before, metrics)


def too_fast_plants(comparison: Comparison) -> str | None:
    """One line if the gains found are too fast for the clock on some plants, which may vary it; or None."""
    request = comparison.request
    gains = {name: np.array([value]) for name, value in comparison.found.gains.items()}
    return too_fast_among(comparison.manifest, request.runs, cross(gains, request.plants))


def _both(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, Array]:
    return {name: np.array([value, after[name]]) for name, value in before.items()}


def traces(costing: CostFunction, comparison: Comparison, until: float) -> Traces:
    """Trajectories from 0 to `until`, s."""
    request = costing.request
    runs = replace(request.runs, horizon=until, output_step=until / ROWS)
    plants = {name: values[:MOST_DRAWN] for name, values in request.plants.items()}
    count = min(request.count, MOST_DRAWN)
    columns = cross(_both(comparison.before, comparison.found.gains), plants)
    rows = simulate_chunk(costing.library, runs, columns).trajectories
    rows = rows.reshape(2, count, -1, rows.shape[-1])
    return Traces(runs.times(), rows[..., -2], rows[..., -1])


def transient(comparison: Comparison) -> float:
    """Length of the enlarged beginning, s: three times the saturation, within bounds."""
    horizon = comparison.request.runs.horizon
    saturated = np.nan_to_num(comparison.metrics[:, 0, Column.SATURATED_S])
    low, high = TRANSIENT
    return float(min(max(3 * float(np.max(saturated)), low * horizon), high * horizon))


def summary_table(comparison: Comparison) -> dict[str, Any]:
    """The tuning in plain data."""
    request, found = comparison.request, comparison.found
    return {
        "model": comparison.manifest.name,
        "model_hash": comparison.manifest.model_hash,
        "objective": request.objective.text,
        "over": request.over if request.count > 1 else None,
        "max_v": request.max_v,
        "plants": request.count,
        "perturbed": [
            f"{item.name}~{item.law}({item.first:g},{item.second:g})" for item in request.drawn.samples
        ],
        "seed": request.seed,
        "designs": found.designs,
        "generations": found.generations,
        "settled": found.settled,
        "at_a_bound": found.edges,
        "gains": {
            name: {"before": comparison.before[name], "after": found.gains[name]}
            for name in comparison.before
        },
        "nominal": _side(comparison.metrics[:, :1], comparison),
        "mean": _side(comparison.metrics, comparison, np.mean),
        "worst": _side(comparison.metrics, comparison),
        "units": {item.name: item.unit for item in quantities(comparison.manifest) if item.name in REPORTED},
        "lost": dict(zip(("before", "after"), _lost(comparison.metrics), strict=True)),
    }


def _side(
    metrics: Array, comparison: Comparison, reduced: Callable[..., Array] = np.max
) -> dict[str, dict[str, float]]:
    """Largest value, or mean, of the objective and of every metric over some plants, before and after."""
    done = metrics[..., Column.STATUS] == Status.DONE
    values = {"objective": comparison.request.objective(metrics)}
    values |= {name: metrics[..., column] for name, column in REPORTED.items()}
    values["settling_s"] = settled(metrics, comparison.request.runs.horizon)
    both = {name: reduced(np.where(done, value, np.nan), axis=1) for name, value in values.items()}
    return {name: {"before": float(pair[0]), "after": float(pair[1])} for name, pair in both.items()}


def _lost(metrics: Array) -> list[int]:
    """Number of plants that do not reach the horizon, before and after."""
    return np.sum(metrics[..., Column.STATUS] != Status.DONE, axis=1).tolist()  # type: ignore[no-any-return]
