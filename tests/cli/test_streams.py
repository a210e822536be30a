"""Standard streams that are closed, full, or read by nobody: a line where one can be said, the right code."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

PMJOINT = f"{shlex.quote(sys.executable)} -m pmjoint_codegen"
SHORT = "simulate paper --horizon 0.1 --no-figures"
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")


def shell(line: str, cwd: Path, **environment: str) -> tuple[int, str, str]:
    """Run a line of Bash in which ``pmjoint`` stands for the command; exit code, output, messages."""
    done = subprocess.run(
        ["bash", "-c", f'set -o pipefail; pmjoint() {{ {PMJOINT} "$@"; }}; {line}'],
        capture_output=True,
        cwd=cwd,
        env={**os.environ, **environment},
        timeout=120,
        check=False,
    )
    return done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")


@pytest.mark.parametrize("arguments", ["--help", "sweep -h", "--version"])
def test_a_reader_that_has_left_is_no_error(arguments: str, tmp_path: Path) -> None:
    # The reader is gone before the writer begins.
    line = f"mkfifo p; exec 3<>p; exec 4>p 3<&-; pmjoint {arguments} >&4"
    assert shell(line, tmp_path) == (0, "", "")


@pytest.mark.parametrize("arguments", ["--help", SHORT])
def test_a_closed_output_is_no_error(arguments: str, tmp_path: Path) -> None:
    assert shell(f"pmjoint {arguments} >&-", tmp_path) == (0, "", "")


def test_a_file_never_becomes_standard_output(tmp_path: Path) -> None:
    """Without standard streams the next files opened would be 0, 1 and 2, which compilers write to."""
    cache = tmp_path / "cache"
    cache.mkdir(mode=0o700)
    (tmp_path / "cc").write_text('#!/bin/sh\necho words; echo words >&2\nexec cc "$@"\n')
    (tmp_path / "cc").chmod(0o700)
    (tmp_path / "o").mkdir()
    code, _, _ = shell(
        f"pmjoint {SHORT} --out o <&- >&- 2>&-", tmp_path, PMJOINT_CACHE=str(cache), CC=str(tmp_path / "cc")
    )
    assert code == 0
    assert json.loads((tmp_path / "o" / "summary.json").read_text())["status"] == "done"
    assert not [path for path in tmp_path.rglob("*.csv") if "words" in path.read_text()]


@needs_full
@pytest.mark.parametrize("arguments", ["--help", "--version", SHORT])
def test_a_full_disk_under_standard_output_is_3(arguments: str, tmp_path: Path) -> None:
    code, _, said = shell(f"pmjoint {arguments} >/dev/full", tmp_path)
    assert code == 3
    assert len(said.splitlines()) == 1 and "no space left" in said.lower()


@pytest.mark.parametrize("target", ["2>&-", pytest.param("2>/dev/full", marks=needs_full)])
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ("simulate nothing", 2),
        ("simulate paper --horizon x", 2),
        (f"{SHORT} --set d1=400 --divergence 2", 3),
        (SHORT, 0),
    ],
)
def test_messages_that_cannot_be_said_change_no_code(
    arguments: str, code: int, target: str, tmp_path: Path
) -> None:
    # CC makes even the commands that succeed have something to say.
    assert shell(f"pmjoint {arguments} >/dev/null {target}", tmp_path, CC="/nothing")[0] == code


@pytest.mark.parametrize("encoding", ["ascii:strict", "utf-8:strict"])
def test_what_an_encoding_cannot_say_is_escaped(encoding: str, tmp_path: Path) -> None:
    folder = os.fsdecode(b"\xcf\x87 \xff")  # a letter that Latin-1 lacks, and a byte that is no text
    settings = f"{SHORT} --out {shlex.quote(folder)}"
    code, table, said = shell(f"pmjoint {settings}", tmp_path, PYTHONIOENCODING=encoding)
    assert (code, said) == (0, "")
    assert "\\udcff" in table
    code, document, said = shell(f"pmjoint {settings} --json", tmp_path, PYTHONIOENCODING=encoding)
    assert (code, said) == (0, "")
    files = json.loads(document)["files"]
    assert {Path(file).parent.name for file in files} == {folder}
    record = json.loads((tmp_path / folder / "run.json").read_text(encoding="utf-8"))
    assert shlex.split(record["command"])[-2:] == [folder, "--json"]
