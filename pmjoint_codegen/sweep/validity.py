"""The rules of :mod:`pmjoint_codegen.values` for many designs at once: which rows of p a sweep may simulate.

A draw from a normal distribution may make a gain negative: such a run is marked, not computed, and the sweep
    continues.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.chain import MOST_WAITING
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.values import (
    COMPENSATOR,
    INPUT_SCALE,
    OBSERVER,
    filter_gains,
    hurwitz_rows,
    obeys,
    positive_gains,
)

Mask = npt.NDArray[np.bool_]


def valid_rows(manifest: Manifest, p: Array, x0: Array) -> Mask:
    """Which runs satisfy all rules of the design.

    Args:
        manifest: the model.
        p: parameters, shape (runs, np).
        x0: initial plant states, shape (runs, nx).
    """
    column = {name: p[:, i] for i, name in enumerate(manifest.parameter_names)}
    good = np.all(np.isfinite(p), axis=1) & np.all(np.isfinite(x0), axis=1)
    for name in (
        *(name for name in (*positive_gains(manifest.rho), OBSERVER) if name in column),
        INPUT_SCALE,
        *([manifest.limit] if manifest.limit in column else []),
    ):
        good &= column[name] > 0
    if manifest.leading in column:
        good &= column[manifest.leading] != 0
    good &= np.isin(column[COMPENSATOR], (0.0, 1.0))
    for rule in manifest.rules:
        good &= obeys(rule, column)
    k = [column[name] for name in filter_gains(manifest.n) if name in column]
    result: Mask = good & _hurwitz(np.column_stack(k), good) if k else good
    return result


def valid_periods(manifest: Manifest, request: Request, p: Array, periods: Array) -> Mask:
    """Which runs have a clock that a run may have: see `make_settings` for the rules."""
    if not request.sample_time:
        return np.ones(len(p), dtype=bool)
    good: Mask = np.isfinite(periods) & (periods > 0) & (periods <= request.horizon)

    def column(key: str) -> Array:
        name = manifest.chain.get(key)
        return np.zeros(len(p)) if name is None else p[:, manifest.parameter_names.index(name)]

    good &= ("jitter" not in manifest.chain) | (column("jitter") < periods)
    good &= column("delay") <= MOST_WAITING * periods
    return good & (column("delay_samples") <= MOST_WAITING)


def _hurwitz(k: Array, among: Mask) -> Mask:
    """Whether ``s^n + k_1 s^(n-1) + ... + k_n`` is Hurwitz, row by row.

    Positive coefficients are necessary, and up to n = 2 sufficient.
    """
    result: Mask = among & np.all(k > 0, axis=1)
    if k.shape[1] <= 2:
        return result
    result[result] = hurwitz_rows(np.insert(k[result], 0, 1.0, axis=1))
    return result
