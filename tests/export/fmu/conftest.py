"""Units of the paper's model, made once, and what FMPy sees of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.fmu.archive import PLATFORMS, Builder
from pmjoint_codegen.export.fmu.package import units
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import derive

ROOT = Path(__file__).resolve().parents[3]
PROBE = Path(__file__).with_name("probe.py")
STRICT = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wmissing-prototypes",
    "-Werror",
]
PATIENCE = 60.0  # s; a hanging unit is ended


@pytest.fixture(scope="session")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the four files, compiled without a warning."""
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    path = ROOT / "models" / "paper.toml"
    derivation = derive(model_of(read_document(path), str(path)))
    builder = Builder(PLATFORMS["x86_64-linux"], (*compiler.command, *STRICT))
    folder = tmp_path_factory.mktemp("units")
    for name, contents in units(derivation, Identity("paper", "0" * 64, "test"), DOUBLE, [builder]).items():
        (folder / name).write_bytes(contents)
    return folder


@cache
def _seen(folder: Path, version: int) -> dict[str, Any]:
    command = [sys.executable, str(PROBE), str(folder), str(version)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.fixture(params=[2, 3], ids=["FMI 2.0", "FMI 3.0"])
def seen(paper: Path, request: pytest.FixtureRequest) -> dict[str, Any]:
    """Return what FMPy sees of the paper's units."""
    pytest.importorskip("fmpy")
    return _seen(paper, request.param)
