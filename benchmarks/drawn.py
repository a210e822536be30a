"""The random runs of the sweeps that are measured, and our batch library's calls for them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.paper import HORIZON, X0, Array
from benchmarks.reference import ROOT
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.store import CHUNK_RUNS, PARTS, TAIL

Request = Callable[[float, slice, float], Runs]  # tolerance, which, horizon


@dataclass(frozen=True)
class Draw:
    """Random runs: x1 in +-20 rad, x2 in +-10 rad/s, d1 and b0 within 50 % and 20 % of the paper's."""

    x0: Array
    d1: Array
    b0: Array


def draw(runs: int) -> Draw:
    """Draw runs; the same for everybody."""
    random = np.random.default_rng(7)
    x0 = np.zeros((runs, len(X0)))
    x0[:, 0] = random.uniform(-20.0, 20.0, runs)
    x0[:, 1] = random.uniform(-10.0, 10.0, runs)
    return Draw(x0, random.uniform(0.1, 0.3, runs), random.uniform(1.6, 2.4, runs))


def library() -> BatchLibrary:
    """Return our batch loops for this machine."""
    return library_of(make_inputs(ROOT / "generated" / "paper"), os.environ)


def requests(batch: BatchLibrary, drawn: Draw) -> Request:
    """Return (tolerance, which, horizon) -> what the batch library takes."""
    manifest = batch.manifest
    p = np.tile(np.array([item.value for item in manifest.parameters]), (len(drawn.x0), 1))
    for name, values in (("d1", drawn.d1), ("b0", drawn.b0)):
        for column in (name, f"{name}_plant"):  # the controller knows the plant
            p[:, manifest.parameter_names.index(column)] = values

    def make(tolerance: float, which: slice, horizon: float) -> Runs:
        return Runs(
            x0=drawn.x0[which],
            p=p[which],
            horizon=horizon,
            tolerance=tolerance,
            sample_time=0.0,
            hold=np.empty((0, 0)),
            times=np.empty(0),
            divergence=1e9,
            max_steps=1_000_000,
        )

    return make


def chunks(runs: int) -> list[slice]:
    """Cut runs as `pmjoint sweep` does, its last chunks being short."""
    tail = max(0, runs // CHUNK_RUNS - TAIL) * CHUNK_RUNS
    starts = [*range(0, tail, CHUNK_RUNS), *range(tail, runs, CHUNK_RUNS // PARTS), runs]
    return [slice(*pair) for pair in pairwise(starts)]


def make_chunk(batch: BatchLibrary, request: Request, which: slice) -> None:
    """Make some of the runs."""
    batch.simulate(request(1e-6, which, HORIZON))
