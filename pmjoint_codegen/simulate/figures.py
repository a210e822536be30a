"""Draws the figures of one run in the style of a paper.

Each shows the whole run and, if there is one, the saturated transient beside it, above a caption that lists
the assumed settings. Matplotlib is imported only inside functions and used without its global state, so a
figure can be drawn in any program.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen import storage
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.simulate.chosen import chosen_panels
from pmjoint_codegen.simulate.page import PRINTED, Page
from pmjoint_codegen.simulate.panels import Panel
from pmjoint_codegen.simulate.sheets import (
    Sheet,
    caption,
    limit_name,
    overview_caption,
    overview_panels,
    saturated_intervals,
    sheets,
    transient_window,
)
from pmjoint_codegen.simulate.style import CAPTION_CHARACTERS, GREY, rendered, scaled, styled, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmjoint_codegen.simulate.against import Log
    from pmjoint_codegen.simulate.estimates import FrozenError
    from pmjoint_codegen.simulate.record import Record
    from pmjoint_codegen.simulate.style import Look

LEFT, RIGHT, TOP, BOTTOM = 0.62, 0.16, 0.24, 0.42  # inches around the panels, at the scale 1 as below
GAP, COLUMN_GAP = 0.22, 0.42  # inches between panels
LABEL = 0.37  # inches from a panel to its vertical label
CAPTION_LINE = 0.165  # inches
SHORT_LINE: Final = 0.92  # of the characters that fit on average: wide ones weigh more in a short line
LONG_LEGEND: Final = 60  # characters of all labels, as Matplotlib's mathematics, above a panel of half a page
FEW, WIDE = 5.0, 100.0  # ratios of a logarithmic axis' ends: ticks as on a linear axis, at 1, 2, 5, at 1
SMALL: Final = 0.1  # ticks below this, less than a tenth of it apart, have three decimals
SHADE = {-1: "#d9e3ee", 1: "#f3dcd6"}  # saturated below, above
STYLE: Final = {
    "axes.labelsize": 10.0,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.08,
    "axes.formatter.limits": (-3, 4),  # wider tick labels would meet the axis label
    "axes.formatter.use_mathtext": True,
    "lines.linewidth": 0.9,
    "legend.fontsize": 9.0,
    "xtick.top": True,
    "ytick.right": True,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
}


def write_figures(
    run: Record,
    folder: Path,
    *,
    detail: Record | None = None,
    notes: Sequence[str] = (),
    log: Log | None = None,
    frozen: FrozenError | None = None,
    page: Page = PRINTED,
    kinds: Sequence[str] = ("png",),
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[Path, ...]:
    """Draw every figure of a run and the overview.

    Args:
        run: what to draw; a run that ended early is drawn up to its end.
        folder: for the files; each appears whole or not at all.
        detail: the same run up to its `transient_window` at a finer output step, for the transient's panel.
        notes: changes to mention in the captions that the run itself cannot recognise as such.
        log: a recorded run, drawn as dots over the curves of the same names.
        frozen: the error of the same run without adaptation, for that of an adaptive controller.
        page: that they are drawn for.
        kinds: formats of the files, each one of `style.KINDS`.
        progress: called periodically with the fraction completed.

    Raises:
        UsageError: a file cannot be written.
    """
    plans = sheets(run, frozen)
    paths: list[Path] = []
    for done, sheet in enumerate((None, *plans), start=1):
        figure = (
            draw(run, sheet, detail=detail, notes=notes, log=log, page=page)
            if sheet
            else overview(run, notes=notes, log=log, page=page)
        )
        paths += save_figure(figure, folder / (sheet.stem if sheet else "overview"), page, kinds)
        progress(done / (len(plans) + 1))
    return tuple(paths)


def save_figure(figure: Figure, stem: Path, page: Page, kinds: Sequence[str]) -> tuple[Path, ...]:
    """Write a figure in every format, each file whole or not at all; raises `UsageError` if it cannot."""
    paths = tuple(stem.with_name(f"{stem.name}.{kind}") for kind in kinds)
    for path, kind in zip(paths, kinds, strict=True):
        storage.write_bytes(path, rendered(figure, look_of(page), kind))
    return paths


def look_of(page: Page) -> Look:
    """The style of a page's figures."""
    return scaled(STYLE, page.scale)


