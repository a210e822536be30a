"""Figures: what they show, what their captions say, for the paper's order and for others."""

from __future__ import annotations

import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.initial import Variable
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.assumptions import changes, sentence
from pmjoint_codegen.simulate.figures import STYLE, draw, overview, write_figures
from pmjoint_codegen.simulate.panels import unit_text
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.sheets import (
    caption,
    saturated_intervals,
    sheets,
    transient_window,
)
from pmjoint_codegen.simulate.style import png, wrapped

LIMIT = 10.0


@pytest.fixture(scope="module")
def real() -> Run:
    """Return the paper's run."""
    return ClosedLoop.load("paper").simulate()


@pytest.fixture(scope="module")
def manifest(real: Run) -> Manifest:
    """Return the paper's manifest."""
    return real.manifest


@pytest.fixture
def run(real: Run) -> Run:
    """Return a run whose columns are decaying waves, with nearly the paper's saturation."""
    t = real.t
    signals = np.column_stack([np.exp(-t) * np.sin(t + k) for k in range(real.signals.shape[1])])
    states = np.column_stack([np.exp(-t) * np.cos(t + k) for k in range(real.states.shape[1])])
    switches = ((0.055, 0), (0.072, 1), (0.222, 0))
    return replace(real, signals=signals, states=states, switches=switches, initial_mode=-1)


def cut(run: Run, rows: int) -> Run:
    """Return the first rows of a run."""
    return replace(run, t=run.t[:rows], states=run.states[:rows], signals=run.signals[:rows])


def third_order(manifest: Manifest) -> Manifest:
    """Return a manifest of order 3 with relative degree 3."""
    names = ["x1", "x2", "x3", "r1", "r2", "r3"]
    seen = ["y", "y_r", "e", "z1", "z2", "z3", "alpha1", "alpha2", "v", "u", "x_hat1", "x_hat2", "x_hat3"]
    parameters = tuple(
        item for item in manifest.parameters if item.name in {"d1", "b0", "u_max", "compensator"}
    )
    return replace(
        manifest,
        name="third",
        n=3,
        rho=3,
        states=tuple(Variable(name, "rad/s^2", "") for name in names),
        blocks={"x": (0, 3), "r": (3, 6)},
        signals=tuple(Variable(name, "rad", "") for name in seen),
        parameters=parameters,
    )


class Columns(SimpleNamespace):
    """A stand-in of a run, of which only this is read: no column is all zero."""

    def __getitem__(self, column: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.ones(2)


def size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG file, which stand in its header."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_the_papers_figures_have_the_papers_numbers(run: Run) -> None:
    assert [sheet.stem for sheet in sheets(run)] == [
        "figure1_tracking_error",
        "figure2_x2",
        "figure3_r1",
        "figure4_r2",
        "figure5_v_u",
        "figure6_estimate",
    ]


def test_other_orders_have_a_figure_for_each_state(manifest: Manifest) -> None:
    run = Columns(
        manifest=third_order(manifest),
        settings=SimpleNamespace(parameters={"u_max": LIMIT}, reference=None),
        switches=(),
        initial_mode=0,
        t=np.array([0.0, 1.0]),
    )
    stems = [sheet.stem.partition("_")[2] for sheet in sheets(cast("Run", run))]
    assert stems == ["tracking_error", "x2", "x3", "r1", "r2", "r3", "v_u", "estimate"]


def test_every_figure_is_written_whole_and_reproducibly(run: Run, tmp_path: Path) -> None:
    told: list[float] = []
    paths = write_figures(run, tmp_path, progress=told.append)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}
    assert len(paths) == 7
    assert told[-1] == 1.0
    assert told == sorted(told)
    for path in paths:
        width, height = size(path.read_bytes())
        assert width == 1386  # 6.3 inches at 220 dots an inch
        assert 500 < height < 1600  # one panel to four, and a caption
    sheet = sheets(run)[0]
    assert png(draw(run, sheet), STYLE) == png(draw(run, sheet), STYLE)


def test_curves_are_the_runs_own(run: Run) -> None:
    for sheet in sheets(run):
        figure = draw(run, sheet)
        whole = figure.axes[1::2]  # transient, whole run, transient, whole run, ...
        assert len(whole) == len(sheet.panels)
        for axes, panel in zip(whole, sheet.panels, strict=True):
            drawn = {line.get_label(): line for line in axes.get_lines()}
            for line in panel.lines:
                np.testing.assert_array_equal(drawn[line.label].get_xdata(), run.t)
                np.testing.assert_array_equal(drawn[line.label].get_ydata(), line.values(run))
            assert axes.get_xlim() == (0.0, 20.0)
            assert panel.lines[0].column == "x1-x_hat1" or "(" in panel.label  # a unit


def test_the_transient_is_drawn_from_the_finer_run(run: Run) -> None:
    window = transient_window(run)
    assert window == pytest.approx(0.444)
    finer = cut(run, 30)
    figure = draw(run, sheets(run)[1], detail=finer)
    (curve,) = (line for line in figure.axes[0].get_lines() if line.get_label() == "$x_2$")
    assert len(np.asarray(curve.get_xdata())) == 30
    assert figure.axes[0].get_xlim() == (0.0, window)


