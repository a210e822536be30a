"""What README shows is what happens: its commands run, and they print the output and numbers shown."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(kind: str) -> list[str]:
    """Return the fenced blocks of one kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, re.DOTALL | re.MULTILINE)


def sessions() -> list[tuple[str, list[str]]]:
    """Return each console command with the output lines shown under it; `...` stands for anything."""
    found: list[tuple[str, list[str]]] = []
    for line in "".join(blocks("console")).splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def commands() -> list[str]:
    """Return the lines of the shell blocks, without their comments."""
    return [line.partition(" #")[0].strip() for line in "".join(blocks("sh")).splitlines()]


def pmjoint(line: str, folder: Path) -> str:
    """Run one `pmjoint` line of README in an empty folder and return what it printed."""
    program, *arguments = shlex.split(line)
    assert program == "pmjoint"
    command = [sys.executable, "-m", "pmjoint_codegen", *arguments]
    done = subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        env=os.environ,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout


def test_readme_has_something_to_run() -> None:
    assert len(sessions()) >= 3
    assert len(commands()) >= 5
    assert len(blocks("python")) >= 1


@pytest.mark.parametrize(("line", "shown"), sessions(), ids=[line for line, _ in sessions()])
def test_shown_output_is_printed(line: str, shown: list[str], tmp_path: Path) -> None:
    printed = pmjoint(line, tmp_path).splitlines()
    assert shown
    for expected in shown:
        pattern = re.escape(expected).replace(re.escape("..."), ".*")
        assert any(re.fullmatch(pattern, actual) for actual in printed), f"not printed: {expected}"


@pytest.mark.parametrize("line", commands())
def test_command_runs(line: str, tmp_path: Path) -> None:
    assert pmjoint(line, tmp_path)


@pytest.mark.parametrize("text", blocks("python"))
def test_python_runs(text: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", text], check=False, capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def rows_with_commands() -> list[tuple[list[str], str]]:
    """Return the cells and the command of each table row that ends with a `pmjoint` command."""
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in README.splitlines()
        if line[:1] == "|"
    ]
    return [(row[1:-1], row[-1].strip("`")) for row in rows if row[-1].startswith("`pmjoint")]


def test_table_of_the_compensator(tmp_path: Path) -> None:
    assert len(rows_with_commands()) == 2
    for cells, command in rows_with_commands():
        summary = json.loads(pmjoint(f"{command} --json", tmp_path))
        for cell, key in zip(cells, ("max_abs_e", "settling_s", "ise"), strict=True):
            written = cell.split()[0]
            digits = len(written.replace(".", "").lstrip("0"))
            assert f"{summary[key]:.{digits}g}" == written, f"{key} of {command}"


def test_first_example_stands_early() -> None:
    lines = README.splitlines()
    assert lines.index("```python") + blocks("python")[0].count("\n") < 40


PAGES = sorted(
    str(path.relative_to(ROOT))
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"))
    if not path.name.startswith(".")
)


@pytest.mark.parametrize("page", PAGES)
def test_links_and_targets_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"(?:^    |`)make ([a-z]+(?:-[a-z]+)*)\b", text, re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"make {target}"
    for link in re.findall(r"\]\(([^)#:]+)\)", text):
        assert ((ROOT / page).parent / link).exists(), link
    for module in re.findall(r"`((?:\w+/)+\w+\.(?:py|c|h|toml|md|csv))`", text):
        assert any((base / module).exists() for base in (ROOT, ROOT / "pmjoint_codegen")), module


def test_every_figure_shown_is_there_and_drawn_by_a_command() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {name for page in pages for name in re.findall(r"figures/(\w+\.png)\)", page.read_text("utf-8"))}
    makers = (ROOT / "docs" / "draw.py", ROOT / "benchmarks" / "__main__.py")  # make docs, make bench
    drawn = {name for maker in makers for name in re.findall(r'"(\w+\.png)"', maker.read_text("utf-8"))}
    assert shown == {
        path.name for path in (ROOT / "docs" / "figures").glob("*.png")
    }  # gallery/ has its own test
    assert shown <= drawn
