"""The page that figures are drawn for: its width, the size of its text, and whether captions are printed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from pmjoint_codegen.errors import UsageError, did_you_mean, quoted

MILLIMETRES: Final = 25.4  # in an inch
TEXT_WIDTH: Final = 6.3  # inches, of a printed page with one column
NARROW: Final = 5.0  # inches; a figure below it stands in a column, whose text is smaller
COLUMN_SCALE: Final = 0.84  # of text in a column: 8 pt, the least that IEEE asks for
STYLES: Final = {"paper": (TEXT_WIDTH, 1.0), "slides": (10.0, 1.6)}  # name -> inches, scale of text
WIDTHS: Final = {  # name -> inches, from the authors' guides of the publishers
    "ieee": 3.5,
    "ieee-wide": 7.16,
    "elsevier": 90.0 / MILLIMETRES,
    "elsevier-wide": 190.0 / MILLIMETRES,
}
SMALLEST, LARGEST = 2.5, 40.0  # inches


@dataclass(frozen=True)
class Page:
    """What a figure is drawn for.

    Attributes:
        width: of the figure, inches.
        scale: of text, lines and the room for them; 1 has labels of 9.5 pt.
        caption: whether the caption is printed below the panels.
    """

    width: float = TEXT_WIDTH
    scale: float = 1.0
    caption: bool = True

    @property
    def relative(self) -> float:
        """How much fits into a line, relative to a printed page."""
        return self.width / self.scale / TEXT_WIDTH


PRINTED: Final = Page()


def page_of(style: str = "paper", width: str | None = None, *, caption: bool = True) -> Page:
    """Make a page.

    Args:
        style: ``paper``, or ``slides`` with larger text and heavier lines.
        width: name of a column, such as ``ieee``, or a length, such as ``120mm`` or ``5in``; by default the
            style's own.
        caption: whether the caption is printed.

    Raises:
        UsageError: a style or width that is not known, or a width out of range.
    """
    if style not in STYLES:
        raise UsageError(f"is {quoted(style)}", where="style", remedy=f"allowed: {', '.join(STYLES)}")
    own, scale = STYLES[style]
    inches = own if width is None else _inches(width)
    if style == "paper" and inches < NARROW:
        scale = COLUMN_SCALE
    elif style == "slides":
        scale *= inches / own
    return Page(inches, scale, caption)


def _inches(width: str) -> float:
    """A width as a user states it, in inches."""
    if width in WIDTHS:
        return WIDTHS[width]
    match = re.fullmatch(r"(\d+(?:\.\d*)?)\s*(mm|cm|in)", width)
    if match is None:
        known = ", ".join(WIDTHS)
        raise UsageError(
            f"is {quoted(width)}",
            where="--width",
            remedy=f"{did_you_mean(width, WIDTHS)}allowed: {known}, or a length such as 120mm, 12cm or 5in",
        )
    inches = float(match[1]) / {"mm": MILLIMETRES, "cm": MILLIMETRES / 10.0, "in": 1.0}[match[2]]
    if not math.isfinite(inches) or not SMALLEST <= inches <= LARGEST:
        raise UsageError(
            f"is {quoted(width)}", where="--width", remedy=f"allowed: {SMALLEST:g}in to {LARGEST:g}in"
        )
    return inches
