"""From the values of some runs to their results: one call of the batch library."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.chain import DEAD_ZONE, SAMPLE_TIME
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.loops.chain import chain_rows, first_readings, is_looped
from pmjoint_codegen.loops.hold import exponentials
from pmjoint_codegen.loops.logits import put_estimates
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.metrics import INVALID
from pmjoint_codegen.sweep.plan import CODES, SATURATION
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.validity import valid_periods, valid_rows
from pmjoint_codegen.values import BRAKING, CLIP, COMPENSATOR, MATCHED, SI, all_to_si

LINEAR: Final = 1e100  # share of the limit: (r_1/l)^2 is then lost in 1 + (r_1/l)^2, and g is (23)'s c_k1 r_1


@dataclass(frozen=True)
class Result:
    """Some runs of a sweep.

    Attributes:
        table: shape (runs, metrics + nX), metrics and final states.
        trajectories: shape (runs, instants, nX + 2), X, v, e.
    """

    table: Array
    trajectories: Array

    __repr__ = brief


def simulate_chunk(library: BatchLibrary, request: Request, columns: Mapping[str, Array]) -> Result:
    """Simulate some runs.

    Args:
        library: of the model; several threads may share it.
        request: the sweep.
        columns: values of every varied name in the model file's units, shape (runs,).
    """
    manifest = library.manifest
    x0, p = fill_in(manifest, request, columns)
    count, rows = len(p), request.instants
    table = np.full((count, len(Column) + manifest.nX), np.nan)
    trajectories = np.full((count, rows, manifest.nX + 2), np.nan)
    table[:, Column.STATUS] = INVALID
    periods = periods_of(request, columns, count)
    valid = valid_rows(manifest, p, x0[:, : manifest.nx]) & valid_periods(manifest, request, p, periods)
    for period in np.unique(periods[valid]).tolist():  # the runs of one call have one clock
        among = valid & (periods == period)
        runs = _runs(library, request, x0[among], p[among], period)
        if request.start == MATCHED:
            y = first_readings(runs.chain, runs.x0[:, 0]) if runs.looped else runs.x0[:, 0]
            runs.x0[:, manifest.nx :] = library.starts(y, runs.p)
        outcome = library.simulate(runs)
        put_estimates(manifest, runs.p, outcome.final)
        put_estimates(manifest, runs.p, outcome.trajectories[..., : manifest.nX])
        table[among, : len(Column)] = outcome.metrics
        table[among, len(Column) :] = outcome.final
        trajectories[among] = outcome.trajectories
    return Result(table, trajectories)


def periods_of(request: Request, columns: Mapping[str, Array], count: int) -> Array:
    """The sample time of every run, s; 0 for the continuous controller."""
    if request.sample_time and SAMPLE_TIME in columns:
        return columns[SAMPLE_TIME]
    return np.full(count, request.sample_time)


def fill_in(
    manifest: Manifest, request: Request, columns: Mapping[str, Array], count: int | None = None
) -> tuple[Array, Array]:
    """X(0) with the controller at rest, and p: the fixed values with the varied ones put in.

    The plant's own parameters equal the controller's unless they are set or varied.

    Args:
        manifest: the model.
        request: the sweep.
        columns: values of every varied name, shape (runs,).
        count: number of runs; needed where nothing varies.

    Returns:
        Shapes (runs, nX) and (runs, np).
    """
    count = len(next(iter(columns.values()))) if count is None else count
    x0 = np.zeros((count, manifest.nX))
    given = np.tile(np.array(request.x0), (count, 1))
    p = np.tile(np.array(request.p), (count, 1))
    states = manifest.start.names
    for name, values in columns.items():
        if name in (SATURATION, SAMPLE_TIME):
            continue
        if name in states:
            given[:, states.index(name)] = values
        else:
            p[:, manifest.parameter_names.index(name)] = all_to_si(values, manifest.scales.get(name, SI))
    if SATURATION in columns:
        _saturate(manifest, p, columns[SATURATION])
    for own, name in manifest.own.items():
        if own not in columns and own not in request.own:
            p[:, manifest.parameter_names.index(own)] = p[:, manifest.parameter_names.index(name)]
    # After every parameter is set: the plant's states at x0 depend on the plant's own values.
    by_name = dict(zip(manifest.parameter_names, p.T, strict=False))
    x0[:, : manifest.nx] = manifest.start.states(given, by_name)
    x0[:, manifest.nx :] = manifest.start.at_rest(by_name, count)
    return x0, p


def _saturate(manifest: Manifest, p: Array, codes: Array) -> None:
    """Set the switch, and let those that are not to brake reckon with any limit, which makes them linear."""
    names = manifest.parameter_names
    p[:, names.index(COMPENSATOR)] = codes != CODES[CLIP]
    if BRAKING in names:
        p[codes == CODES[COMPENSATOR], names.index(BRAKING)] = LINEAR


def _runs(library: BatchLibrary, request: Request, x0: Array, p: Array, sample_time: float) -> Runs:
    manifest = library.manifest
    columns = dict(zip(manifest.parameter_names, p.T, strict=False))  # p ends with the reference's segment
    sampled, valve = bool(sample_time) and is_looped(manifest), DEAD_ZONE in manifest.chain
    breaks, segments = request.segments
    return Runs(
        x0=x0,
        p=p,
        horizon=request.horizon,
        tolerance=request.tolerance,
        sample_time=sample_time,
        hold=hold_matrices(library, p, sample_time) if sample_time else np.empty((0, 0)),
        times=request.times(),
        divergence=request.divergence,
        max_steps=request.max_steps,
        max_step=math.inf if request.max_step is None else request.max_step,
        breaks=breaks,
        segments=segments,
        chain=chain_rows(manifest, columns, sample_time or 1.0) if sampled or valve else np.empty((0, 0)),
        looped=sampled,
    )


def hold_matrices(library: BatchLibrary, p: Array, sample_time: float) -> Array:
    """``expm(A T)`` and its integral over the hold, of A0 (14) and Ar (23); as in `loops.hold`.

    Returns:
        Shape (1, 2 n^2 + 2 rho^2) if all runs have the same gains, else (runs, 2 n^2 + 2 rho^2).
    """
    rows = library.matrices(p)
    if np.array_equal(rows[1:], rows[:-1]):
        rows = rows[:1]
    split = library.manifest.function("filter_matrix").outputs[0][1]
    return np.concatenate(
        [exponentials(part, sample_time) for part in np.split(rows, [split], axis=1)], axis=1
    )
