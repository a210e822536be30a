"""``pmjoint sweep`` as a user meets it."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import StaleError
from pmjoint_codegen.manifest import FILE_NAME, Manifest

pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="a sweep needs a compiler")

GRID = ["--grid", "x1=-3:3:5", "--grid", "compensator=0,1", "--horizon", "2"]


def test_a_sweep_writes_a_dataset_and_figures_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["sweep", "paper", *GRID, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "paper: 10 runs (5 of x1 x 2 of compensator): 10 done" in text
    assert (tmp_path / "sweep.zarr").is_dir()
    assert (tmp_path / "curves.png").is_file()
    assert run(["sweep", "paper", *GRID, "--out", str(tmp_path), "--json", "--no-figures"]) == 0
    account = json.loads(capsys.readouterr().out)
    assert account["runs"] == 10
    assert account["status"] == {"done": 10}
    assert account["dimensions"] == {"x1": 5, "compensator": 2}


def test_damaged_files_are_named_and_computed_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", "paper", *GRID, "--out", str(tmp_path), "--json", "--no-figures"]
    assert run(command) == 0
    before = capsys.readouterr()
    assert before.err == ""
    (tmp_path / "sweep.zarr" / "status" / "c" / "0" / "0").write_bytes(b"")
    shutil.rmtree(tmp_path / "sweep.zarr" / "ise" / "c")
    assert run(command) == 0
    after = capsys.readouterr()
    assert "removed or altered: sweep.zarr/ise/c/0/0, sweep.zarr/status/c/0/0; computing 10 runs" in after.err
    assert after.out == before.out
    assert run(command) == 0
    assert capsys.readouterr().err == ""


def test_another_reference_is_derived_and_swept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--reference", "0.5*sin(2*t)", "--no-figures", "--json", "--out", str(tmp_path)]
    assert run(["sweep", "paper", "--grid", "c1=10,20", *arguments]) == 0
    assert json.loads(capsys.readouterr().out)["held"] == 2
    assert json.loads((tmp_path / "request.json").read_text())["reference"] == "0.5*sin(2*t)"


def test_a_run_without_settling_time_leaves_those_of_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From x1(0) = 0 = y_r(0) the error starts at 0, and 2 % of that is no time."""
    command = ["sweep", "paper", "--grid", "x1=0,1.5", "--no-figures", "--json", "--out", str(tmp_path)]
    assert run(command) == 0
    account = json.loads(capsys.readouterr().out)
    assert account["held"] == 2
    assert account["quantiles_of_held"]["settling_s"]["median"] == pytest.approx(7.46, abs=0.01)
    assert account["counts_of_held"]["settling_s"] == 1


def test_a_run_that_has_not_settled_has_no_settling_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At 2 s the error with the compensator is still outside its band, without it inside."""
    command = ["sweep", "paper", "--grid", "compensator=0,1", "--horizon", "2", "--no-figures"]
    assert run([*command, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"settling_s +1\.597\d* +1\.597\d* +1\.597\d* +s, in 1\n", printed), printed


def test_a_sample_time_without_the_sampled_controller_is_said_to_do_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "sweep",
        "paper",
        "--grid",
        "c1=10",
        "--horizon",
        "0.1",
        "--no-figures",
        "--sample-time",
        "0.002",
    ]
    assert run([*command, "--out", str(tmp_path / "a")]) == 0
    assert "--controller sampled" in capsys.readouterr().err
    assert run([*command, "--out", str(tmp_path / "b"), "--controller", "sampled"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "nothing is varied"),
        (["--grid", "x1"], "--grid: is 'x1'"),
        (["--grid", "q=1,2"], "no 'q' to vary"),
        (["--sample", "d1~normal(0.2,0.1)"], "--runs is the number of draws"),
        (["--grid", "c1=1,2", "--set", "c1=3"], "both set and varied"),
        (["--grid", "c1=1,2", "--horizon", "0"], "horizon"),
        (["--grid", "c1=1:2:1000000", "--trajectories", "0.001"], "--trajectories: would keep"),
    ],
)
def test_misuse_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["sweep", "paper", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out" / "sweep.zarr").exists()


def test_an_absent_extra_costs_one_line_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert run(["sweep", "paper", *GRID, "--out", str(tmp_path)]) == 3
    assert "pip install 'pmjoint-codegen[sweep]'" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["sweep", "paper", "--grid", "c1=10,20"], ["tune", "paper"]])
def test_generated_files_of_before_the_batch_loops_are_stale(
    arguments: list[str],
    root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("models", "generated/paper"):
        shutil.copytree(root / name, tmp_path / name)
    folder = tmp_path / "generated" / "paper"
    manifest = Manifest.read(folder)
    lanes = {"lanes.c", "lanes.h"}
    for name in lanes:
        (folder / name).unlink()
    files = {name: hash for name, hash in manifest.files.items() if name not in lanes}
    (folder / FILE_NAME).write_text(replace(manifest, files=files).to_json())
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == StaleError.exit_code
    error = capsys.readouterr().err
    assert "no lanes.c among the generated files; run pmjoint regenerate paper" in error
    assert error.count("\n") == 1
