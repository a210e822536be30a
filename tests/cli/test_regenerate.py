"""``pmjoint regenerate`` in a project of its own, and how it tells of changes."""

from __future__ import annotations

import json
import shlex
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.regenerate import report_lines
from pmjoint_codegen.emit.changes import Change
from pmjoint_codegen.emit.regenerate import Report
from pmjoint_codegen.emit.staleness import Comparison, Verdict


def test_a_project_is_generated_checked_and_watched(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "models").mkdir()
    shutil.copy(root / "models" / "paper.toml", tmp_path / "models")
    monkeypatch.chdir(tmp_path)
    assert run(["regenerate", "--check"]) == 1
    assert not (tmp_path / "generated").exists()
    assert "pmjoint regenerate paper" in capsys.readouterr().out

    assert run(["regenerate"]) == 0
    told = capsys.readouterr().out  # and not every equation as new
    assert told == f"paper  missing  written to {Path('generated/paper')}\n    nothing is generated yet\n"
    assert run(["regenerate", "--check"]) == 0

    with (tmp_path / "generated" / "paper" / "kernels.c").open("a") as stream:
        stream.write("/* */\n")
    capsys.readouterr()
    assert run(["regenerate", "--check", "--json"]) == 1
    (record,) = json.loads(capsys.readouterr().out)
    assert record["verdict"] == "edited by hand"
    assert record["remedy"]
    assert not record["written"]


def test_two_files_of_one_name_are_refused(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "models").mkdir()
    for name in ("mine", "paper"):
        shutil.copy(root / "models" / "paper.toml", tmp_path / "models" / f"{name}.toml")
    (tmp_path / "models" / "broken.toml").write_text("name = ")
    monkeypatch.chdir(tmp_path)
    for arguments in (["regenerate", "mine"], ["regenerate", "paper", "--check"]):
        assert run(arguments) == 2
        error = capsys.readouterr().err
        assert "models/mine.toml" in error
        assert "models/paper.toml" in error
        assert error.count("\n") == 1
    assert not (tmp_path / "generated").exists()


def test_a_remedy_calls_a_model_as_the_command_line_must(
    tmp_path: Path, root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (root / "models" / "paper.toml").read_text()
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "other.toml").write_text(text)  # its model is called paper all the same
    (tmp_path / "my designs").mkdir()
    (tmp_path / "my designs" / "paper.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    for asked in ("other", "my designs/paper.toml"):
        assert run(["regenerate", "--check", "--json", asked]) == 1
        (record,) = json.loads(capsys.readouterr().out)
        command = shlex.split(record["remedy"])
        assert command == ["pmjoint", "regenerate", asked]
        assert run(command[1:]) == 0
        assert run(["regenerate", "--check", asked]) == 0
        capsys.readouterr()


def test_changes_are_told_in_mathematics() -> None:
    changes = (
        Change("alpha1", "-c1*z1", "-2*c1*z1"),
        Change("Omega", None, "xi2"),
        Change("z3", "v0_3", None),
    )
    comparison = Comparison(Verdict.MODEL_CHANGED, ("d1: 0.2 -> 0.3",), changes)
    lines = list(report_lines(Report("paper", Path("generated/paper"), comparison, written=False)))
    assert lines == [
        "paper  model changed",
        "    d1: 0.2 -> 0.3",
        "    - alpha1 = -c1*z1",
        "    + alpha1 = -2*c1*z1",
        "    + Omega = xi2",
        "    - z3 = v0_3",
        "    to fix it: pmjoint regenerate paper",
    ]
