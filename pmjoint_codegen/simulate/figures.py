"""Draws the figures of one run in the style of a paper.

Each shows the whole run and, if there is one, the saturated transient beside it, above a caption that lists
the assumed settings. Matplotlib is imported only inside functions and used without its global state, so a
figure can be drawn in any program.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pmjoint_codegen import storage
from pmjoint_codegen.simulate.sheets import (
    Panel,
    Sheet,
    caption,
    limit_name,
    overview_caption,
    overview_panels,
    saturated_intervals,
    sheets,
    transient_window,
)
from pmjoint_codegen.simulate.style import GREY, png, styled, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmjoint_codegen.simulate.against import Log
    from pmjoint_codegen.simulate.record import Record

WIDTH = 6.3  # inches, the text width of a printed page
LEFT, RIGHT, TOP, BOTTOM = 0.62, 0.16, 0.24, 0.42  # inches around the panels
GAP, COLUMN_GAP = 0.22, 0.42  # inches between panels
LABEL = 0.37  # inches from a panel to its vertical label
CAPTION_LINE = 0.165  # inches
LONG_LEGEND: Final = 60  # characters of all labels, as Matplotlib's mathematics, above a panel of half a page
SHADE = {-1: "#d9e3ee", 1: "#f3dcd6"}  # saturated below, above
STYLE: Final = {
    "axes.labelsize": 10.0,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.08,
    "axes.formatter.limits": (-4, 5),
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
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[Path, ...]:
    """Draw every figure of a run and the overview as PNG files.

    Args:
        run: what to draw; a run that ended early is drawn up to its end.
        folder: for the files; each appears whole or not at all.
        detail: the same run up to its `transient_window` at a finer output step, for the transient's panel.
        notes: changes to mention in the captions that the run itself cannot recognise as such.
        log: a recorded run, drawn as dots over the curves of the same names.
        progress: called periodically with the fraction completed.

    Raises:
        UsageError: a file cannot be written.
    """
    plans = sheets(run)
    paths = []
    for done, sheet in enumerate((None, *plans), start=1):
        figure = (
            draw(run, sheet, detail=detail, notes=notes, log=log)
            if sheet
            else overview(run, notes=notes, log=log)
        )
        path = folder / f"{sheet.stem if sheet else 'overview'}.png"
        storage.write_bytes(path, png(figure, STYLE))
        paths.append(path)
        progress(done / (len(plans) + 1))
    return tuple(paths)


def draw(
    run: Record,
    sheet: Sheet,
    *,
    detail: Record | None = None,
    notes: Sequence[str] = (),
    log: Log | None = None,
) -> Figure:
    """Draw one figure: the whole run on the right, the saturated transient, if there is one, on the left."""
    window = transient_window(run)
    with styled(STYLE):
        lines = wrapped(caption(run, sheet, notes))
        height = 1.75 if len(sheet.panels) == 1 else 1.3
        figure, grid = _canvas(len(sheet.panels), (1.0, 1.9) if window else (1.0,), height, len(lines))
        for row, panel in zip(grid, sheet.panels, strict=True):
            if window:
                _plot(row[0], detail or run, panel, window, log)
            _plot(row[-1], run, panel, None, log)
            row[0].set_ylabel(panel.label)
            _legend(row[-1], panel)
        if window:
            _name_limits(grid[0][0], run, window)
        _finish(figure, grid, lines)
    return figure


def overview(run: Record, *, notes: Sequence[str] = (), log: Log | None = None) -> Figure:
    """Draw the whole run on one page."""
    with styled(STYLE):
        lines = wrapped(overview_caption(run, notes))
        figure, grid = _canvas(3, (1.0, 1.0), 1.25, len(lines), gap=LEFT)
        for axes, panel in zip((axes for row in grid for axes in row), overview_panels(run), strict=True):
            _plot(axes, run, panel, None, log)
            axes.set_ylabel(panel.label)
            _legend(axes, panel)
        _finish(figure, grid, lines)
    return figure


def _canvas(
    rows: int, widths: Sequence[float], height: float, caption_lines: int, gap: float = COLUMN_GAP
) -> tuple[Figure, list[list[Axes]]]:
    """Lay out panels of a fixed height, in inches, above room for the caption."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    total = TOP + rows * height + (rows - 1) * GAP + BOTTOM + CAPTION_LINE * caption_lines + 0.08
    figure = Figure(figsize=(WIDTH, total))
    FigureCanvasAgg(figure)
    free = WIDTH - LEFT - RIGHT - gap * (len(widths) - 1)
    grid = []
    for row in range(rows):
        left, line = LEFT, []
        bottom = total - TOP - (row + 1) * height - row * GAP
        for share in widths:
            width = free * share / sum(widths)
            line.append(figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total)))
            left += width + gap
        grid.append(line)
    return figure, grid


