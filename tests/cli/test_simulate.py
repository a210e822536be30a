"""``pmjoint simulate``: files, table, JSON, every option, and bad input."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

# Without a compiler, what is used anyway is asked for, so that no line has to say so.
KERNELS = () if find_compiler(os.environ) else ("--evaluator", "interpreted")
SHORT = ("--horizon", "0.5", "--no-figures")
FIGURES = {
    "overview.png",
    "figure1_tracking_error.png",
    "figure2_x2.png",
    "figure3_r1.png",
    "figure4_r2.png",
    "figure5_v_u.png",
    "figure6_estimate.png",
}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder: the model is found by name, results go to runs/ here."""
    monkeypatch.chdir(tmp_path)


def simulate(*arguments: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Run with --json and return the document."""
    code = run(["simulate", "paper", *KERNELS, *SHORT, "--json", *arguments])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    document: dict[str, Any] = json.loads(captured.out)
    return document


def rows(path: Path) -> list[dict[str, float]]:
    """Read a trajectory."""
    with path.open(newline="") as stream:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(stream)]


def test_the_papers_run_leaves_every_file_and_tells_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["simulate", "paper", *KERNELS]) == 0
    folder = tmp_path / "runs" / "paper"
    data = {"trajectory.csv", "transient.csv", "summary.json", "run.json"}
    assert {path.name for path in folder.iterdir()} == FIGURES | data
    captured = capsys.readouterr()
    for said in (
        "at -u_max from 0.0000000000 s",
        "inside its limits from 0.0548",
        "at u_max from 0.0720",
        "inside its limits from 0.2220",
        "|v| = 225.68 V at 0 s",
        "|r2| = 8.548",
        "7.46352 s",
        "9.42",
        "assumed    y_r = sin(t), horizon 20 s",
    ):
        assert said in captured.out
    assert captured.err == ""
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == "done"
    assert [mode for _, mode in summary["saturation_switches"]] == [0, 1, 0]
    trajectory = rows(folder / "trajectory.csv")
    assert len(trajectory) == 2001
    assert trajectory[0]["v"] == pytest.approx(-225.68020625, abs=1e-8)


def test_json_is_the_summary_with_the_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = simulate(capsys=capsys)
    files = document.pop("files")
    assert document == json.loads((tmp_path / "runs" / "paper" / "summary.json").read_text())
    assert all(Path(name).is_file() for name in files)


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        (["--set", "c1=20", "--set", "u_max=1e3"], "parameters.c1", 20.0),
        (["--set", "d1=-5"], "parameters.d1", -5.0),
        (["--set", "b0_plant=2.6"], "parameters.b0_plant", 2.6),
        (["--x0", "-1,2"], "x0", [-1.0, 2.0]),
        (["--x0=-1,2"], "x0", [-1.0, 2.0]),
        (["--reference", "cos(2*t)"], "reference", "cos(2*t)"),
        (["--horizon", "0.25"], "horizon", 0.25),
        (["--output-step", "0.05"], "output_step", 0.05),
        (["--controller", "sampled"], "sample_time", 0.001),
        (["--controller", "sampled", "--sample-time", "0.005"], "sample_time", 0.005),
        (["--no-compensator"], "parameters.compensator", 0.0),
        (["--tolerance", "1e-8"], "tolerance", 1e-8),
        (["--evaluator", "interpreted"], "evaluator", "interpreted"),
    ],
    ids=lambda value: (
        " ".join(value) if isinstance(value, list) and value and isinstance(value[0], str) else ""
    ),
)
def test_each_option_reaches_the_run(
    arguments: list[str], key: str, value: object, capsys: pytest.CaptureFixture[str]
) -> None:
    document = simulate(*arguments, capsys=capsys)
    for name in key.split("."):
        document = document[name]
    assert document == value


def test_another_disturbance_is_named_in_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "simulate",
        "paper",
        *KERNELS,
        *SHORT,
        "--disturbance",
        "0",
        "--disturbance",
        "0",
        "--set",
        "c1=20",
    ]
    assert run(arguments) == 0
    assert "c1 = 20, disturbance = (0, 0)" in capsys.readouterr().out


def test_an_error_that_has_not_settled_is_not_given_a_settling_time(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["simulate", "paper", *KERNELS, *SHORT]) == 0
    assert (
        ", 2 % of the initial |e|)\n" in capsys.readouterr().out.split("settling   not by 0.5 s (|e| > ")[1]
    )


def test_a_sample_time_without_the_sampled_controller_is_said_to_do_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["simulate", "paper", *KERNELS, *SHORT, "--sample-time", "0.002"]
    assert run(command) == 0
    assert "--controller sampled" in capsys.readouterr().err
    assert run([*command, "--controller", "sampled"]) == 0
    assert capsys.readouterr().err == ""


def test_without_compensator_r_stays_zero(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate("--no-compensator", "--out", "plain", capsys=capsys)
    assert all(row["r1"] == 0.0 and row["r2"] == 0.0 for row in rows(tmp_path / "plain" / "trajectory.csv"))


@pytest.mark.parametrize("figures", [True, False], ids=["figures", "no figures"])
def test_a_run_that_fails_keeps_what_it_has_and_exits_with_3(
    figures: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    undisturbed = ["--disturbance", "0", "--disturbance", "0"]
    arguments = ["--x0", "1000,0", "--horizon", "60", "--json", "--out", "failed", *undisturbed]
    assert run(["simulate", "paper", *KERNELS, *arguments, *([] if figures else ["--no-figures"])]) == 3
    captured = capsys.readouterr()
    assert len(captured.err.splitlines()) == 1
    assert "diverged" in captured.err
    document = json.loads(captured.out)
    assert document["status"] == "diverged"
    trajectory = rows(tmp_path / "failed" / "trajectory.csv")
    assert 1 < len(trajectory) < 6001
    assert all(math.isfinite(value) for row in trajectory for value in row.values())
    assert json.loads((tmp_path / "failed" / "summary.json").read_text())["status"] == "diverged"
    assert (tmp_path / "failed" / "overview.png").exists() is figures


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--set", "c9=1"], "c9"),
        (["--set", "c1"], "NAME=VALUE"),
        (["--set", "c1=x"], "not a number"),
        (["--set", "c1=1", "--set", "c1=2"], "set twice"),
        (["--set", "c1=0"], "greater than 0"),
        (["--set", "c1=nan"], "finite"),
        (["--set", "u_max=-1"], "u_max"),
        (["--set", "b0=0"], "b_m = 0"),
        (["--set", "k1=-6"], "unstable"),
        (["--x0", "1"], "x0"),
        (["--x0", "1,inf"], "finite"),
        (["--x0", "1,,2"], "--x0"),
        (["--horizon", "0"], "horizon"),
        (["--horizon", "nan"], "horizon"),
        (["--output-step", "-1"], "output step"),
        (["--sample-time", "0", "--controller", "sampled"], "sample time"),
        (["--tolerance", "1"], "tolerance"),
        (["--controller", "bang"], "--controller"),
        (["--evaluator", "gpu"], "--evaluator"),
        (["--reference", "__import__('os')"], "__import__"),
        (["--reference", "q*t"], "q"),
        (["--disturbance", "0"], "disturbance"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_one_line_and_2_and_leaves_nothing(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["simulate", "paper", *KERNELS, "--no-figures", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert said in captured.err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_an_out_that_cannot_be_written_is_said_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(
        "pmjoint_codegen.closed_loop.ClosedLoop.load", lambda *_a, **_k: pytest.fail("it ran")
    )
    assert run(["simulate", "paper", *KERNELS, "--out", "file/below"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_compiler_that_fails_is_3(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", "false")
    monkeypatch.setenv("PMJOINT_CACHE", str(tmp_path / "cache"))
    assert run(["simulate", "paper", *SHORT]) == 3


@pytest.mark.usefixtures("no_ziglang")
def test_without_a_compiler_one_line_says_so_and_the_run_is_interpreted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run(["simulate", "paper", *SHORT]) == 0
    captured = capsys.readouterr()
    assert "interpreted kernels" in captured.out
    assert len(captured.err.splitlines()) == 1
    assert "apt-get install gcc" in captured.err
    assert run(["simulate", "paper", *SHORT, "--evaluator", "compiled"]) == 3


def test_ctrl_c_is_one_line_and_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_arguments: object, **_settings: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pmjoint_codegen.closed_loop.ClosedLoop.simulate", interrupt)
    assert run(["simulate", "paper", *KERNELS, *SHORT]) == 130
    assert capsys.readouterr().err == "pmjoint: interrupted\n"


def test_results_are_written_by_one_rename_each(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A summary that cannot be formed leaves the old one whole, and no temporary file."""
    simulate("--out", "a", capsys=capsys)
    before = (tmp_path / "a" / "summary.json").read_bytes()

    def broken(value: object, indent: int) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pmjoint_codegen.simulate.folder._json", broken)
    assert run(["simulate", "paper", *KERNELS, *SHORT, "--set", "c1=20", "--out", "a"]) == 3
    assert (tmp_path / "a" / "summary.json").read_bytes() == before
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"summary.json", "trajectory.csv"}
