"""A new metric is one row: in a copy of the package that has one more, a sweep reports it everywhere."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import zarr

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="the batch loops are compiled")

BEHIND = "\n\nREPORTED"
ROW = """
    ISV = Row(
        "{v}^2 s",
        "integral of v^2",
        added="step->h * pmj_mean_square(step->v, step->v_degree)",
        words="integral of $v^2$",
        logarithmic=True,
        mapped=True,
    )
"""
COMPARED = {"continuous": 1e-3, "sampled": 1e-9}  # three nodes a step; v is constant over a hold


@pytest.fixture(scope="module")
def package(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the package in which the row stands."""
    folder = tmp_path_factory.mktemp("package")
    unwanted = shutil.ignore_patterns("__pycache__")
    shutil.copytree(root / "pmjoint_codegen", folder / "pmjoint_codegen", ignore=unwanted)
    table = folder / "pmjoint_codegen" / "loops" / "metrics.py"
    text = table.read_text(encoding="utf-8")
    assert text.count(BEHIND) == 1
    table.write_text(text.replace(BEHIND, ROW + BEHIND), encoding="utf-8")
    return folder


def command(package: Path, root: Path, *arguments: str) -> str:
    """What the copy's command prints."""
    env = {**os.environ, "PYTHONPATH": str(package)}
    line = [sys.executable, "-P", "-m", "pmjoint_codegen", *arguments]
    return subprocess.run(line, cwd=root, env=env, check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize("controller", COMPARED)
def test_a_row_shows_in_dataset_totals_and_map(
    controller: str, package: Path, root: Path, tmp_path: Path
) -> None:
    axes = ("--grid", "x1=-1,1.5", "--grid", "x2=0,1")
    common = ("--controller", controller, "--horizon", "2", "--json", "--out", str(tmp_path))
    found = json.loads(command(package, root, "sweep", "paper", *axes, *common))
    assert found["units"]["isv"] == "V^2 s"
    assert (tmp_path / "map_isv.png").stat().st_size > 0
    kept = zarr.open_array(tmp_path / "sweep.zarr" / "isv", mode="r")
    assert kept.attrs["long_name"] == "integral of v^2"
    values = np.sort(np.asarray(kept).ravel())
    median = found["quantiles_of_held"]["isv"]["median"]
    assert found["held"] == 4 and median == pytest.approx(float(np.median(values)))
    run = ClosedLoop.load("paper").simulate(
        x0=(1.5, 1.0),
        controller=controller,
        horizon=2.0,
        output_step=1e-3 if controller == "sampled" else 1e-4,
    )
    v, step = run["v"], float(run.t[1])
    wanted = np.sum(v[:-1] ** 2) * step if controller == "sampled" else np.trapezoid(v**2, dx=step)
    assert np.min(np.abs(values - wanted)) <= COMPARED[controller] * wanted


def test_a_row_may_be_tuned_for(package: Path, root: Path) -> None:
    assert "isv" in command(package, root, "tune", "--help")
