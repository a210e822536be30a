"""docs/howto/follow-a-recorded-reference.md: its commands, its lines of a model file and its script run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.main import run

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "howto" / "follow-a-recorded-reference.md").read_text(encoding="utf-8")

pytest.importorskip("casadi")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(ROOT))
    (tmp_path / "gait.csv").write_text(blocks("csv")[0])
    (tmp_path / "log.csv").write_text("time,angle [deg]\n0,80\n1,20\n2,0\n")
    return tmp_path


@pytest.mark.parametrize("command", [line for text in blocks("sh") for line in text.splitlines()])
def test_commands(command: str) -> None:
    program, *arguments = shlex.split(command)
    assert program == "pmjoint"
    arguments[1] = str(ROOT / "models" / f"{arguments[1]}.toml")
    assert run([*arguments, "--no-figures"]) == 0


@pytest.mark.parametrize("line", blocks("toml")[0].splitlines())
def test_lines_of_a_model_file(line: str, bench: Path) -> None:
    text = (ROOT / "models" / "paper.toml").read_text(encoding="utf-8")
    path = bench / "mine.toml"
    path.write_text(re.sub(r"^reference .*$", lambda _: line, text, flags=re.MULTILINE), encoding="utf-8")
    made = ClosedLoop.load(path, notify=lambda _: None).simulate(horizon=4.0)
    assert made.summary["reference"]["kind"] in line
    assert made.summary["status"] == "done"


def test_the_script(monkeypatch: pytest.MonkeyPatch) -> None:
    text = blocks("python")[0].replace('"paper"', repr(str(ROOT / "models" / "paper.toml")))
    exec(compile(text, "howto", "exec"), {})
