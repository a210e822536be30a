"""docs/tutorial.md, from top to bottom in one folder: its commands run and print what the page shows."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from docs import story
from pmjoint_codegen.compile.compiler import find_compiler

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
BLOCKS: list[tuple[str, str]] = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)


def printed(line: str, folder: Path) -> str:
    """Run one command of the page and return what it prints."""
    program, *arguments = shlex.split(line)
    programs = {"pmjoint": [sys.executable, "-m", "pmjoint_codegen"], "make": ["make"]}
    done = subprocess.run(
        [*programs[program], *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout


def pattern(shown: str) -> str:
    """Turn output with gaps into an expression: a line `...` is any lines, `...` in a line any text."""
    lines = [
        r"(?:.*\n)*?" if line.strip() == "..." else re.escape(line).replace(re.escape("..."), ".*") + r"\n"
        for line in shown.splitlines()
    ]
    return "".join(lines) + ("" if lines[-1].startswith("(?:") else r"(?:.*\n)*")


def session(text: str, folder: Path) -> None:
    """Run the commands of a block, and compare."""
    for line, shown in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
        told = printed(line, folder)
        assert re.match(pattern(shown), told), f"{line}\n{told}\nis not\n{shown}"


def code(text: str, folder: Path) -> None:
    """Run the Python of the page; each line that prints says what."""
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=folder, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == re.findall(r"^print.*# (.*)$", text, re.MULTILINE)


def test_gaps_match_whatever_is_printed_and_nothing_else_does() -> None:
    assert re.match(pattern("a\n...\nb ... c\n"), "a\nx\ny\nb 1 c\nmore\n")
    assert not re.match(pattern("a\n...\nb\n"), "a\nx\nc\n")
    assert not re.match(pattern("a\nb\n"), "a\nx\nb\n")


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_page_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_compiler({}) is None:
        pytest.skip("no C compiler")
    assert [kind for kind, _ in BLOCKS].count("console") >= 8
    for kind, text in BLOCKS:
        if kind == "console":
            session(text, tmp_path)
        elif kind == "diff":
            model = tmp_path / "models" / "elbow.toml"
            model.write_text(story.applied(model.read_text(encoding="utf-8"), text), encoding="utf-8")
        elif kind == "python":
            code(text, tmp_path)
    for file in re.findall(r"`(\w+/(?:paper/)?[\w-]+\.(?:png|csv|toml))`", PAGE):
        assert (tmp_path / file).is_file(), file
