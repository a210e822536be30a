"""The table of a run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.summary_table import summary_table


def test_many_switches_are_counted_rather_than_listed() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.1)
    many = replace(run, switches=tuple((i / 128, i % 2) for i in range(1, 12)))
    lines = summary_table(many, (), ()).splitlines()
    (first,) = (i for i, line in enumerate(lines) if line.startswith("  u "))
    assert [line.split(" from ")[1] for line in lines[first : first + 9]] == [
        f"{i / 128:.10f} s" for i in range(9)
    ]
    assert lines[first + 9].strip() == "and 3 more switches, in summary.json"
    assert "more switches" not in summary_table(replace(many, switches=many.switches[:8]), (), ())


def test_what_a_failed_run_lost_is_told_in_words() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.1)
    signals = np.full_like(run.signals, math.nan)
    peaks = {**run.peaks, "e": (math.nan, 0.0)}
    lines = summary_table(replace(run, ise=math.inf, signals=signals, peaks=peaks), (), ()).splitlines()
    for label in ("settling", "ISE", "max |e|", "final e"):
        assert [line.split() for line in lines if line.startswith(f"  {label} ")] == [
            [*label.split(), "overflow"]
        ]


def test_what_is_given_for_a_run_is_not_told_as_an_assumption() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.1)
    table = summary_table(run, (), ())
    assert "  assumed    y_r = sin(t) (not stated in the paper)\n  changed    horizon 0.1 s\n" in table
    table = summary_table(ClosedLoop.load("joint").simulate(horizon=0.1), (), ())
    assert "  settings   y_r = 0.3*(1 - cos(t)), horizon 0.1 s\n" in table
    assert "assumed" not in table
