"""What a simulation of an unchanged model loads: the runtime alone, so that it starts fast."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pmjoint_codegen.compile.compiler import find_compiler

PROGRAM = """
import json, sys
from pmjoint_codegen.cli.main import run
code = run(sys.argv[1:])
print(json.dumps([code, sorted({name.partition(".")[0] for name in sys.modules})]))
"""


def loaded(root: Path, *arguments: str) -> set[str]:
    """Run one command line in a fresh interpreter and return the top-level packages that it loaded."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, cwd=root, stdin=subprocess.DEVNULL
    )
    code, names = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stderr
    return set(names)


@pytest.mark.skipif(find_compiler(os.environ) is None, reason="no C compiler: CasADi interprets the kernels")
def test_simulate_loads_no_symbolic_tool(root: Path, tmp_path: Path) -> None:
    names = loaded(root, "simulate", "paper", "--horizon", "0.1", "--no-figures", "--out", str(tmp_path))
    assert "numpy" in names
    assert names.isdisjoint({"sympy", "casadi", "pint", "pydantic", "matplotlib", "scipy", "pmjoint_derive"})


@pytest.mark.skipif(find_compiler(os.environ) is None, reason="a sweep needs a compiler")
def test_a_sweep_without_figures_writes_its_dataset_without_xarray(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    grid = ("--grid", "x1=0,1", "--horizon", "0.1")
    names = loaded(root, "sweep", "paper", *grid, "--no-figures", "--out", str(tmp_path))
    assert "zarr" in names
    assert names.isdisjoint({"xarray", "pandas", "dask", "matplotlib", "scipy", "sympy", "casadi"})


@pytest.mark.parametrize("arguments", [["--help"], ["simulate", "--help"], ["--version"]])
def test_help_loads_no_array_library(root: Path, arguments: list[str]) -> None:
    assert loaded(root, *arguments).isdisjoint(
        {"numpy", "sympy", "casadi", "pydantic", "matplotlib", "scipy"}
    )
