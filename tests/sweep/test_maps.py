"""Figures of a sweep, and what they claim: which runs hold the joint, and where no controller can."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.loops.status import holds
from pmjoint_codegen.simulate.style import styled
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.gaps import absence
from pmjoint_codegen.sweep.labels import symbol
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.region import Border, border, held
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import DERIVED_FILES, Store
from tests.figure_texts import flaws

from .conftest import Case

xr = pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.sweep import dataset, maps  # noqa: E402 - after the check for their packages


def made(
    case: Case, folder: Path, grid: tuple[str, ...], sample: tuple[str, ...] = (), **settings: object
) -> Any:
    plan = make_plan(grid, sample, 40 if sample else None, 0, "sobol")
    request = make_request(case.manifest, plan, **settings)  # type: ignore[arg-type]
    store = Store(folder, request, case.manifest.nX)
    store.open()
    execute(store, case.inputs, threads=2, scheduler=None, tell=lambda done: None)
    dataset.assemble(store, case.manifest)
    return dataset.read(store.dataset)


@pytest.mark.parametrize(
    ("grid", "sample", "stems"),
    [
        (
            ("x1=-90:90:7", "x2=-20:20:5", "compensator=0,1"),
            (),
            {"region", "map_ise", "map_max_abs_v", "map_settling_s", "map_saturated_s"},
        ),
        (
            ("c1=5:20:4", "c2=5:20:3", "d1=0.1,0.2,0.3"),
            (),
            {"map_ise", "map_max_abs_v", "map_settling_s", "map_saturated_s"},
        ),
        (("c1=5:20:4",), (), {"curves"}),
        (("compensator=0,1",), ("d1~normal(0.2,0.02)",), {"histograms"}),
        (("compensator=0,1",), (), set()),
    ],
)
def test_dimensions_call_for_their_figures(
    case: Case, tmp_path: Path, grid: tuple[str, ...], sample: tuple[str, ...], stems: set[str]
) -> None:
    data = made(case, tmp_path, grid, sample, horizon=3.0)
    first = maps.write_maps(data, case.manifest, tmp_path)
    assert {path.stem for path in first} == stems
    assert {path.name for path in first} <= set(DERIVED_FILES)
    pictures = [path.read_bytes() for path in first]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert [path.read_bytes() for path in maps.write_maps(data, case.manifest, tmp_path)] == pictures


def test_the_border_is_where_the_actuator_just_balances_the_unstable_mode(case: Case) -> None:
    values = dict(zip(case.manifest.parameter_names, case.request.p, strict=True))
    line = border(case.manifest, values)
    assert line is not None
    assert line == Border(math.sqrt(0.2), (2 * 10 - 0.1) / 0.2)
    # There, q = x1 + x2/slope obeys q' = slope q + b0 u/slope + d/slope, and u = -u_max leaves q' = 0.
    assert line.slope * line.offset - (2.0 * 10.0 - 0.1) / line.slope == pytest.approx(0.0, abs=1e-12)
    assert border(case.manifest, {**values, "d1": -0.2}) is None
    assert border(case.manifest, {name: value for name, value in values.items() if name != "b0"}) is None
    assert border(replace(case.manifest, linear=()), values) is None


def test_the_border_follows_from_the_plant_not_from_names(case: Case) -> None:
    """In the left eigenvector's coordinate the pole is alone, so the border is exact with damping as well."""
    other = replace(case.manifest, linear=("-damp", "stiff/2", "-gain"), limit="top", disturbance_bound=0.3)
    names = [
        replace(item, name=name)
        for item, name in zip(case.manifest.parameters, ("damp", "stiff", "gain", "top"), strict=False)
    ]
    other = replace(other, parameters=tuple(names))
    values = {"damp": 0.7, "stiff": 3.0, "gain": 2.5, "top": 4.0}
    line = border(other, values)
    assert line is not None
    A = np.array([[-0.7, 1.0], [1.5, 0.0]])
    left = np.array([1.0, 1.0 / line.slope])
    np.testing.assert_allclose(left @ A, line.slope * left, rtol=1e-14)
    assert line.slope > 0.0
    assert line.slope * line.offset == pytest.approx((2.5 * 4.0 - 0.3) / line.slope)
    assert border(other, {**values, "stiff": -3.0}) is None
    unequal = replace(other, chain={"lower": "bottom", "upper": "top"})
    assert border(unequal, {**values, "bottom": -3.9}) is None
    assert border(unequal, {**values, "bottom": -4.0}) == line


