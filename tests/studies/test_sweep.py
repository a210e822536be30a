"""`pmjoint_codegen.sweep(...)`: the command's dataset in one call."""

from __future__ import annotations

import inspect
import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pmjoint_codegen
from pmjoint_codegen import ClosedLoop, UsageError, sweep
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="sweeps need a compiler")


def test_the_numbers_are_those_of_the_command_line(tmp_path: Path) -> None:
    options = ["--grid", "x1=-1:1:5", "--grid", "compensator=0,1", "--sample", "b0~normal(2,0.2)"]
    more = ["--runs", "3", "--seed", "7", "--horizon", "3", "--set", "c1=20", "--no-figures"]
    assert run(["sweep", "paper", *options, *more, "--out", str(tmp_path / "a")]) == 0
    from pmjoint_codegen.sweep.dataset import read

    there = read(tmp_path / "a" / "sweep.zarr")
    here = sweep(
        "paper",
        grid={"x1": np.linspace(-1, 1, 5), "compensator": [False, True]},
        sample={"b0": "normal(2, 0.2)"},
        runs=3,
        seed=7,
        horizon=3.0,
        parameters={"c1": 20},
    )
    assert here.identical(there.load())
    assert dict(here.sizes) == {"x1": 5, "compensator": 2, "draw": 3}
    assert float(here["ise"].max() - here["ise"].min()) > 0.01


def test_a_run_is_that_of_simulate_for_a_loop_with_its_own_options() -> None:
    loop = ClosedLoop.load("paper", reference="0.5*sin(2*t)", disturbance=["0", "0.1"])
    data = sweep(loop, grid={"c1": [10, 20]}, horizon=4.0, x0=[1.0, 0.0], threads=1)
    single = loop.simulate(parameters={"c1": 20}, horizon=4.0, x0=[1.0, 0.0])
    assert data.attrs["reference"] == "0.5*sin(2*t)"  # as written
    assert data["ise"].sel(c1=20).item() == pytest.approx(single.ise, rel=1e-5)
    assert data["max_abs_v"].sel(c1=20).item() == pytest.approx(single.peaks["v"][0], rel=1e-5)


def test_a_folder_holds_the_dataset_and_resumes(tmp_path: Path) -> None:
    seen: list[float] = []
    asked: dict[str, Any] = {
        "grid": ["c1=5:25:3"],
        "horizon": 1.0,
        "formats": ("parquet",),
        "out": tmp_path / "s",
    }
    first = sweep("paper", **asked, progress=seen.append)
    assert seen[-1] == 1.0
    assert (tmp_path / "s" / "sweep.parquet").exists()
    seen.clear()
    again = sweep("paper", **asked, progress=seen.append)
    assert not seen  # nothing was computed
    assert again.identical(first)
    with pytest.raises(UsageError, match="holds another sweep"):
        sweep("paper", grid="c1=5:25:4", horizon=1.0, out=tmp_path / "s")


def test_a_function_of_t_is_a_reference_of_every_run() -> None:
    data = sweep("paper", grid={"x1": [0.5, 1.0]}, reference=np.sin, horizon=2.0)
    single = ClosedLoop.load("paper").simulate(reference=np.sin, horizon=2.0, x0=[1.0, 0.0])
    assert data["ise"].sel(x1=1.0).item() == pytest.approx(single.ise, rel=1e-5)


@pytest.mark.parametrize(
    ("asked", "match"),
    [
        ({}, "nothing is varied"),
        ({"grid": {"c1": ["a:b", None]}}, "grid, c1: is None"),
        ({"grid": [3]}, "grid: is 3"),
        ({"grid": {"c9": [1, 2]}}, "no 'c9' to vary"),
        ({"sample": {"c1": 3}, "runs": 2}, "sample, c1: is 3"),
        ({"grid": {"c1": [1, 2]}, "formats": ("netcdf",)}, "formats: are files"),
        ({"grid": {"c1": [1, 2]}, "saturation": "braking", "compensator": False}, "compensator is False"),
    ],
)
def test_what_cannot_be_is_refused(asked: dict[str, Any], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        sweep("paper", **asked)


def test_the_package_and_the_function_are_one_object() -> None:
    plan = import_module("pmjoint_codegen.sweep.plan")
    assert pmjoint_codegen.sweep is sweep
    assert vars(sweep)["plan"] is plan  # importing a module of the package has not replaced it
    assert {"grid", "sample", "runs", "seed", "out", "threads"} <= set(inspect.signature(sweep).parameters)
