"""Runs side by side: labels, tables, distances, and the figure."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from matplotlib.figure import Figure

from pmjoint_codegen import ClosedLoop, Run, UsageError, compare
from pmjoint_codegen.simulate.figures import look_of
from pmjoint_codegen.simulate.overlay import LOOKS, typeset
from pmjoint_codegen.simulate.page import PRINTED, page_of
from pmjoint_codegen.simulate.style import styled
from pmjoint_codegen.simulate.symbols import symbol


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return ClosedLoop.load("paper")


@pytest.fixture(scope="module")
def runs(loop: ClosedLoop) -> tuple[Run, Run]:
    return loop.simulate(horizon=2.0), loop.simulate(horizon=2.0, parameters={"c1": 25.0})


def test_labels_say_what_differs(loop: ClosedLoop, runs: tuple[Run, Run]) -> None:
    first, _ = runs
    clipped = loop.simulate(horizon=2.0, compensator=False)
    assert compare(*runs).labels == ("c1 = 15", "c1 = 25")
    assert compare(first, clipped).labels == ("saturation compensator", "saturation clip")
    assert compare(first, first, names=["a", "b"]).labels == ("a", "b")
    joint = ClosedLoop.load("joint").simulate(horizon=0.1)
    assert compare(first, joint).labels == ("paper", "joint")


def test_the_table_has_both_and_their_difference(runs: tuple[Run, Run]) -> None:
    comparison = compare(*runs, names=("a", "b"))
    head, *rows = comparison.table()
    assert head == ("", "a", "b", "difference")
    table = {row[0]: row[1:] for row in rows}
    assert table["c1"] == ("15 1/s", "25 1/s")
    one, other = (run.summary["ise"] for run in runs)
    assert table["ISE (rad^2 s)"] == (f"{one:.6g}", f"{other:.6g}", f"{other - one:+.6g}")
    assert comparison._repr_html_().count("<tr>") == len(rows) + 1
    assert repr(comparison) == "<Comparison of 2 runs: c1 = 15; c1 = 25>"


def test_distances_are_the_largest_at_common_instants(loop: ClosedLoop, runs: tuple[Run, Run]) -> None:
    first, second = runs
    gap = compare(first, second).signals["e"][1]
    apart = np.abs(first["e"] - second["e"])
    assert gap.size == apart.max()
    assert gap.at == first.t[apart.argmax()]
    shorter = loop.simulate(horizon=1.0, output_step=0.02, parameters={"c1": 25.0})
    assert compare(first, shorter).signals["e"][1].at <= 1.0


def test_the_figure_has_every_run_in_every_panel_in_its_own_look(runs: tuple[Run, Run]) -> None:
    figure = compare(*runs).plot()
    units = [axes.get_ylabel().rpartition(" (")[2] for axes in figure.axes]
    assert units[:4] == ["rad)", "rad)", "V)", "V)"]
    for axes in figure.axes:
        named = {
            line.get_label(): line for line in axes.get_lines() if not str(line.get_label()).startswith("_")
        }
        assert [line.get_color() for line in named.values()] == [colour for colour, _ in LOOKS[:2]]
        assert list(named) == ["$c_{1}$ = 15", "$c_{1}$ = 25"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(named)
    assert len({str(dash) for _, dash in LOOKS}) == len(LOOKS)


@pytest.mark.parametrize("width", [None, "ieee"])
def test_nothing_of_the_figure_overlaps_or_leaves_it(width: str | None, runs: tuple[Run, Run]) -> None:
    page = page_of(width=width)
    figure = compare(*runs, *runs, names=[f"runs/quite-a-long-name-{k}" for k in range(4)]).plot(page=page)
    with styled(look_of(page)):
        cast("Any", figure.canvas).draw()
    boxes = [text.get_window_extent() for legend in figure.legends for text in legend.get_texts()]
    edge = figure.bbox
    assert all(box.x0 >= edge.x0 and box.x1 <= edge.x1 and box.y1 <= edge.y1 for box in boxes)
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[k + 1 :])
    top = max(axes.get_window_extent().y1 for axes in figure.axes)
    assert all(box.y0 > top for box in boxes)


def test_what_cannot_be_compared_is_refused(runs: tuple[Run, Run]) -> None:
    with pytest.raises(UsageError, match="2 to 8"):
        compare(runs[0])
    with pytest.raises(UsageError, match="one a run"):
        compare(*runs, names=["a"])
    with pytest.raises(UsageError, match="not every run has a column 'theta'"):
        compare(*runs).plot(["theta"])


def test_a_run_draws_onto_axes_given(runs: tuple[Run, Run]) -> None:
    axes = Figure().add_subplot()
    assert runs[0].plot(axes, "x1,r1") is axes
    assert [line.get_label() for line in axes.get_lines()] == ["$r_{1}$", "$x_{1}$"]
    assert axes.get_ylabel() == "$x_{1},\\ r_{1}$ (rad)"
    with pytest.raises(UsageError, match="units"):
        runs[0].plot(axes, ["y", "u"])
    assert len(runs[0].plot(signals=["y", "u", "v"]).axes) == 3
    assert PRINTED.caption


def test_names_are_typeset() -> None:
    assert symbol("x_hat2") == "$\\hat{x}_{2}$"
    assert symbol("x1-x_hat1") == "$x_{1} - \\hat{x}_{1}$"
    assert symbol("tau_plant") == "$\\mathrm{tau\\_plant}$"
    assert typeset("c1 = 20, saturation clip") == "$c_{1}$ = 20, saturation clip"
