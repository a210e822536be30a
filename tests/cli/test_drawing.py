"""Figures of commands, whatever Matplotlib finds around it; in processes of their own: it reads that once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = (sys.executable, "-m", "pmjoint_codegen", "simulate", "paper", "--evaluator", "interpreted")
DARK = "text.usetex: True\naxes.facecolor: black\nxtick.color: white\nsavefig.bbox: tight\n"


def simulate(
    folder: Path, settings: bytes | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    folder.mkdir()
    if settings is not None:
        (folder / "matplotlibrc").write_bytes(settings)
    return subprocess.run(
        [*COMMAND, "--horizon", "0.02", "--out", "run"],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("plain") / "here"
    assert simulate(folder).returncode == 0
    return (folder / "run" / "overview.png").read_bytes()


@pytest.mark.parametrize("backend", ["module://matplotlib_inline.backend_inline", "nonsense", "tkagg"])
def test_another_programs_backend_is_none_of_ours(tmp_path: Path, plain: bytes, backend: str) -> None:
    done = simulate(tmp_path / "here", MPLBACKEND=backend)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "here" / "run" / "overview.png").read_bytes() == plain


def test_a_users_style_does_not_reach_the_figures(tmp_path: Path, plain: bytes) -> None:
    done = simulate(tmp_path / "here", DARK.encode())
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "here" / "run" / "overview.png").read_bytes() == plain


def test_unreadable_settings_are_named_after_the_results(tmp_path: Path) -> None:
    done = simulate(tmp_path / "here", b"\xff\xfe")
    assert done.returncode == 2
    assert "max |e|" in done.stdout
    assert "summary.json" in done.stdout
    last = done.stderr.splitlines()[-1]
    assert "matplotlibrc" in last
    assert "--no-figures" in last
