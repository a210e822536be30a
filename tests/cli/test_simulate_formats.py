"""``pmjoint simulate --format``: which files a run leaves, and what is said where a package is absent."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

KERNELS = () if find_compiler(os.environ) else ("--evaluator", "interpreted")
SHORT = ("simulate", "paper", *KERNELS, "--horizon", "0.1", "--no-figures", "--out", "a")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder."""
    monkeypatch.chdir(tmp_path)


TOLD = ("summary.json", "run.json")


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_each_format_is_written_beside_the_csv_file_and_told_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap")
    pytest.importorskip("pyarrow")
    formats = [word for name in ("mcap", "parquet", "mat", "mat") for word in ("--format", name)]
    assert run([*SHORT, *formats, "--json"]) == 0
    captured = capsys.readouterr()
    names = [f"trajectory.{name}" for name in ("csv", "parquet", "mat", "mcap")]
    assert [Path(name).name for name in json.loads(captured.out)["files"]] == [*names, *TOLD]
    assert captured.err == ""
    assert left(tmp_path / "a") == {*names, *TOLD}
    table = np.loadtxt(tmp_path / "a" / "trajectory.csv", delimiter=",", skiprows=1)
    columns = loadmat(tmp_path / "a" / "trajectory.mat", simplify_cells=True)["trajectory"]
    assert np.array_equal(np.column_stack(list(columns.values())), table)


def test_a_second_run_leaves_no_trajectory_of_the_first(tmp_path: Path) -> None:
    assert run([*SHORT, "--format", "mat"]) == 0
    (tmp_path / "a" / "mine.mat").touch()
    assert run([*SHORT, "--format", "csv"]) == 0
    assert left(tmp_path / "a") == {"trajectory.csv", *TOLD, "mine.mat"}


@pytest.mark.parametrize(("package", "name"), [("pyarrow", "parquet"), ("mcap", "mcap")])
def test_an_absent_package_is_named_before_the_run(
    package: str,
    name: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert run([*SHORT, "--format", name]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert f"{package} is needed for {name} files" in line
    assert "-m pip install 'pmjoint-codegen[logs]'" in line
    assert left(tmp_path) == set()


def test_an_unknown_format_is_refused_with_the_known_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*SHORT, "--format", "rosbag"]) == 2
    assert "'csv', 'parquet', 'mat', 'mcap'" in capsys.readouterr().err
    assert left(tmp_path) == set()


def test_figures_are_written_in_the_formats_asked_for_and_old_ones_removed(tmp_path: Path) -> None:
    drawn = [word for word in SHORT if word != "--no-figures"]
    assert run(drawn) == 0
    first = left(tmp_path / "a")
    assert {"overview.png", "figure1_tracking_error.png"} < first
    (tmp_path / "a" / "photo.png").touch()
    assert run([*drawn, "--format", "svg", "--format", "pdf", "--width", "ieee", "--no-caption"]) == 0
    stems = {Path(name).stem for name in first if name.endswith(".png")}
    named = {f"{stem}.{kind}" for stem in stems for kind in ("svg", "pdf")}
    assert left(tmp_path / "a") == {*named, "trajectory.csv", *TOLD, "photo.png"}
    assert run(SHORT) == 0
    assert left(tmp_path / "a") == {"trajectory.csv", *TOLD, "photo.png"}


@pytest.mark.parametrize(
    ("width", "said"),
    [("iee", "did you mean 'ieee'"), ("1mm", "2.5in to 40in"), ("5", "120mm"), ("99999mm", "2.5in to 40in")],
)
def test_an_impossible_width_is_refused_before_the_run(
    width: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*SHORT, "--width", width]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and line.startswith("pmjoint: --width: ")
    assert left(tmp_path) == set()
