"""A run as a small plot of characters, for a terminal without a display."""

from __future__ import annotations

import math
import os
import shutil
import sys
from typing import TYPE_CHECKING, Final

import click

from pmjoint_codegen.errors import MissingToolError, installing

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

NARROWEST: Final = 40  # columns
WIDEST: Final = 160
ROWS: Final = 13  # of each plot
_PANELS: Final = ((("y_r", "red", "."), ("y", "default", "*")), (("u", "default", "*"),))


def check_plots(wants_json: bool) -> None:
    """Refuse a plot before the run, not after it.

    Raises:
        UsageError: standard output is for one JSON document.
        MissingToolError: plotext is not installed.
    """
    if wants_json:
        raise click.UsageError("--plot contradicts --json")
    try:
        import plotext  # noqa: F401
    except ImportError:
        remedy = f"install it: {installing('pmjoint-codegen[terminal]')}"
        raise MissingToolError("plotext is needed for --plot", remedy=remedy) from None


def terminal_plot(
    run: Record, *, width: int | None = None, colour: bool | None = None, encoding: str | None = None
) -> str:
    """Plot y with y_r, and u, over time.

    Args:
        run: to plot.
        width: in characters; by default the terminal's.
        colour: whether to use escape sequences; by default on a terminal without ``NO_COLOR``.
        encoding: of the output, by default that of standard output: without box-drawing characters in it, the
            plot is ASCII.
    """
    columns = width or shutil.get_terminal_size((80, 24)).columns
    wide = max(NARROWEST, min(columns, WIDEST))
    coloured = _wants_colour() if colour is None else colour
    rich = _draws_boxes(encoding or getattr(sys.stdout, "encoding", None) or "ascii")
    return "\n".join(_panel(run, names, wide, coloured, rich) for names in _PANELS)


def _wants_colour() -> bool:
    return not os.environ.get("NO_COLOR") and sys.stdout is not None and sys.stdout.isatty()


def _draws_boxes(encoding: str) -> bool:
    """Whether an encoding has the characters of plots."""
    try:
        "┌─┐│┤┬└┘⢸".encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _panel(
    run: Record, curves: tuple[tuple[str, str, str], ...], width: int, colour: bool, rich: bool
) -> str:
    """One plot; plotext keeps its figure in the module, so it is cleared before and after."""
    import plotext

    from pmjoint_codegen.simulate.chosen import unit_of

    plotext.clear_figure()
    try:
        plotext.plotsize(width, ROWS)
        plotext.theme("clear")
        seen: list[float] = []
        for name, shade, mark in curves:
            values = run[name]
            drawn = [(t, y) for t, y in zip(run.t.tolist(), values.tolist(), strict=True) if abs(y) < 1e300]
            style = {"marker": "braille" if rich and name != "y_r" else mark}
            if colour:
                style["color"] = shade
            plotext.plot([t for t, _ in drawn], [y for _, y in drawn], **style)
            seen += [y for _, y in drawn]
        plotext.xticks(*_ticks(0.0, float(run.t[-1]) if len(run.t) else 1.0))
        plotext.yticks(*_ticks(min(seen, default=0.0), max(seen, default=1.0)))
        text = str(plotext.build())
    finally:
        plotext.clear_figure()
    lines = (plotext.uncolorize(text) if not colour else text).splitlines()
    unit = unit_of(run.manifest, curves[-1][0])
    heads = [f"{mark if not (rich and name != 'y_r') else '⣀'} {name}" for name, _, mark in reversed(curves)]
    title = f"{', '.join(heads)}{f' ({unit})' if unit not in ('', '1') else ''} over t (s)"
    body = "\n".join(line.rstrip() for line in (title, *lines))
    return body if rich else _ascii(body)


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Round numbers from low to high, three to six: plotext's own ticks stand where their labels are not."""
    span = high - low if high > low else max(abs(high), 1.0)
    power = 10.0 ** math.floor(math.log10(span / 5))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= span / 5)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    ticks = [k * step for k in range(first, last + 1)]
    return ticks, [f"{tick:.6g}" for tick in ticks]


def _ascii(text: str) -> str:
    """Replace box-drawing characters."""
    boxes = str.maketrans("┌┐└┘├┤┬┴┼─│", "+++++++++-|")
    return text.translate(boxes)
