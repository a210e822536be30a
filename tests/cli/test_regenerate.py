"""``pmjoint regenerate`` in a project of its own, and how it tells of changes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.regenerate import report_lines
from pmjoint_codegen.emit.regenerate import Report
from pmjoint_codegen.emit.staleness import Comparison, EquationChange, Verdict


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
    assert "written" in capsys.readouterr().out
    assert run(["regenerate", "--check"]) == 0

    with (tmp_path / "generated" / "paper" / "kernels.c").open("a") as stream:
        stream.write("/* */\n")
    capsys.readouterr()
    assert run(["regenerate", "--check", "--json"]) == 1
    (record,) = json.loads(capsys.readouterr().out)
    assert record["verdict"] == "edited by hand"
    assert record["remedy"]
    assert not record["written"]


def test_changes_are_told_in_mathematics() -> None:
    changes = (
        EquationChange("alpha1", "-c1*z1", "-2*c1*z1"),
        EquationChange("Omega", None, "xi2"),
        EquationChange("z3", "v0_3", None),
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
        "    to mend it: pmjoint regenerate paper",
    ]


def test_a_first_generation_does_not_list_every_equation_as_new() -> None:
    comparison = Comparison(Verdict.MISSING, ("nothing is generated yet",), (EquationChange("v", None, "0"),))
    lines = list(report_lines(Report("paper", Path("generated/paper"), comparison, written=True)))
    assert lines == [f"paper  missing  written to {Path('generated/paper')}", "    nothing is generated yet"]
