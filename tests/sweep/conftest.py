"""A small sweep of the paper's model."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.build_inputs import BuildInputs, library_of, make_inputs
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import Request, make_request
from pmjoint_codegen.sweep.store import Store


@dataclass(frozen=True)
class Case:
    """A model's manifest, inputs and library, and a request."""

    manifest: Manifest
    inputs: BuildInputs
    library: BatchLibrary
    request: Request


@pytest.fixture(scope="session")
def case(root: Path) -> Case:
    """6150 short runs: four chunks, some of them invalid, some diverging."""
    if find_compiler(os.environ) is None:
        pytest.skip("the batch loops are compiled")
    folder = root / "generated" / "paper"
    manifest = Manifest.read(folder)
    grid = ("x1=-120:120:41", "c1=-1,15,20", "compensator=0,1")
    plan = make_plan(grid, ("b0~normal(2,0.2)",), 25, 3, "sobol")
    inputs = make_inputs(folder)
    return Case(
        manifest,
        inputs,
        library_of(inputs, os.environ),
        make_request(manifest, plan, horizon=2.0, divergence=300.0),
    )


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def sweep(case: Case, folder: Path, *, threads: int = 1, scheduler: str | None = None) -> Store:
    store = Store(folder, case.request, case.manifest.nX)
    store.open()
    execute(store, case.inputs, threads=threads, scheduler=scheduler, tell=lambda done: None)
    from pmjoint_codegen.sweep import dataset

    dataset.assemble(store, case.manifest)
    return store


@pytest.fixture(scope="session")
def reference(case: Case, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The dataset, made in one thread without interruption."""
    store = sweep(case, tmp_path_factory.mktemp("reference"))
    assert len(store.starts()) > 2
    return files(store.dataset)
