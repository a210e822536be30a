"""``pmjoint derive`` on the paper's model, in its three forms."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder: models are found by name all the same."""
    monkeypatch.chdir(tmp_path)


def test_the_law_is_printed_in_named_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["derive", "paper"]) == 0
    out = capsys.readouterr().out
    law = out[out.index("v = (") : out.index("# Certificate")].splitlines()
    assert "    - c2*z2" in law
    assert "    - dalpha1_dy**2*e2*z2" in law
    assert max(len(line) for line in law) < 60
    assert "z1 = y - r1 - y_r" in out
    assert "dalpha1_dy = -(c1 + e1)/b0" in out


def test_latex_is_a_document_in_the_papers_notation(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["derive", "paper", "--format", "latex"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(r"\documentclass")
    assert out.rstrip().endswith(r"\end{document}")
    assert r"\frac{\partial \alpha_1}{\partial \Xi_{21}}" in out


def test_json_is_one_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["derive", "paper", "--format", "json"]) == 0
    record = json.loads(capsys.readouterr().out)
    law = next(item for item in record["equations"] if item["name"] == "v")
    assert law["number"] == "(29)"
    assert law["unit"] == "V"
    numbers = {item["name"]: item["number"] for item in record["equations"]}
    assert [numbers[name] for name in ("V_epsilon", "V", "V_dot", "Y", "V_dot_max")] == [
        "(19)", "(30)", "(32)", "(33)", "(35)"
    ]  # fmt: skip


def test_an_unknown_model_is_one_line_and_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["derive", "papr"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "paper" in captured.err
    assert len(captured.err.splitlines()) == 1