def draw(
    run: Record,
    sheet: Sheet,
    *,
    detail: Record | None = None,
    notes: Sequence[str] = (),
    log: Log | None = None,
    page: Page = PRINTED,
) -> Figure:
    """Draw one figure: the whole run on the right, the saturated transient, if there is one, on the left."""
    window = transient_window(run)
    with styled(look_of(page)):
        lines = caption_lines(caption(run, sheet, notes), page)
        height = 1.75 if len(sheet.panels) == 1 else 1.3
        figure, grid = canvas(page, len(sheet.panels), (1.0, 1.9) if window else (1.0,), height, len(lines))
        for row, panel in zip(grid, sheet.panels, strict=True):
            if window:
                _plot(row[0], run, panel, window, log, page, detail)
            _plot(row[-1], run, panel, None, log, page)
            row[0].set_ylabel(panel.label)
            _head(row[-1], panel, page)
        if window:
            _name_limits(grid[0][0], run, window, page)
        finish(figure, grid, lines, page)
    return figure


def overview(
    run: Record, *, notes: Sequence[str] = (), log: Log | None = None, page: Page = PRINTED
) -> Figure:
    """Draw the whole run on one page, in two columns."""
    return _in_columns(run, overview_panels(run), 2, notes, log, page)


def chosen_figure(
    run: Record,
    signals: Sequence[str],
    *,
    notes: Sequence[str] = (),
    log: Log | None = None,
    page: Page = PRINTED,
) -> Figure:
    """Draw signals that a user names over the whole run; raises `UsageError` as `chosen_panels` does."""
    return _in_columns(run, chosen_panels(run, signals), 1 if len(signals) < 3 else 2, notes, log, page)


def draw_onto(axes: Axes, run: Record, panel: Panel) -> None:
    """Draw one panel onto axes of a figure of the caller's own, in whose style it stays."""
    _shade(axes, run)
    for line in panel.lines:
        axes.plot(*line.curve(run), line.dash, color=line.colour, label=line.label)
    axes.set_xlabel("$t$ (s)")
    axes.set_ylabel(panel.label)
    if run.t.size and run.t[-1] > 0:
        axes.set_xlim(0.0, float(run.t[-1]))
    if panel.needs_legend:
        axes.legend()


def _in_columns(
    run: Record, panels: Sequence[Panel], columns: int, notes: Sequence[str], log: Log | None, page: Page
) -> Figure:
    """Draw panels over the whole run, side by side in columns, row by row."""
    with styled(look_of(page)):
        lines = caption_lines(overview_caption(run, notes), page)
        rows = (len(panels) + columns - 1) // columns
        figure, grid = canvas(page, rows, (1.0,) * columns, 1.25, len(lines), gap=LEFT)
        if len(panels) % columns:
            grid[-1].pop().remove()
        for axes, panel in zip((axes for row in grid for axes in row), panels, strict=True):
            _plot(axes, run, panel, None, log, page)
            axes.set_ylabel(panel.label)
            _head(axes, panel, page)
        finish(figure, grid, lines, page)
    return figure


def caption_lines(text: str, page: Page) -> list[str]:
    """The lines of a caption; none for a page without."""
    share = page.relative * (1.0 if page.relative >= 1.0 else SHORT_LINE)
    return wrapped(text, round(CAPTION_CHARACTERS * share)) if page.caption else []


