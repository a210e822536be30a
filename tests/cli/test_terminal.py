"""Strict JSON, aligned tables, and a bar that appears only when it is needed."""

from __future__ import annotations

import io
import json
import math
import re
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.cli import terminal


@pytest.fixture(autouse=True)
def talkative(monkeypatch: pytest.MonkeyPatch) -> None:
    """Progress is shown, as it is to a user."""
    monkeypatch.delenv("PMJOINT_PROGRESS", raising=False)


def test_json_has_null_for_what_it_cannot_hold_and_keeps_the_rest() -> None:
    value = {
        "nan": math.nan,
        "infinite": [math.inf, -math.inf, np.float64("nan")],
        "array": np.array([1.5, np.inf]),
        "integer": np.int64(3),
        "flag": np.bool_(True),
        "path": Path("a/b"),
        "nested": ({"x": 0.1},),
        1: None,
    }
    assert json.loads(terminal.as_json(value)) == {
        "nan": None,
        "infinite": [None, None, None],
        "array": [1.5, None],
        "integer": 3,
        "flag": True,
        "path": "a/b",
        "nested": [{"x": 0.1}],
        "1": None,
    }


def test_json_keeps_every_bit_of_a_number() -> None:
    number = 0.1 + 2.0**-54
    assert json.loads(terminal.as_json([number])) == [number]


def test_tables_align_and_leave_no_blank_at_the_end() -> None:
    text = terminal.table([("a", "bb", "c"), ("aaa", "b"), ("", "b", "c")])
    assert text.splitlines() == ["  a    bb  c", "  aaa  b", "       b   c"]


class Screen(io.StringIO):
    """A standard error that says it is a terminal."""

    def isatty(self) -> bool:
        """Say yes."""
        return True


def test_no_bar_where_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    before = threading.active_count()
    with terminal.activity("working") as advance:
        advance(0.5)
        assert threading.active_count() == before


def test_no_bar_for_what_is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with terminal.activity("working") as advance:
        advance(0.5)
    assert screen.getvalue() == ""


def test_a_bar_for_what_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(terminal, "_PATIENCE_S", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    shown = threading.Event()
    real = terminal._Bar.show

    def show(bar: terminal._Bar) -> None:
        real(bar)
        shown.set()

    monkeypatch.setattr(terminal._Bar, "show", show)
    with terminal.activity("working hard") as advance:
        assert shown.wait(30)
        advance(0.25)
    assert "working hard" in screen.getvalue()


def test_a_line_for_each_stage_that_takes_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "_PATIENCE_S", 0.2)
    with terminal.activity("deriving") as shown:
        shown.stage("quick", 0.0)
        shown.stage("alpha_2", 0.0)
        time.sleep(0.8)
        shown.stage("alpha_3", 0.0)
        shown.stage("alpha_3", 0.25)
        time.sleep(0.8)
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(" (")[0] for line in lines] == [
        "pmjoint: deriving: alpha_2",
        "pmjoint: deriving: alpha_3",
    ]
    assert re.search(r"\([01] s\)$", lines[0]) and re.search(r"\([01] s, about \d s left\)$", lines[1])
    time.sleep(0.3)
    assert capsys.readouterr().err == ""


def test_what_is_left_follows_from_what_is_done() -> None:
    assert terminal._spent(30.0, 0.25) == "30 s, about 90 s left"
    assert terminal._spent(30.0, 0.0) == "30 s"


def test_no_line_for_stages_that_are_quick(capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.activity("deriving") as shown:
        shown.stage("alpha_1", 0.0)
    assert capsys.readouterr().err == ""


def test_the_bar_names_the_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(terminal, "_PATIENCE_S", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    bar = terminal._Bar("deriving")
    bar.show()
    bar.stage("alpha_3", 0.5)
    assert bar._described() == "deriving: alpha_3" and bar._progress.tasks[0].completed == 0.5
    bar.stage("alpha_4", 0.0)
    assert bar._progress.tasks[0].total is None
    bar.close()
    assert "deriving: alpha_4" in screen.getvalue()


def test_progress_can_be_switched_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PMJOINT_PROGRESS", "0")
    monkeypatch.setattr(terminal, "_PATIENCE_S", 0.02)
    with terminal.activity("deriving") as shown:
        shown.stage("alpha_2", 0.0)
        time.sleep(0.3)
    assert capsys.readouterr().err == ""