def test_saturated_intervals_follow_the_switches(run: Run) -> None:
    assert saturated_intervals(run) == ((0.0, 0.055, -1), (0.072, 0.222, 1))
    assert saturated_intervals(replace(run, switches=(), initial_mode=0)) == ()
    assert saturated_intervals(replace(run, switches=(), initial_mode=1)) == ((0.0, 20.0, 1),)
    assert saturated_intervals(replace(run, switches=((0.0, 1), (1.0, 0)), initial_mode=-1)) == (
        (0.0, 1.0, 1),
    )


@pytest.mark.parametrize(
    ("switches", "mode"),
    [((), 0), ((), 1), (((0.5, 0), (15.0, 1), (18.0, 0)), 1)],
    ids=["never", "always", "late"],
)
def test_without_a_short_transient_there_is_one_column(
    run: Run, switches: tuple[tuple[float, int], ...], mode: int
) -> None:
    run = replace(run, switches=switches, initial_mode=mode)
    assert transient_window(run) is None
    sheet = sheets(run)[4]
    assert len(draw(run, sheet).axes) == len(sheet.panels)


def test_captions_say_what_is_assumed_and_what_is_changed(run: Run, manifest: Manifest) -> None:
    settings = make_settings(manifest, parameters={"c1": 20.0}, x0=[1.0, 0.0], horizon=5.0)
    run = replace(run, settings=settings)
    assert changes(run) == ("horizon 5 s", "c1 = 20", "x(0) = (1, 0)")
    said = sentence(run, ["disturbance = (0, 0)"])
    assert said.startswith("Assumed, not stated in the paper: y_r = sin(t).")
    assert said.endswith("Changed: horizon 5 s, c1 = 20, x(0) = (1, 0), disturbance = (0, 0).")
    for sheet in sheets(run):
        assert "Assumed, not stated in the paper" in caption(run, sheet, ())
    printed = " ".join(text.get_text() for text in overview(run).texts)
    assert "Assumed, not stated in the paper" in printed
    assert manifest.title in printed


def test_captions_say_that_the_compensator_is_off(run: Run, manifest: Manifest) -> None:
    settings = make_settings(manifest, compensator=False)
    assert changes(replace(run, settings=settings)) == ("compensator off",)


def test_other_models_captions_do_not_speak_of_the_paper(run: Run, manifest: Manifest) -> None:
    run = replace(run, manifest=replace(manifest, name="joint"))
    assert "paper" not in sentence(run)
    assert "y_r = sin(t), horizon 20 s" in sentence(run)


def test_a_sampled_run_names_its_sample_time(run: Run, manifest: Manifest) -> None:
    settings = make_settings(manifest, controller="sampled", sample_time=0.002)
    assert "sample time 0.002 s" in sentence(replace(run, settings=settings))


@pytest.mark.parametrize("rows", [1, 2, 400], ids=["at once", "after a step", "midway"])
def test_a_run_that_failed_is_drawn_as_far_as_it_went(run: Run, rows: int) -> None:
    message = "diverged: a state passed 1e+09 at t = 4 s"
    run = replace(cut(run, rows), status=Status.DIVERGED, message=message, switches=())
    run.states[-1] = 1e9
    for sheet in sheets(run):
        assert message in caption(run, sheet, ())
    png(draw(run, sheets(run)[4]), STYLE)
    png(overview(run), STYLE)


def test_the_actuators_limit_is_marked_and_v_is_clipped_beside_its_transient(run: Run) -> None:
    sheet = sheets(run)[4]
    assert sheet.panels[0].levels == (-LIMIT, LIMIT)
    figure = draw(run, sheet)
    assert figure.axes[1].get_ylim() == (-1.35 * LIMIT, 1.35 * LIMIT)
    assert "0.055 s" in sheet.caption
    assert "0.222 s" in sheet.caption


def test_units_are_set_as_printed(manifest: Manifest) -> None:
    assert unit_text(manifest, "x2") == " (rad/s)"
    assert unit_text(replace(manifest, states=(Variable("x2", "rad/s^2", ""),)), "x2") == " (rad/s$^{2}$)"
    assert unit_text(replace(manifest, states=(Variable("x2", "1", ""),)), "x2") == ""


def test_captions_wrap_by_printed_length_and_keep_formulas_whole() -> None:
    text = "A caption about $u = \\mathrm{sat}(v)$ and $-u_{\\max}$ " * 8
    lines = wrapped(text)
    assert " ".join(lines) == text.strip()
    assert len(lines) > 1
    assert all(line.count("$") % 2 == 0 for line in lines)


def test_a_chattering_run_is_drawn_with_two_shapes(run: Run) -> None:
    instants = np.linspace(0.0, 20.0, 50_001)[1:]
    switches = tuple((float(t), (0, 1, 0, -1)[k % 4]) for k, t in enumerate(instants))
    axes = overview(replace(run, switches=switches)).axes[0]
    assert len(axes.collections) == 2


def test_drawing_leaves_matplotlib_as_it_was(run: Run) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    stream = BytesIO()
    overview(run).savefig(stream, format="pdf")
    assert stream.getvalue().startswith(b"%PDF")
    assert dict(mpl.rcParams) == before


def test_a_run_without_numbers_still_draws(run: Run) -> None:
    run.signals[5:] = math.nan
    png(overview(run), STYLE)
