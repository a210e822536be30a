"""The texts of a figure as they are printed, and that they lie apart and inside."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from pmjoint_codegen.simulate.style import Look, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox


def printed_texts(figure: Figure, look: Look) -> list[tuple[str, Bbox]]:
    """Return every text that is printed, with its place in pixels.

    Args:
        figure: drawn within `styled`.
        look: that it was drawn in.
    """
    from matplotlib.text import Text

    with styled(look):
        figure.draw_without_rendering()
        found = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        # Matplotlib keeps the texts of ticks beyond the ends of an axis, and draws none of them.
        hidden = {
            id(label)
            for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis))
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
            if not min(axis.get_view_interval()) <= tick.get_loc() <= max(axis.get_view_interval())
            for label in (tick.label1, tick.label2)
        }
        return [(text.get_text(), text.get_window_extent()) for text in found if id(text) not in hidden]


def flaws(figure: Figure, look: Look) -> list[str]:
    """Return what is wrong with the texts of a figure: those that leave it and those that overlap."""
    printed = printed_texts(figure, look)
    edge = figure.bbox
    outside = [
        f"{text!r} leaves the figure"
        for text, box in printed
        if not (edge.x0 <= box.x0 and box.x1 <= edge.x1 and edge.y0 <= box.y0 and box.y1 <= edge.y1)
    ]
    return outside + [
        f"{first!r} on {second!r}"
        for (first, a), (second, b) in combinations(printed, 2)
        if not (a.x1 <= b.x0 or b.x1 <= a.x0 or a.y1 <= b.y0 or b.y1 <= a.y0)
    ]
