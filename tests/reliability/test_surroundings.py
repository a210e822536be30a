"""Locales, interpreter switches and paths that are not plain: the same results, or one line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pmjoint_codegen.cli.commands import COMMANDS

SHORT = ("simulate", "paper", "--horizon", "0.1", "--json")
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}  # Python knows no letter beyond ASCII
NAMES = {"utf-8": "käse φ".encode(), "no text": b"k\xff"}


def pmjoint(*arguments: str | bytes, cwd: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run the command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "pmjoint_codegen", *arguments],
        capture_output=True,
        cwd=cwd,
        env={**os.environ, **environment},
        timeout=240,
        check=False,
    )


def private(folder: Path) -> Path:
    """Make a folder that can be a cache."""
    folder.mkdir(mode=0o700)
    return folder


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_a_cache_has_any_name_in_a_c_locale(name: bytes, tmp_path: Path) -> None:
    cache = private(tmp_path / os.fsdecode(name))
    done = pmjoint(*SHORT, "--no-figures", cwd=tmp_path, PMJOINT_CACHE=str(cache), **ASCII)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout)["evaluator"] == "compiled"
    assert list(cache.rglob("kernels.so"))


def test_home_output_and_model_have_any_name_in_a_c_locale(root: Path, tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    name = NAMES["utf-8"]
    home = private(tmp_path / os.fsdecode(name))
    (home / "models").mkdir()
    shutil.copy(root / "models" / "paper.toml", home / "models")
    known = {**ASCII, "HOME": str(home), "PMJOINT_CACHE": "", "XDG_CACHE_HOME": "", "MPLCONFIGDIR": ""}
    model, out = name + b"/models/paper.toml", name + b"/out"
    for arguments in (
        ("regenerate", model),
        ("simulate", model, "--horizon", "0.1", "--out", out),
        ("sweep", model, "--grid", "x1=0:1:2", "--horizon", "0.1", "--out", out),
        ("check", model, "--gate", "current"),
        ("derive", model),
    ):
        done = pmjoint(*arguments, cwd=tmp_path, **known)
        assert (done.returncode, done.stderr) == (0, b""), arguments
    assert {path.name for path in (home / "generated").iterdir()} == {"paper"}
    assert {"summary.json", "sweep.zarr"} <= {path.name for path in (home / "out").iterdir()}
    assert list((home / ".cache").rglob("kernels.so"))


def test_flags_of_the_compiler_may_hold_bytes_that_are_no_text(tmp_path: Path) -> None:
    cc = os.fsdecode(b"cc '-DNO_NAME_OF_OURS=\"\xff\"'")
    cache = private(tmp_path / "cache")
    done = pmjoint(*SHORT, "--no-figures", cwd=tmp_path, CC=cc, PMJOINT_CACHE=str(cache))
    assert (done.returncode, done.stderr) == (0, b"")


def test_help_is_the_same_without_docstrings(tmp_path: Path) -> None:
    helps = "from pmjoint_codegen.cli.main import run\n" + "".join(
        f"_ = run([{entry.name!r}, '--help']) and exit('failed')\n" for entry in COMMANDS
    )
    plain, bare = (
        subprocess.run(
            [sys.executable, *switches, "-c", helps], capture_output=True, cwd=tmp_path, check=True
        )
        for switches in ((), ("-OO", "-W", "error"))
    )
    assert bare.stdout == plain.stdout
    assert bare.stdout.count(b"Usage: ") == len(COMMANDS)
    assert (plain.stderr, bare.stderr) == (b"", b"")


@pytest.mark.parametrize(
    "arguments",
    [
        (*SHORT, "--out", "o"),
        (*SHORT, "--evaluator", "interpreted", "--no-figures"),
        ("derive", "paper"),
        ("check", "paper", "--gate", "symbolic"),
        ("regenerate", "--check", "paper"),
        ("sweep", "paper", "--grid", "x1=0:1:2", "--horizon", "0.1"),
        ("doctor",),
    ],
    ids=lambda arguments: "-".join(arguments[:3]),
)
def test_commands_need_neither_docstrings_nor_assertions(arguments: tuple[str, ...], tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    done = pmjoint(*arguments, cwd=tmp_path, PYTHONOPTIMIZE="2", PYTHONWARNINGS="error")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout
