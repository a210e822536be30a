"""Programs that hang, die, or are absent."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.cli.main import run
from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.pil import machine
from pmjoint_codegen.export.pil.chips import CHIPS, Chip
from pmjoint_codegen.export.pil.folder import Columns
from pmjoint_codegen.export.pil.machine import Program
from pmjoint_codegen.export.pil.records import Layout

LAYOUT = Layout(Columns(("y", "y_r"), ("y",), ("v",)), np.dtype("<f8"))
GIVEN = np.zeros((3, 2))


def python(code: str) -> Program:
    return Program((sys.executable, "-c", code), "here", os.environ)


def test_a_program_that_hangs_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RUN_S", 0.5)
    monkeypatch.setattr(machine, "ANSWER_S", 0.5)
    hanging = python("import time; time.sleep(100)")
    with pytest.raises(CheckFailed, match="did not end within"):
        hanging.recorded(GIVEN, LAYOUT)
    with (
        pytest.raises(CheckFailed, match="did not answer within"),
        hanging.session(LAYOUT) as session,
    ):
        session.step([0.0, 0.0])
    with pytest.raises(ProcessLookupError):
        os.kill(session.child.pid, 0)


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("print('no such board'); raise SystemExit(1)", "status 1: no such board"),
        ("raise SystemExit(3)", "met an exception"),
        ("open('output.bin', 'wb').write(bytes(32 + 24 + 7))", "cut off"),
    ],
)
def test_a_program_that_fails_is_told(code: str, told: str) -> None:
    with pytest.raises(CheckFailed, match=told):
        python(code).recorded(GIVEN, LAYOUT)


def test_a_program_that_dies_in_the_loop_is_told() -> None:
    with (
        pytest.raises(CheckFailed, match="ended with status 5"),
        python("raise SystemExit(5)").session(LAYOUT) as session,
    ):
        session.step([0.0, 0.0])


@pytest.mark.parametrize("chip", CHIPS, ids=lambda chip: chip.name)
def test_absent_tools_are_named_with_their_packages(
    chip: Chip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make = shutil.which("make")
    (tmp_path / "bin").mkdir()
    if make is not None:
        (tmp_path / "bin" / "make").symlink_to(make)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    command = ["export", "paper", "--target", chip.name, "--run", "--out", str(tmp_path / "out")]
    assert run(command) == 3
    (line,) = (text for text in capsys.readouterr().err.splitlines() if "apt-get" in text)
    assert f"apt-get install {chip.packages}" in line and chip.emulator in line
