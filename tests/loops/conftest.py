"""Batch loops of a model, and runs for them."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.start import initial_state


def library(root: Path, cache: Path, model: str, level: str) -> BatchLibrary:
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("the batch loops are compiled")
    folder = root / "generated" / model
    levels = usable_levels({"PMJOINT_VECTOR_LEVEL": level})
    return batch.load(batch.batch_sources(folder), Manifest.read(folder), levels, compiler, cache)


def make_runs(library: BatchLibrary, count: int, seed: int = 0, **changes: object) -> Runs:
    """Random initial states, parameters and plants around the model's own, which run 0 has."""
    manifest, generator = library.manifest, np.random.default_rng(seed)
    own = np.array([item.value for item in manifest.parameters])
    p = own * generator.uniform(0.9, 1.1, (count, len(own)))
    switch = manifest.parameter_names.index("compensator")
    p[:, switch] = own[switch]
    x0 = np.zeros((count, manifest.nX))
    size = max(abs(value) for value in manifest.simulation.x0)
    x0[:, : manifest.nx] = generator.uniform(-5 * size, 5 * size, (count, manifest.nx))
    p[0], x0[0, : manifest.nx] = own, manifest.simulation.x0
    runs = Runs(x0, p, manifest.simulation.horizon, 1e-8, 0.0, np.empty((0, 0)), np.empty(0), 1e6, 100_000)
    return replace(runs, **changes)  # type: ignore[arg-type]


def designed(library: BatchLibrary, runs: Runs) -> Runs:
    """The runs with x0 taken as physical states, as a single run takes them."""
    manifest, x0 = library.manifest, runs.x0.copy()
    loop = ClosedLoop.load(manifest.name)
    for i, values in enumerate(runs.p.tolist()):
        p = dict(zip(manifest.parameter_names, values, strict=True))
        settings = make_settings(manifest, parameters=p, x0=runs.x0[i, : manifest.nx])
        x0[i] = initial_state(loop.evaluator, settings)
    return replace(runs, x0=x0)


def sampled(library: BatchLibrary, runs: Runs, sample_time: float) -> Runs:
    loop = ClosedLoop.load(library.manifest.name)
    hold = np.array([hold_matrices(loop.evaluator, p, sample_time) for p in runs.p])
    return replace(runs, sample_time=sample_time, hold=hold)
