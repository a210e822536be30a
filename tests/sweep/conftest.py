"""A small sweep of the paper's model."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest

from pmjoint_codegen.build.compiler import find_compiler
from pmjoint_codegen.kernels.batch import BatchLibrary
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.kit import Kit, library_of, make_kit
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import Request, make_request


@dataclass(frozen=True)
class Case:
    """A model's manifest, kit and library, and a request."""

    manifest: Manifest
    kit: Kit
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
    kit = make_kit(folder)
    return Case(
        manifest,
        kit,
        library_of(kit, os.environ),
        make_request(manifest, plan, horizon=2.0, divergence=300.0),
    )
