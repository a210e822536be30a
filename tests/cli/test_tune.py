"""``pmjoint tune`` as a user meets it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from pmjoint_codegen.build.compiler import find_compiler
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.spec.reader import read_document

pytestmark = pytest.mark.skipif(find_compiler(os.environ) is None, reason="tuning needs a compiler")
FEW = ["--generations", "2", "--horizon", "3"]


def test_tuning_writes_a_model_an_account_and_a_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bounds = [
        "--bound",
        "c1=5:40",
        "--bound",
        "ck1=0.5:20",
        "--perturb",
        "d1~normal(0.2,0.02)",
        "--plants",
        "4",
    ]
    assert run(["tune", "paper", *bounds, *FEW, "--out", str(tmp_path), "--json"]) == 0
    account = json.loads(capsys.readouterr().out)
    assert account["cost"] <= account["cost_before"]
    design = read_document(tmp_path / "paper.toml")["design"]
    assert [design["c"][0], design["ck"][0]] == [account["gains"]["c1"], account["gains"]["ck1"]]
    assert (tmp_path / "before-after.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "tune.json").read_text())["gains"] == account["gains"]
    assert run(["tune", str(tmp_path / "paper.toml"), *bounds, *FEW, "--out", str(tmp_path / "again")]) == 0
    assert "before, " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [([], "nothing is free"), (["--bound", "c1"], "--bound"), (["--bound", "q=1:2"], "no gain 'q'")],
)
def test_misuse_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tune", "paper", *arguments, "--out", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