def _plot(axes: Axes, run: Record, panel: Panel, until: float | None, log: Log | None) -> None:
    """Draw the curves of a panel over the time to `until` (all of it for None), on shaded saturation."""
    from matplotlib.ticker import MaxNLocator

    _shade(axes, run)
    axes.axhline(0.0, color=GREY, linewidth=0.3, zorder=1)
    for mark in (*panel.marks, *panel.levels):
        axes.axhline(mark, color=GREY, linewidth=0.5, linestyle=(0, (1, 2)), zorder=1)
    end = float(run.t[-1]) if until is None else until
    chosen = run.t <= end
    for line in panel.lines:
        axes.plot(run.t[chosen], line.values(run)[chosen], line.dash, color=line.colour, label=line.label)
        if log is not None and line.column in log.columns:
            seen = (log.t >= 0.0) & (log.t <= end)
            recorded: dict[str, Any] = {"markersize": 1.6, "color": line.colour, "alpha": 0.6}
            axes.plot(log.t[seen], log.columns[line.column][seen] / line.unit, ".", **recorded)
    if end > 0:  # a run may have ended at its start
        axes.set_xlim(0.0, end)
    if panel.clip is not None and until is None:
        axes.set_ylim(-panel.clip, panel.clip)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))


def _shade(axes: Axes, run: Record) -> None:
    """Shade where u is at a limit: one shape per limit, however often the run switches."""
    for mode, colour in SHADE.items():
        spans = [(start, stop) for start, stop, which in saturated_intervals(run) if which == mode]
        corners = [t for start, stop in spans for t in (start, start, stop, stop)]
        height = [0.0, 1.0, 1.0, 0.0] * len(spans)
        across = axes.get_xaxis_transform()
        axes.fill_between(corners, 0.0, height, color=colour, linewidth=0, zorder=0, transform=across)


def _name_limits(axes: Axes, run: Record, until: float) -> None:
    """Name the limit above each shaded interval of the transient that is wide enough."""
    above = axes.get_xaxis_transform()
    text: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 8, "color": GREY}
    for start, stop, mode in saturated_intervals(run):
        if stop - start > 0.08 * until:
            axes.text((start + stop) / 2, 1.02, limit_name(run, mode), transform=above, **text)


def _legend(axes: Axes, panel: Panel) -> None:
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
        if sum(map(len, names)) > LONG_LEGEND:  # it would run into the panel on the left
            tight |= {"handlelength": 0.9, "handletextpad": 0.3, "columnspacing": 0.8, "fontsize": 7.5}
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(panel.lines), **tight)


def _finish(figure: Figure, grid: list[list[Axes]], caption_lines: Sequence[str]) -> None:
    """Label the time axis once, below the lowest panels, and write the caption."""
    for row in grid[:-1]:
        for axes in row:
            axes.tick_params(labelbottom=False)
    for axes in (axes for row in grid for axes in row):
        axes.yaxis.set_label_coords(-LABEL / (axes.get_position().width * WIDTH), 0.5)
    for axes in grid[-1]:
        axes.set_xlabel("$t$ (s)", labelpad=2)
    height = figure.get_figheight()
    for index, line in enumerate(caption_lines):
        y = (CAPTION_LINE * (len(caption_lines) - index) - 0.02) / height
        figure.text((LEFT - LABEL) / WIDTH, y, line, fontsize=8.2, va="top")
