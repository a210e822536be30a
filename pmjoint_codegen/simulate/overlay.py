"""Draws several runs over each other, each in its own colour and dash, with one legend for all panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError, did_you_mean, quoted
from pmjoint_codegen.simulate.assumptions import parts_of
from pmjoint_codegen.simulate.blocks import compensator_states
from pmjoint_codegen.simulate.chosen import WHERE, chosen_panels
from pmjoint_codegen.simulate.estimates import estimates
from pmjoint_codegen.simulate.figures import (
    TOP,
    canvas,
    caption_lines,
    clip_axis,
    finish,
    look_of,
    say_zero,
    set_ticks,
)
from pmjoint_codegen.simulate.panels import Panel
from pmjoint_codegen.simulate.sheets import input_clip, plain
from pmjoint_codegen.simulate.style import GREY, styled
from pmjoint_codegen.simulate.symbols import symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmjoint_codegen.simulate.compare import Comparison
    from pmjoint_codegen.simulate.page import Page
    from pmjoint_codegen.simulate.record import Record

# Colours of Okabe and Ito, which colour-blind readers tell apart; the dashes do in black and white.
LOOKS: Final[tuple[tuple[str, Any], ...]] = (
    ("#000000", "-"),
    ("#0072B2", (0, (5, 1.5))),
    ("#D55E00", (0, (1, 1))),
    ("#009E73", (0, (6, 1.5, 1, 1.5))),
    ("#CC79A7", (0, (3, 1, 1, 1, 1, 1))),
    ("#56B4E9", (0, (9, 2))),
    ("#E69F00", (0, (2, 2))),
    ("#555555", (0, (8, 2, 2, 2))),
)
LEGEND_LINE: Final = 0.2  # inches
_CHARACTERS: Final = 105  # of a legend's line on a printed page
_HANDLE: Final = 8  # characters that a curve and the space beside it take
_HEIGHT: Final = 1.25  # inches of a panel


def overlay(comparison: Comparison, signals: Sequence[str] | None, page: Page) -> Figure:
    """Draw one figure of all runs; see `Comparison.plot`."""
    runs = comparison.runs
    panels = _panels(comparison, signals)
    names = [typeset(label) for label in comparison.labels]
    with styled(look_of(page)):
        rows = _legend_rows(comparison.labels, page)
        columns = 1 if len(panels) < 3 or page.relative < 0.7 else 2
        deep = (len(panels) + columns - 1) // columns
        lines = caption_lines(_caption(comparison), page)
        top = TOP + LEGEND_LINE * len(rows)
        figure, grid = canvas(page, deep, (1.0,) * columns, _HEIGHT, len(lines), gap=0.62, top=top)
        for axes in [axes for row in grid for axes in row][len(panels) :]:
            grid[-1].remove(axes)
            axes.remove()
        for axes, panel in zip((axes for row in grid for axes in row), panels, strict=True):
            _draw(axes, runs, names, panel, page)
        finish(figure, grid, lines, page)
        _name_runs(figure, names, rows, page)
    return figure


def typeset(label: str) -> str:
    """A label with its parameters as mathematics: ``c1 = 20`` has an index."""
    return ", ".join(_typeset(part) for part in label.split(", "))


def _typeset(part: str) -> str:
    name, sign, value = part.partition(" = ")
    if not sign or not name.replace("_", "").isalnum():
        return plain(part)
    return f"{symbol(name)} = {plain(value)}"


def _panels(comparison: Comparison, signals: Sequence[str] | None) -> tuple[Panel, ...]:
    """The chosen panels, or those that show most; each of columns that every run has in one unit."""
    runs, common = comparison.runs, comparison.signals
    if signals is not None:
        for name in (part for entry in signals for piece in entry.split("+") for part in piece.split("-")):
            if name.strip() not in common and name.strip() != "t":
                raise UsageError(
                    f"not every run has a column {quoted(name)} in one unit",
                    where=WHERE,
                    remedy=f"{did_you_mean(name, common, str)}columns: {', '.join(common)}",
                )
        return tuple(_clipped(panel, runs) for panel in chosen_panels(runs[0], signals))
    n = min(run.manifest.n for run in runs)
    wanted = ["y+y_r", "e", "v", "u"]
    driven = [name for name in compensator_states(runs[0].manifest) if name in common]
    wanted += [name for name in driven if any(run[name].any() for run in runs)]
    wanted += [f"x{i}-x_hat{i}" for i in range(1, n + 1)]
    wanted += [item.name for item in estimates(runs[0])]
    pieces = {entry: [part for name in entry.split("+") for part in name.split("-")] for entry in wanted}
    known = [entry for entry in wanted if all(part in common for part in pieces[entry])]
    return tuple(_clipped(panel, runs) for panel in chosen_panels(runs[0], known))


def _clipped(panel: Panel, runs: Sequence[Record]) -> Panel:
    """The same panel; one of v alone is clipped as in the figures of one run, if it would be in each."""
    clips = [input_clip(run) for run in runs]
    if [line.column for line in panel.lines] != ["v"] or None in clips:
        return panel
    return replace(panel, clip=max(clip for clip in clips if clip is not None))


def _draw(axes: Axes, runs: Sequence[Record], names: Sequence[str], panel: Panel, page: Page) -> None:
    """One panel: its main curve of every run, thin others in the same colour, what is common in grey."""
    axes.axhline(0.0, color=GREY, linewidth=0.3 * page.scale, zorder=1)
    *others, main = panel.lines
    thin = 0.7 * page.scale
    for line in others:
        if _common([line.values(run) for run in runs]):
            axes.plot(runs[0].t, line.values(runs[0]), ":", color=GREY, linewidth=1.3 * thin)
            continue
        for run, (colour, _) in zip(runs, LOOKS, strict=False):
            axes.plot(run.t, line.values(run), ":", color=colour, linewidth=thin)
    for run, name, (colour, dash) in zip(runs, names, LOOKS, strict=False):
        axes.plot(run.t, main.values(run), color=colour, linestyle=dash, label=name, zorder=3)
    end = max(float(run.t[-1]) for run in runs)
    if end > 0:
        axes.set_xlim(0.0, end)
    set_ticks(axes, page)
    axes.set_ylabel(panel.label if not others else _main_label(panel))
    if others:
        shown = ", ".join(line.label for line in reversed(others))
        place: dict[str, Any] = {"ha": "right", "va": "bottom", "fontsize": 7.5 * page.scale, "color": GREY}
        axes.text(1.0, 1.01, f"dotted: {shown}", transform=axes.transAxes, **place)
    if panel.clip is not None:
        largest = max(runs, key=lambda run: run.peaks[main.column][0])
        clip_axis(axes, largest, panel, page)
    if all(panel.is_zero(run) for run in runs):
        say_zero(axes, page)


def _main_label(panel: Panel) -> str:
    """The label of a panel that names its main curve alone."""
    _, space, unit = panel.label.partition(" (")
    return panel.lines[-1].label + space + unit


def _common(curves: Sequence[Any]) -> bool:
    return all(np.array_equal(curve, curves[0]) for curve in curves)


def _legend_rows(labels: Sequence[str], page: Page) -> list[int]:
    """How many runs each line of the legend names: as many as fit."""
    rows, used = [0], 0
    for label in labels:
        length = len(label) + _HANDLE
        if rows[-1] and used + length > _CHARACTERS * page.relative:
            rows.append(0)
            used = 0
        rows[-1] += 1
        used += length
    return rows


def _name_runs(figure: Figure, names: Sequence[str], rows: Sequence[int], page: Page) -> None:
    """Write the legend above all panels, one line below the other."""
    handles = figure.axes[0].get_legend_handles_labels()[0]
    height, first = figure.get_figheight() / page.scale, 0
    for k, count in enumerate(rows):
        chosen = slice(first, first + count)
        top = 1.0 - (0.06 + LEGEND_LINE * k) / height
        figure.legend(
            handles[chosen],
            names[chosen],
            loc="upper right",
            bbox_to_anchor=(1.0 - 0.16 * page.scale / page.width, top),
            ncols=count,
            borderaxespad=0.0,
            borderpad=0.0,
            handlelength=2.6,
            columnspacing=1.4,
        )
        first += count


def _caption(comparison: Comparison) -> str:
    """The models' titles, and the settings that all runs share."""
    titles = dict.fromkeys(run.manifest.title for run in comparison.runs)
    found = [parts_of(run) for run in comparison.runs]
    shared = {
        label: [item for item in items if all(item in parts[label] for parts in found)]
        for label, items in found[0].items()
    }
    said = [f"{label}: {', '.join(items)}." for label, items in shared.items() if items]
    return plain(" ".join([f"{'; '.join(titles)}.", *said])).replace("y_r =", "$y_r$ =")