@pytest.mark.parametrize(
    ("grid", "fixed", "limit"),
    [
        ((), {}, (2.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0": 3.0}, (3.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0_plant": 3.0}, (3.0 * 10.0 - 0.1) / 0.2),
        ((), {"b0": 3.0, "b0_plant": 2.0}, (2.0 * 10.0 - 0.1) / 0.2),
        (("b0=2,3",), {}, None),
        (("b0_plant=2,3",), {}, None),
    ],
)
def test_the_border_is_that_of_the_true_plant(
    case: Case, tmp_path: Path, grid: tuple[str, ...], fixed: dict[str, float], limit: float | None
) -> None:
    data = made(case, tmp_path, ("x1=0,1", "x2=0,1", *grid), parameters=fixed, horizon=0.1)
    line = border(case.manifest, maps._fixed(data))
    assert (line and line.offset) == limit


def test_no_run_beyond_the_border_is_held_and_clipping_holds_all_but_its_edge(
    case: Case, tmp_path: Path
) -> None:
    data = made(case, tmp_path, ("x1=-110:110:111",), x0=(0.0, 0.0), compensator=False, horizon=30.0)
    x1 = data["x1"].values
    good = held(data).values
    assert not np.any(good[np.abs(x1) > 100.5])
    assert np.all(good[np.abs(x1) < 98.0])
    law = made(case, tmp_path / "law", ("x1=-110:110:111",), x0=(0.0, 0.0), horizon=30.0)
    lost = ~held(law).values
    assert np.all(lost[np.abs(x1) > 72.5])
    assert not np.any(lost[np.abs(x1) < 68.0])


def drawn(data: Any, case: Case, stem: str) -> Any:
    figure = maps._figures(maps._ascending(data), case.manifest)[stem]
    figure.draw_without_rendering()
    return figure


@pytest.mark.parametrize(
    ("grid", "stem"),
    [
        (("x1=-90:90:7", "x2=-20:20:5"), "region"),
        (("x1=-90:90:7", "x2=-20:20:5", "compensator=0,1"), "region"),
        (("c1=-1:5:3", "x1=-1:1:3"), "map_settling_s"),
        (("x1=-1:1:3",), "curves"),
    ],
)
def test_a_caption_stays_inside_its_figure(
    case: Case, tmp_path: Path, grid: tuple[str, ...], stem: str
) -> None:
    figure = drawn(made(case, tmp_path, grid, horizon=2.0), case, stem)
    words = figure.get_supxlabel()
    assert words
    box = next(text for text in figure.texts if text.get_text() == words).get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1


