"""A model that comes from a pipe is read once, and stands for a file in the current directory."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

SOURCES = {"stdin": "pmjoint {} < m.toml", "pipe": "cat m.toml | pmjoint {}", "substitution": "pmjoint {}"}


def bash(line: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a line in which ``pmjoint`` stands for the command."""
    pmjoint = f'pmjoint() {{ {shlex.quote(sys.executable)} -m pmjoint_codegen "$@"; }}; '
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {pmjoint}{line}"],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ,
        timeout=240,
        check=False,
    )


@pytest.fixture
def here(root: Path, tmp_path: Path) -> Path:
    """A folder with a model of its own, not called as its file is."""
    pytest.importorskip("casadi")
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    (tmp_path / "m.toml").write_text(text.replace('"paper"', '"mine"', 1), encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("source", SOURCES)
def test_a_model_from_a_pipe_is_simulated(source: str, here: Path) -> None:
    model = "<(cat m.toml)" if source == "substitution" else "/dev/stdin"
    arguments = f"simulate {model} --horizon 0.1 --no-figures"
    done = bash(SOURCES[source].format(arguments), here)
    assert (done.returncode, done.stderr) == (0, "")
    assert (here / "runs" / "mine" / "summary.json").is_file()


def test_all_that_a_file_can_do_a_pipe_can(here: Path) -> None:
    for arguments in (
        "regenerate /dev/stdin",
        "regenerate --check /dev/stdin",
        "check /dev/stdin --gate current --gate trajectory.invariants",
        "derive /dev/stdin",
        "sweep /dev/stdin --grid x1=0:1:2 --horizon 0.1 --no-figures",
    ):
        done = bash(f"cat m.toml | pmjoint {arguments}", here)
        assert (done.returncode, done.stderr) == (0, ""), arguments
    assert {path.name for path in (here / "generated").iterdir()} == {"mine"}
    assert (here / "runs" / "mine-sweep" / "sweep.zarr").is_dir()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("echo 'order = = 2' | pmjoint simulate /dev/stdin", "is not valid TOML"),
        ("pmjoint simulate /dev/stdin < /dev/null", "/dev/stdin: "),
        ("pmjoint simulate /dev/stdin < /dev/zero", "is too large"),
        ("pmjoint simulate /dev/stdin <&-", "/dev/stdin: "),
        ("cat m.toml | pmjoint tune /dev/stdin --gain c", "save the model as NAME.toml"),
    ],
)
def test_a_pipe_that_brings_no_model_is_one_line(line: str, said: str, here: Path) -> None:
    done = bash(line, here)
    assert done.returncode == 2
    assert said in done.stderr and len(done.stderr.splitlines()) == 1
    assert {path.name for path in here.iterdir()} == {"m.toml"}