def canvas(
    page: Page,
    rows: int,
    widths: Sequence[float],
    height: float,
    lines: int,
    gap: float = COLUMN_GAP,
    top: float = TOP,
) -> tuple[Figure, list[list[Axes]]]:
    """Lay out panels of a fixed height, in inches at the scale 1, above room for the caption's lines."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    wide = page.width / page.scale
    total = top + rows * height + (rows - 1) * GAP + BOTTOM + CAPTION_LINE * lines + 0.08
    figure = Figure(figsize=(page.width, total * page.scale))
    FigureCanvasAgg(figure)
    free = wide - LEFT - RIGHT - gap * (len(widths) - 1)
    grid = []
    for row in range(rows):
        left, line = LEFT, []
        bottom = total - top - (row + 1) * height - row * GAP
        for share in widths:
            width = free * share / sum(widths)
            line.append(figure.add_axes((left / wide, bottom / total, width / wide, height / total)))
            left += width + gap
        grid.append(line)
    return figure, grid


def _plot(
    axes: Axes,
    run: Record,
    panel: Panel,
    until: float | None,
    log: Log | None,
    page: Page,
    detail: Record | None = None,
) -> None:
    """Draw the curves of a panel, those of `detail` if given, over the time to `until` (None: all of it)."""
    _shade(axes, run)
    if panel.based and not panel.decades:
        axes.axhline(0.0, color=GREY, linewidth=0.3 * page.scale, zorder=1)
    for mark in (*panel.marks, *panel.levels):
        axes.axhline(mark, color=GREY, linewidth=0.5 * page.scale, linestyle=(0, (1, 2)), zorder=1)
    end = float(run.t[-1]) if until is None else until
    for line in panel.lines:
        t, values = line.curve(detail or run)
        chosen = t <= end
        shown = magnitudes(values) if panel.decades else values
        axes.plot(t[chosen], shown[chosen], line.dash, color=line.colour, label=line.label)
        if log is not None and line.column in log.columns:
            seen = (log.t >= 0.0) & (log.t <= end)
            recorded: dict[str, Any] = {"markersize": 1.6 * page.scale, "color": line.colour, "alpha": 0.6}
            axes.plot(log.t[seen], log.columns[line.column][seen] / line.unit, ".", **recorded)
    if end > 0:  # a run may have ended at its start
        axes.set_xlim(0.0, end)
    set_ticks(axes, page, 0 if panel.is_zero(run) else panel.decades)
    if panel.clip is not None and until is None:
        clip_axis(axes, run, panel, page)
    if log is None and panel.is_zero(run):
        say_zero(axes, page)


def magnitudes(values: Array) -> Array:
    """Magnitudes for a logarithmic axis, which has no place for 0."""
    return np.where(values == 0.0, np.nan, np.abs(values))


def set_ticks(axes: Axes, page: Page, decades: int = 0) -> None:
    """Choose few ticks at round numbers, as many as a panel has room for.

    Args:
        axes: of the panel.
        page: that it is drawn for.
        decades: that a logarithmic axis shows; 0: the axis is linear.
    """
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, ScalarFormatter

    across = axes.get_position().width * page.width / page.scale  # inches, as if the text had its usual size
    axes.xaxis.set_major_locator(MaxNLocator(nbins=max(2, min(5, int(across / 0.35))), steps=[1, 2, 5, 10]))
    if decades:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        low = max(low, high * 10.0**-decades)
        axes.set_ylim(low, high)
        axes.yaxis.set_minor_locator(NullLocator())
        if high <= low * WIDE:
            axes.yaxis.set_major_formatter(ScalarFormatter())
        if high > low * FEW:
            subs = (1.0,) if high > low * WIDE else (1.0, 2.0, 5.0)
            axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=6))
            return
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10], min_n_ticks=3))
    low, high = axes.get_ylim()
    ticks = np.array([tick for tick in axes.get_yticks() if low <= tick <= high])
    if not decades and ticks.min() < 0 and np.abs(ticks).max() < SMALL and np.diff(ticks).min() < SMALL / 10:
        axes.ticklabel_format(axis="y", scilimits=(0, 0))  # a label such as -0.005 would meet the axis label
        axes.yaxis.get_offset_text().set_horizontalalignment("right")  # nothing is there, as in `_head`


def clip_axis(axes: Axes, run: Record, panel: Panel, page: Page) -> None:
    """Clip the axis, and say how far a curve goes beyond it."""
    assert panel.clip is not None
    axes.set_ylim(-panel.clip, panel.clip)
    beyond = [(*run.peaks[line.column], line) for line in panel.lines if line.column in run.peaks]
    peak, t, line = max(beyond, key=lambda item: item[0], default=(0.0, 0.0, None))
    if line is not None and peak / line.unit > panel.clip:
        said = f"$|{line.label.strip('$')}|$ up to {peak / line.unit:.4g} at {t:.3g} s"
        place: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7.5 * page.scale, "color": GREY}
        paper = {"facecolor": "white", "edgecolor": "none", "pad": 0.4 * page.scale}
        axes.text(0.985, 0.955, said, transform=axes.transAxes, bbox=paper, **place)


def say_zero(axes: Axes, page: Page) -> None:
    """Say that all curves are exactly 0: a scale would suggest that there is something to see."""
    axes.set_ylim(-1.0, 1.0)
    axes.set_yticks([0.0])
    place: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8 * page.scale, "color": GREY}
    axes.text(0.5, 0.54, "exactly 0", transform=axes.transAxes, **place)


def _shade(axes: Axes, run: Record) -> None:
    """Shade where u is at a limit: one shape per limit, however often the run switches."""
    for mode, colour in SHADE.items():
        spans = [(start, stop) for start, stop, which in saturated_intervals(run) if which == mode]
        corners = [t for start, stop in spans for t in (start, start, stop, stop)]
        height = [0.0, 1.0, 1.0, 0.0] * len(spans)
        across = axes.get_xaxis_transform()
        axes.fill_between(corners, 0.0, height, color=colour, linewidth=0, zorder=0, transform=across)


def _name_limits(axes: Axes, run: Record, until: float, page: Page) -> None:
    """Name the limit above each shaded interval of the transient that is wide enough."""
    above = axes.get_xaxis_transform()
    text: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8 * page.scale, "color": GREY}
    free = axes.bbox.x0  # in pixels: left of it are the tick labels, then the names so far
    for start, stop, mode in saturated_intervals(run):
        if stop - start > 0.08 * until:
            name = axes.text((start + stop) / 2, 1.02, limit_name(run, mode), transform=above, **text)
            box = name.get_window_extent()
            shift = max(0.0, free - box.x0)
            name.set_x((start + stop) / 2 + shift * until / axes.bbox.width)
            free = box.x1 + shift + 0.2 * box.height


def _head(axes: Axes, panel: Panel, page: Page) -> None:
    """Write what stands above a panel: its remark on the left, the legend on the right."""
    if panel.remark:
        place: dict[str, Any] = {"ha": "left", "va": "bottom", "fontsize": 7.5 * page.scale, "color": GREY}
        axes.yaxis.get_offset_text().set_horizontalalignment("right")  # a power of ten would meet the remark
        axes.text(0.0, 1.01, panel.remark, transform=axes.transAxes, **place)
    _legend(axes, panel, page)


def _legend(axes: Axes, panel: Panel, page: Page) -> None:
    """Name the curves above the panel, on its right, where no curve can run through."""
    if panel.needs_legend:
        tight: dict[str, Any] = {
            "borderaxespad": 0.0,
            "borderpad": 0.1,
            "handlelength": 1.8,
            "handletextpad": 0.5,
            "columnspacing": 1.2,
        }
        names = axes.get_legend_handles_labels()[1]
        if sum(map(len, names)) > LONG_LEGEND * page.relative:  # it would run into the panel on the left
            tight |= {
                "handlelength": 0.9,
                "handletextpad": 0.3,
                "columnspacing": 0.8,
                "fontsize": 7.5 * page.scale,
            }
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(panel.lines), **tight)


def finish(figure: Figure, grid: list[list[Axes]], lines: Sequence[str], page: Page) -> None:
    """Label the time axis once in each column, below its lowest panel, and write the caption."""
    columns = max(map(len, grid))
    lowest = [[row[k] for row in grid if k < len(row)][-1] for k in range(columns)]
    for axes in (axes for row in grid for axes in row):
        axes.yaxis.set_label_coords(-LABEL * page.scale / (axes.get_position().width * page.width), 0.5)
        if axes in lowest:
            axes.set_xlabel("$t$ (s)", labelpad=2 * page.scale)
        else:
            axes.tick_params(labelbottom=False)
    height = figure.get_figheight() / page.scale
    for index, line in enumerate(lines):
        y = (CAPTION_LINE * (len(lines) - index) - 0.02) / height
        left = (LEFT - LABEL) * page.scale / page.width
        figure.text(left, y, line, fontsize=8.2 * page.scale, va="top")
