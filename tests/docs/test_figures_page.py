"""docs/figures.md: its commands and its Python run, and print what the page shows."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8")
KERNELS = () if find_compiler(os.environ) else ("--evaluator", "interpreted")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def test_what_the_page_shows_is_what_happens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for line in "".join(blocks("sh")).splitlines():
        _, *words = shlex.split(line)
        capsys.readouterr()
        assert run([*words, *(KERNELS if words[0] == "simulate" else ())]) == 0, line
    (table,) = blocks("text")
    assert capsys.readouterr().out == f"{table}  files  runs/comparison/comparison.png\n"
    assert (tmp_path / "slides" / "overview.png").is_file()
    (program,) = blocks("python")
    exec(program, {})  # the page's own text
    assert capsys.readouterr().out == "('c1 = 15', 'c1 = 25')\n"
    listed = set(re.findall(r"^\| `([\w.]+)` \|", PAGE, re.MULTILINE))
    written = {path.name for path in (tmp_path / "runs" / "slow").iterdir()}
    assert written == listed - {"against.csv"}
