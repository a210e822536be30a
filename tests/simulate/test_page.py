"""Figures for a page: its width and text, formats of the files, one unit an axis, zeros and clipped peaks."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.simulate.figures import draw, look_of, overview
from pmjoint_codegen.simulate.page import Page, page_of
from pmjoint_codegen.simulate.sheets import overview_panels, sheets
from pmjoint_codegen.simulate.style import rendered
from pmjoint_codegen.simulate.summary import units_of
from tests.figure_texts import flaws

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGES = {
    "paper": page_of(),
    "column": page_of(width="ieee"),
    "wide": page_of(width="elsevier-wide", caption=False),
    "slides": page_of("slides"),
}


SHIPPED = sorted(file.stem for file in (Path(__file__).resolve().parents[2] / "models").glob("*.toml"))
RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in SHIPPED},
    "clip": ("paper", {"compensator": False}),
    "sampled": ("paper", {"controller": "sampled", "sample_time": 0.01}),
    "diverging": ("paper", {"x0": [70.2, 0.0]}),
}


# The narrow column has the least room, so every run is drawn for it; on the other pages, the fullest figures.
DRAWN = [(name, "column") for name in RUNS] + [
    (name, page) for page in PAGES if page != "column" for name in ("sampled", "joint-lag")
]


@pytest.fixture(scope="module", params=["paper", "clip", "joint", "third-order"])
def run(request: pytest.FixtureRequest) -> Run:
    model, settings = RUNS[request.param]
    return ClosedLoop.load(model).simulate(**settings)


@pytest.fixture(scope="module")
def paper() -> Run:
    return ClosedLoop.load("paper").simulate()


def figures(run: Run, page: Page) -> Iterator[Figure]:
    yield overview(run, page=page)
    for sheet in sheets(run):
        yield draw(run, sheet, page=page)


@pytest.mark.parametrize(("name", "page"), DRAWN)
def test_texts_lie_inside_the_figure_and_apart(name: str, page: str) -> None:
    model, settings = RUNS[name]
    run = ClosedLoop.load(model).simulate(**settings)
    for figure in figures(run, PAGES[page]):
        assert flaws(figure, look_of(PAGES[page])) == []


def test_every_panel_has_one_unit(run: Run) -> None:
    units = units_of(run, ())
    for panel in (*overview_panels(run), *(panel for sheet in sheets(run) for panel in sheet.panels)):
        shown = {units[name] for line in panel.lines for name in line.column.split("-")}
        assert len(shown) == 1, (panel.label, shown)


def test_a_compensator_that_stays_zero_has_no_figure(run: Run) -> None:
    stems = [sheet.stem for sheet in sheets(run)]
    zero = [name for name in ("r1", "r2") if name in run.columns and not run[name].any()]
    assert [
        name for name in ("r1", "r2") if any(re.fullmatch(rf"figure\d_{name}", stem) for stem in stems)
    ] == [name for name in ("r1", "r2") if name not in zero]
    lines = [line.column for panel in overview_panels(run) for line in panel.lines]
    assert not set(zero) & set(lines)


def test_figures_keep_the_papers_numbers_without_a_compensator() -> None:
    run = ClosedLoop.load("paper").simulate(compensator=False)
    assert [sheet.stem for sheet in sheets(run)] == [
        *("figure1_tracking_error", "figure2_x2", "figure5_v_u", "figure6_estimate")
    ]


def test_a_signal_that_is_zero_says_so_and_has_no_scale(paper: Run) -> None:
    rest = replace(paper, states=np.zeros_like(paper.states), switches=(), initial_mode=0)
    (axes,) = draw(rest, next(sheet for sheet in sheets(rest) if sheet.stem == "figure2_x2")).axes
    assert [text.get_text() for text in axes.texts] == ["exactly 0"]
    assert axes.get_yticks().tolist() == [0.0]


def test_a_clipped_curve_carries_its_peak(paper: Run) -> None:
    figure = draw(paper, sheets(paper)[4])
    said = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert said[-1] == "$|v|$ up to 225.7 at 0 s"
    assert paper.peaks["v"] == (225.68020625, 0.0)
    assert figure.axes[1].get_ylim()[1] < 225.68


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_files_have_the_same_bytes_at_any_time(
    paper: Run, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = page_of(width="ieee")
    sheet = sheets(paper)[0]
    first = rendered(draw(paper, sheet, page=page), look_of(page), kind)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1")  # what Matplotlib takes in place of the clock
    monkeypatch.setattr(time, "time", lambda: 1.0)
    assert rendered(draw(paper, sheet, page=page), look_of(page), kind) == first
    if kind == "svg":
        assert b'width="252pt"' in first  # 3.5 inches
        assert b"<dc:date>" not in first
    if kind == "pdf":
        assert b"/CreationDate" not in first
        assert b"/Type3" not in first and b"/TrueType" not in first.replace(b"/CIDFontType2", b"")


def test_pages_have_the_publishers_widths() -> None:
    assert page_of(width="ieee").width == 3.5
    assert page_of(width="elsevier").width * 25.4 == pytest.approx(90.0, rel=1e-15)
    assert page_of(width="12 cm").width == pytest.approx(page_of(width="120mm").width, rel=1e-15)
    assert page_of("slides").scale == 1.6
    assert page_of("slides", "5in").scale == 0.8
    with pytest.raises(UsageError, match="style: is 'poster'; allowed: paper, slides"):
        page_of("poster")


def test_text_of_slides_is_larger_and_a_page_without_caption_has_none(paper: Run) -> None:
    sizes = {}
    for name, page in PAGES.items():
        figure = draw(paper, sheets(paper)[0], page=page)
        assert bool(figure.texts) is page.caption
        sizes[name] = figure.axes[0].yaxis.label.get_fontsize()
    assert sizes == {"paper": 10.0, "column": 8.4, "wide": 10.0, "slides": 16.0}
