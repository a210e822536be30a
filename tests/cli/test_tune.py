"""``pmjoint tune`` as a user meets it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="tuning needs a compiler")

QUICK = ["--generations", "3", "--population", "3", "--horizon", "4", "--seed", "7"]


def test_a_tuned_model_simulates_at_once_to_what_was_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    limits = ["--max-v", "150", "--perturb", "b0~uniform(1.6,2.4)", "--plants", "3"]
    assert run(["tune", "paper", *QUICK, *limits, "--out", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == [str(file), str(tmp_path / "mine.png")]
    assert (tmp_path / "mine.png").read_bytes().startswith(b"\x89PNG")
    again = ["--horizon", "4", "--json", "--no-figures", "--out", str(tmp_path / "run")]
    assert run(["simulate", str(file), *again]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["model"] == "mine"
    assert summary["max_abs_v"] <= 150.0
    for name in ("ise", "max_abs_v"):  # at a tolerance of 1e-6 there, of 1e-10 here
        assert summary[name] == pytest.approx(told["nominal"][name]["after"], rel=1e-4)
    assert {name: told["gains"][name]["after"] for name in told["gains"]} == {
        name: summary["parameters"][name] for name in told["gains"]
    }


def test_start_saturation_and_reference_are_those_of_simulate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, gait = tmp_path / "mine.toml", tmp_path / "gait.csv"
    gait.write_text("t,y\n0,1.2\n1,0.4\n2,0.9\n4,0\n", encoding="utf-8")
    task = ["--reference", str(gait), "--reference-filter", "9"]
    design = ["--start", "matched", "--saturation", "braking"]
    assert run(["tune", "paper", *QUICK, *task, *design, "--out", str(file), "--no-figure", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    again = ["--horizon", "4", "--json", "--no-figures", "--out", str(tmp_path / "run")]
    assert run(["simulate", "paper", *task, *design, *again]) == 0
    before = json.loads(capsys.readouterr().out)
    assert run(["simulate", str(file), *task, *again]) == 0  # the file has the design, and not the task
    after = json.loads(capsys.readouterr().out)
    assert (after["start"], after["saturation"]) == ("matched", "braking")
    assert "y_r = gait.csv" in file.read_text(encoding="utf-8").split("\n")[0]
    for name in ("ise", "max_abs_v"):
        assert before[name] == pytest.approx(told["nominal"][name]["before"], rel=1e-4)
        assert after[name] == pytest.approx(told["nominal"][name]["after"], rel=1e-4)


def test_the_table_says_before_and_after(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--gain", "c=3:60", "--no-figure", "--out", str(tmp_path / "x.toml")]
    assert run(["tune", "paper", *QUICK, *arguments]) == 0
    text = capsys.readouterr().out
    assert "paper: least ise" in text
    for word in ("before", "after", "objective", "settling_s", "max_abs_v", "rad^2 s", "seed 7"):
        assert word in text
    assert "nan" not in text
    assert not (tmp_path / "x.png").exists()


def test_the_gains_found_are_judged_by_the_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slow = ["--controller", "sampled", "--sample-time", "0.02", "--x0", "0.3,0"]
    bounds = ["--gain", "c=5:60", "--perturb", "sample_time~uniform(0.001,0.05)", "--plants", "6"]
    arguments = [*QUICK, *slow, *bounds, "--no-figure", "--json", "--out", str(tmp_path / "x.toml")]
    assert run(["tune", "paper", *arguments]) == 0
    printed = capsys.readouterr()
    gains = json.loads(printed.out)["gains"]
    fastest = max(gains["c1"]["after"] + 0.1, gains["c2"]["after"])
    assert fastest * 0.05 > 0.42
    assert " of 7 runs the law may be too fast; in the worst, the fastest rate of the errors z" in printed.err


def test_the_mean_stands_beside_the_worst_where_it_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    perturbed = ["--perturb", "b0~uniform(1.6,2.4)", "--plants", "2", "--over", "mean"]
    arguments = [*QUICK, *perturbed, "--no-figure", "--out", str(tmp_path / "x.toml")]
    assert run(["tune", "paper", *arguments]) == 0
    text = capsys.readouterr().out
    assert text.index("mean of plants") < text.index("worst plant")


def test_what_is_not_defined_is_a_dash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--x0", "0,0", "--no-figure", "--out", str(tmp_path / "x.toml")]
    assert run(["tune", "paper", *QUICK, *arguments]) == 0
    line = next(line for line in capsys.readouterr().out.split("\n") if "settling_s" in line)
    assert line.split() == ["settling_s", "-", "-", "s"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--objective", "ise*ise"], "is not linear"),
        (["--gain", "z1"], "no gain 'z1'"),
        (["--max-v", "0.01", *QUICK], "none of"),
        (["--perturb", "c1~uniform(1,2)"], "to perturb"),
    ],
)
def test_misuse_is_one_line_and_writes_nothing(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tune", "paper", *arguments, "--out", str(tmp_path / "x.toml")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_model_itself_is_never_overwritten(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "own.toml"
    model.write_bytes((root / "models" / "paper.toml").read_bytes())
    assert run(["tune", str(model), "--out", str(model)]) == 2
    assert "is the model itself" in capsys.readouterr().err
    assert run(["tune", str(model), "--out", str(tmp_path / "a b.toml")]) == 2
    assert "--out: is" in capsys.readouterr().err


def test_no_file_but_one_that_tune_has_written_is_replaced(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, tuned = tmp_path / "other.toml", tmp_path / "tuned.toml"
    other.write_bytes((root / "models" / "joint.toml").read_bytes())
    (tmp_path / "folder.toml").mkdir()
    for taken in (other, tmp_path / "folder.toml"):
        assert run(["tune", "paper", *QUICK, "--out", str(taken)]) == 2
        assert "exists already" in capsys.readouterr().err
    assert other.read_bytes() == (root / "models" / "joint.toml").read_bytes()
    for _ in range(2):
        assert run(["tune", "paper", *QUICK, "--no-figure", "--out", str(tuned)]) == 0