def test_a_map_of_more_cells_than_pixels_is_thinned_and_says_so(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = made(case, tmp_path, ("x1=-90:90:7", "x2=-20:20:5"), horizon=30.0)
    share = drawn(data, case, "region").axes[0].get_title()
    monkeypatch.setattr(maps, "MOST_CELLS", 4)
    figure = drawn(data, case, "region")
    cells = figure.axes[0].collections[0].get_array()
    settling = data["settling_s"].where(held(data)).transpose("x2", "x1").values[::2, ::2]
    assert np.array_equal(cells.filled(np.nan), settling, equal_nan=True)
    assert "Drawn: 1 in 2 values of $x_{1}$, 1 in 2 values of $x_{2}$." in " ".join(
        figure.get_supxlabel().split()
    )
    assert figure.axes[0].get_title() == share  # of all runs
    monkeypatch.setattr(maps, "MOST_CELLS", 5)  # as many as there are of x2
    for name in ("region", "map_ise"):
        figure = drawn(data, case, name)
        assert figure.axes[0].collections[0].get_array().shape == (5, 4)
        assert "Drawn: 1 in 2 values of $x_{1}$." in " ".join(figure.get_supxlabel().split())


def test_a_map_shows_every_run_where_it_stands_whatever_the_order_and_length_of_the_axes(
    case: Case, tmp_path: Path
) -> None:
    data = made(case, tmp_path, ("x1=3,1,2", "x2=4"), horizon=20.0)
    panel = drawn(data, case, "region").axes[0]
    mesh = panel.collections[0]
    corners = mesh.get_coordinates()
    assert corners[0, :, 0].tolist() == [0.5, 1.5, 2.5, 3.5]
    assert corners[:, 0, 1].tolist() == [2.0, 6.0]
    expected = data["settling_s"].sel(x1=[1, 2, 3], x2=4).values
    assert np.array_equal(mesh.get_array().filled(np.nan)[0], expected, equal_nan=True)
    assert panel.get_ylim() == (2.0, 6.0)


def test_a_curve_shows_points_that_no_line_reaches(case: Case, tmp_path: Path) -> None:
    data = made(case, tmp_path, ("c1=10,-1,15,20",), horizon=2.0)
    panel = drawn(data, case, "curves").axes[0]
    line, dots = panel.lines
    assert line.get_xdata().tolist() == [-1.0, 10.0, 15.0, 20.0]
    assert dots.get_xdata().tolist() == []
    one = made(case, tmp_path / "one", ("c1=15",), horizon=2.0)
    assert drawn(one, case, "curves").axes[0].lines[1].get_xdata().tolist() == [15.0]


def test_captions_name_every_reason_for_a_gap(case: Case, tmp_path: Path) -> None:
    plain = made(case, tmp_path / "plain", ("c1=5,6",), x0=(0.0, 0.0), horizon=2.0)
    assert absence("Gaps", plain, "ise") == ""
    assert absence("Gaps", plain, "settling_s") == "Gaps: it has not settled by the end, or e(0) = 0."
    broken = made(case, tmp_path / "broken", ("c1=-5,6",), x0=(0.0, 0.0), horizon=2.0)
    assert "break a rule of the design" in absence("Gaps", broken, "ise")
    lost = made(case, tmp_path / "lost", ("x1=10,120",), horizon=5.0)
    assert absence("Grey", lost, "ise") == "Grey: the joint diverges."


@pytest.mark.parametrize(
    ("grid", "sample"),
    [
        (("x1=-120:120:7", "x2=-20:20:5", "compensator=0,1"), ()),
        (("ck1=1:4:4", "compensator=0,1"), ()),
        (("compensator=0,1",), ("d1~normal(0.2,0.02)", "ck1~uniform(1,2)")),
        ((), ("ck1~uniform(1,2)",)),
    ],
)
def test_texts_lie_inside_the_figure_and_apart(
    case: Case, tmp_path: Path, grid: tuple[str, ...], sample: tuple[str, ...]
) -> None:
    data = made(case, tmp_path, grid, sample, horizon=3.0)
    with styled(maps._STYLE):
        figures = maps._figures(maps._ascending(data), case.manifest)
    assert figures
    for figure in figures.values():
        assert flaws(figure, maps._STYLE) == []


def test_histograms_count_runs_and_leave_out_what_does_not_differ(case: Case, tmp_path: Path) -> None:
    data = made(case, tmp_path, (), ("ck1~uniform(1,2)",), horizon=3.0)
    figure = drawn(data, case, "histograms")
    shown = {axes.get_xlabel().partition(" (")[0]: axes for axes in figure.axes}
    assert {axes.get_ylabel() for axes in figure.axes} == {"runs"}
    assert "integral of $e^2$" in shown and "largest $|v|$" not in shown  # v is largest at t = 0
    counts = [patch for axes in shown.values() for patch in axes.patches]
    assert all(patch.get_xy()[:, 1].max() >= 1 for patch in counts)
    caption = figure._supxlabel.get_text().replace("\n", " ")
    assert "$c_{k1}$ ~ uniform(1, 2)" in caption and "The same in all: " in caption and "225.68 V" in caption


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("ck1", "$c_{k1}$"),
        ("tau_plant", r"$\tau_{\mathrm{plant}}$"),
        ("J_plant", r"$J_{\mathrm{plant}}$"),
        ("theta_dot", r"$\dot{\theta}$"),
        ("eps0", r"$\varepsilon_{0}$"),
        ("theta", r"$\theta$"),
        ("sample_time", "sample time"),
    ],
)
def test_names_are_typeset(name: str, shown: str) -> None:
    assert symbol(name) == shown


def test_what_ends_inside_its_limits_is_held_even_at_its_largest_error(case: Case, tmp_path: Path) -> None:
    done, beyond = np.array([1, 1, 1, 2]), np.array([5.0, 5.0, 1.0, 5.0])
    good = holds(done, beyond, np.full(4, 5.0), np.array([0.0, 1.0, 1.0, 0.0]))
    assert good.tolist() == [True, False, True, False]
    still = np.array([0.94, 0.96]) * 5.0  # an error that is largest just at the horizon is still growing
    assert holds(done[:2], still, np.full(2, 5.0), np.ones(2)).tolist() == [True, False]
    strong = {"u_max": 1e3}
    data = made(case, tmp_path / "strong", ("c1=10,20",), x0=(0.0, 0.0), parameters=strong, horizon=0.001)
    assert np.array_equal(np.abs(data["final_e"].values), data["max_abs_e"].values)
    assert np.all(held(data).values)
    transient = made(case, tmp_path / "transient", ("x1=-9:9:31",), horizon=1.0)
    assert np.any(transient["saturated_s"].values > 0)
    assert np.any(np.abs(transient["final_e"].values) == transient["max_abs_e"].values)
    assert np.all(held(transient).values)


def test_a_logarithmic_scale_is_for_more_than_a_decade(case: Case, tmp_path: Path) -> None:
    narrow = made(case, tmp_path / "narrow", ("c1=14,15",), horizon=2.0)
    wide = made(case, tmp_path / "wide", ("x1=0.1,10",), horizon=2.0)
    assert drawn(narrow, case, "curves").axes[0].get_yscale() == "linear"
    assert drawn(wide, case, "curves").axes[0].get_yscale() == "log"
