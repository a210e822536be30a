"""The paper's model, with its batch library."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs


@pytest.fixture(scope="session")
def paper(root: Path) -> Manifest:
    """The manifest of the paper's model."""
    return Manifest.read(root / "generated" / "paper")


@pytest.fixture(scope="session")
def library(root: Path) -> BatchLibrary:
    """Its batch library."""
    if find_compiler(os.environ) is None:
        pytest.skip("the batch loops are compiled")
    return library_of(make_inputs(root / "generated" / "paper"), os.environ)
