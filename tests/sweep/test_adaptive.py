"""Sweeps of models with estimates: true values move, guesses stay, and lanes are the single runs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.loops.logits import reported_states
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize(
    ("model", "grid"), [("paper-adaptive", "d1=-1,0.2,2"), ("joint-load", "w=-20,-2,30")]
)
def test_lanes_are_single_runs_that_start_from_the_same_guesses(
    root: Path, model: str, grid: str, controller: str
) -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("the lanes are compiled")
    folder = root / "generated" / model
    manifest, loop = Manifest.read(folder), ClosedLoop.load(model)
    library = library_of(make_inputs(folder), os.environ)
    plan = make_plan((grid,), (), None, 0, "latin-hypercube")
    asked = {"horizon": 2.0, "output_step": 0.5, "tolerance": 1e-12, "controller": controller}
    request = make_request(manifest, plan, **asked)  # type: ignore[arg-type]  # of several kinds
    columns = plan.columns(0, plan.runs)
    found = simulate_chunk(library, request, columns).trajectories[:, :, : manifest.nX]
    names = reported_states(manifest)
    name = grid.partition("=")[0]
    first, last = manifest.blocks["Theta"]
    for lane, value in zip(found, columns[name].tolist(), strict=True):
        run = loop.simulate(parameters={name: value}, **asked)  # type: ignore[arg-type]
        guesses = [run.settings.parameters[f"{item[:-4]}_guess"] for item in names[first:last]]
        assert lane[0, first:last].tolist() == guesses
        assert (
            run.settings.parameters[f"{name}_guess"]
            == loop.simulate(horizon=0.01).settings.parameters[f"{name}_guess"]
        )
        single = np.column_stack([run[item] for item in names])
        size = np.maximum(1.0, np.max(np.abs(single), axis=0))
        assert np.max(np.abs(lane - single) / size) < 1e-8
    assert np.ptp(found[:, -1, first:last], axis=0).max() > 1e-3  # each learns something else
