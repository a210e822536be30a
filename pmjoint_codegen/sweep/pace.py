"""How many runs of a sweep have a law that is too fast for their clock; see `simulate.pace`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from pmjoint_codegen.chain import SAMPLE_TIME
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.pace import LIMIT, deciding, paces, too_fast
from pmjoint_codegen.sweep.chunks import fill_in, periods_of
from pmjoint_codegen.sweep.plan import Plan
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.validity import valid_periods, valid_rows

MOST_JUDGED: Final = 2**17  # runs; of more, so many are drawn: half a second of eigenvalues


def too_fast_runs(manifest: Manifest, request: Request) -> str | None:
    """One line that counts the runs and speaks of the worst, or None if there are none.

    Args:
        manifest: the model.
        request: the sweep.
    """
    plan = _deciding(manifest, request.plan)
    if plan.runs <= MOST_JUDGED:
        return too_fast_among(manifest, request, plan.at(np.arange(plan.runs)), request.plan.runs)
    some = np.random.default_rng(0).integers(0, plan.runs, MOST_JUDGED)
    return too_fast_among(manifest, request, plan.at(some), request.plan.runs, "about ")


def too_fast_among(
    manifest: Manifest,
    request: Request,
    columns: Mapping[str, Array],
    stands_for: int | None = None,
    about: str = "",
) -> str | None:
    """The same line for runs with these values.

    Args:
        manifest: the model.
        request: settings of every run.
        columns: values of every varied name, shape (runs,); none for one run.
        stands_for: number of runs that these stand for, if there are more.
        about: put before their number, if these are a part of them.
    """
    if not request.sample_time:
        return None
    judged = len(next(iter(columns.values()), np.empty(1)))
    x0, p = fill_in(manifest, request, columns, judged)
    periods = periods_of(request, columns, judged)
    good = valid_rows(manifest, p, x0[:, : manifest.nx]) & valid_periods(manifest, request, p, periods)
    names = manifest.parameter_names
    pace = np.where(good, paces(manifest, dict(zip(names, p.T, strict=False)), periods), 0.0)
    count = int(np.sum(pace > LIMIT))
    if not count:
        return None
    worst = int(np.argmax(pace))
    line = too_fast(manifest, dict(zip(names, p[worst].tolist(), strict=False)), float(periods[worst]))
    if judged == 1:
        return line
    total = judged if stands_for is None else stands_for
    share = round(count / judged * total)
    return f"in {about}{share} of {total} runs the law may be too fast; in the worst, {line}"


def _deciding(manifest: Manifest, plan: Plan) -> Plan:
    """The part of a plan that varies what the rates depend on; every run of it stands for as many others."""
    names = deciding(manifest) | {SAMPLE_TIME}
    samples = plan.samples if any(item.name in names for item in plan.samples) else ()
    axes = tuple(axis for axis in plan.axes if axis.name in names)
    return replace(plan, axes=axes, samples=samples, draws=plan.draws if samples else 1)
