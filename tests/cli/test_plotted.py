"""``--plot``: a run in characters, in any terminal."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.cli.plotted import terminal_plot
from pmjoint_codegen.compile.compiler import find_compiler

KERNELS = () if find_compiler(os.environ) else ("--evaluator", "interpreted")
pytest.importorskip("plotext")


@pytest.fixture(scope="module")
def made() -> Run:
    return ClosedLoop.load("paper").simulate(horizon=5.0)


def test_the_plot_has_the_width_asked_for_and_no_colour(made: Run) -> None:
    lines = terminal_plot(made, width=72, colour=False, encoding="utf-8").splitlines()
    assert max(map(len, lines)) == 72
    assert "\x1b" not in "".join(lines)
    assert lines[0] == "⣀ y, . y_r (rad) over t (s)"
    (second,) = (k for k, line in enumerate(lines) if line.endswith("u (V) over t (s)"))
    assert len(lines) == 2 * second
    assert lines[second + 2].startswith(" 10┤") and lines[-3].startswith("-10┤")  # u at its limits
    assert lines[-1].split() == ["0", "1", "2", "3", "4", "5"]


def test_ascii_suffices(made: Run) -> None:
    text = terminal_plot(made, width=60, colour=False, encoding="ascii")
    assert text.isascii()
    assert text.startswith("* y, . y_r (rad)")
    assert "*" in text.splitlines()[3]


def test_colour_only_where_wanted(made: Run) -> None:
    assert "\x1b[38" in terminal_plot(made, width=60, colour=True, encoding="utf-8")


def test_the_command_prints_it_below_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "64")
    given = [
        "simulate",
        "paper",
        *KERNELS,
        "--horizon",
        "1",
        "--no-figures",
        "--out",
        str(tmp_path),
        "--plot",
    ]
    assert run(given) == 0
    said = capsys.readouterr().out
    assert "u (V) over t (s)" in said and "\x1b" not in said
    assert max(map(len, said[said.index(" y, ") :].splitlines())) == 64
    assert run([*given, "--json"]) == 2
    assert "--plot contradicts --json" in capsys.readouterr().err


def test_absent_plotext_is_named_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "plotext", None)
    assert run(["simulate", "paper", "--no-figures", "--out", str(tmp_path / "a"), "--plot"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert "-m pip install 'pmjoint-codegen[terminal]'" in line
    assert not (tmp_path / "a").exists()
