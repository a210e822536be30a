"""Whatever a user can get hold of prints in a few lines."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.brief import brief
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.studies.sweep import make_study as sweep_study
from pmjoint_codegen.studies.tune import make_study as tune_study

MOST = 1200  # characters; a run was 20,801


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return ClosedLoop.load("paper", notify=lambda line: None)


@pytest.fixture(scope="module")
def run(loop: ClosedLoop) -> Run:
    return loop.simulate()


def records(value: Any, depth: int = 4) -> Iterator[Any]:
    """Give the records inside a record, itself included."""
    if is_dataclass(value):
        yield value
        for item in fields(value) if depth else ():
            yield from records(getattr(value, item.name), depth - 1)


def test_a_run_prints_what_it_was_and_how_it_ended(run: Run) -> None:
    lines = repr(run).splitlines()
    assert lines[0] == "<Run of paper: Pneumatic muscle joint, Cai et al. 2020"
    assert len(lines) == 5
    text = repr(run)
    assert "continuous controller, compensator, y_r = sin(t), 20 s" in text
    assert "reached the horizon, 20 s" in text
    assert "ISE 9.42099 rad^2 s, max |e| 2.20522 rad" in text
    assert "2001 rows of 23 columns: t, y, y_r, e" in text


def test_a_run_says_that_it_diverges(loop: ClosedLoop) -> None:
    assert "; diverging" in repr(loop.simulate(x0=[70.2, 0.0], reference={"steps": [[0, 0]]}))


def test_a_run_is_a_mapping_of_its_columns(run: Run) -> None:
    table = dict(run)
    assert tuple(table) == run.columns
    assert np.array_equal(table["x1"], run["x1"])
    assert "x1" in run
    assert len(run) == len(run.columns)
    assert list(pd.DataFrame(dict(run)).columns) == list(run.columns)
    assert isinstance(run, Mapping)
    assert run.get("nothing") is None


def test_a_notebook_shows_a_table_and_a_picture(run: Run) -> None:
    html = run._repr_html_()
    assert html.startswith("<div><b>paper</b>")
    assert html.count("<tr>") == 4
    assert "data:image/png;base64,iVBOR" in html
    assert len(html) < 200_000


def test_loops_controllers_and_margins_print_in_a_line(loop: ClosedLoop) -> None:
    assert repr(loop) == (
        f"<ClosedLoop of paper: order 2, relative degree 2, {loop.evaluator.kind} kernels; "
        "by default y_r = sin(t), 20 s>"
    )
    controller = loop.controller()
    assert repr(controller) == "<Controller of paper: every 0.001 s, last v 0>"
    controller.step(1.5)
    assert "last v -" in repr(controller)
    assert repr(loop.manifest).startswith("<Manifest of paper: order 2")
    systems = loop.to_control()
    assert len(repr(systems)) < 300
    assert repr(systems.margins(y_r=0.0)).startswith("<Margins: gain 0.01668 to inf, phase 69.39")


def test_every_record_inside_is_short(loop: ClosedLoop, run: Run) -> None:
    found = [*records(run), *records(loop.source), *records(loop.simulate(reference=np.sin, horizon=2.0))]
    if find_compiler(os.environ) is not None:
        study = sweep_study("paper", grid={"x1": np.linspace(-1, 1, 5000)}, sample="b0~normal(2,1)", runs=9)
        found += [*records(study), *records(tune_study("paper"))]
    assert {"Run", "Settings", "Segments", "Command", "Plan", "Request"} <= {type(x).__name__ for x in found}
    assert [f"{type(item).__name__}: {len(repr(item))}" for item in found if len(repr(item)) > MOST] == []


def test_a_record_shows_sizes_in_place_of_data() -> None:
    @dataclass(frozen=True)
    class Some:
        rows: Any
        few: tuple[int, ...]
        many: tuple[int, ...]
        long: str

        __repr__ = brief

    shown = repr(Some(np.zeros((7, 2)), (1, 2), tuple(range(100)), "x" * 100))
    assert shown == f"Some(rows=<array 7 x 2>, few=(1, 2), many=<100 items>, long='{'x' * 76}...)"
