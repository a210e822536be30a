"""``pmjoint audit``: forms, files and misuse; what it finds is tested in tests/audit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NoReturn

import pytest

from pmjoint_codegen.audit import examination
from pmjoint_codegen.audit.findings import Finding
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.cli.main import run

FINDINGS = (Finding("(29)", "control law", Verdict.FOLLOWS, "equals the derived law", ("v = -b_0*z_1",)),)


@pytest.fixture(autouse=True)
def audited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Audit in no time."""
    monkeypatch.setattr(examination, "audit", lambda progress, notify: FINDINGS)


def test_the_table_is_the_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit"]) == 0
    out = capsys.readouterr().out
    assert "WHAT THE PAPER GETS RIGHT" in out
    assert "(29)" in out


@pytest.mark.parametrize("arguments", [["--json"], ["--format", "json"], ["--json", "--format", "json"]])
def test_json_is_one_document(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", *arguments]) == 0
    assert json.loads(capsys.readouterr().out)["findings"][0]["verdict"] == "follows"


def test_a_file_holds_what_would_be_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", "--format", "markdown"]) == 0
    printed = capsys.readouterr().out
    assert run(["audit", "--format", "markdown", "--out", str(tmp_path / "audit.md")]) == 0
    assert (tmp_path / "audit.md").read_text(encoding="utf-8") == printed
    assert capsys.readouterr().out == ""


def test_two_forms_at_once_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["audit", "--json", "--format", "table"]) == 2
    assert "exclude each other" in capsys.readouterr().err


def test_a_file_that_cannot_be_written_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert run(["audit", "--out", str(tmp_path / "file" / "audit.md")]) == 2
    assert str(tmp_path / "file") in capsys.readouterr().err


def test_an_out_that_cannot_be_written_is_refused_before_the_audit(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    begun: list[object] = []
    monkeypatch.setattr("pmjoint_codegen.audit.examination.audit", lambda *told: begun.append(told))
    assert run(["audit", "--out", str(tmp_path / "nowhere" / "audit.md")]) == 2
    assert begun == []
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_another_model_called_paper_is_no_bug(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def contradict(*_told: object) -> NoReturn:
        raise ArithmeticError("x1(0) = 60.0 and 80.0 are not on either side of the boundary")

    monkeypatch.setattr("pmjoint_codegen.audit.examination.audit", contradict)
    assert run(["audit"]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "is not the paper's model" in error
