"""The style of figures, independent of the user's Matplotlib settings: its defaults, then ours.

A user's ``matplotlibrc`` may select TeX, black axes or another backend. Figures are drawn and rendered
within `styled`, which starts from Matplotlib's defaults and restores the process's settings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, cast

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI: Final = 220
CAPTION_CHARACTERS: Final = 124  # printed ones in a line
BLACK, BLUE, RED, GREY = "#111111", "#1f4e79", "#b03a2e", "#757575"
RUST, STONE = "#b5482a", "#8a8782"
KINDS: Final = {  # name -> backend, metadata that would differ from run to run or release to release
    "png": ("agg", ("Software",)),
    "pdf": ("pdf", ("CreationDate", "Creator", "Producer")),
    "svg": ("svg", ("Date", "Creator")),
}
_UNPRINTED: Final = r"[\\${}_^\s]"  # of a formula
_SILENT: Final = ("hat", "dot", "ddot", "mathrm")
_WORDS: Final = ("max", "min", "sin", "cos")
Look = Mapping[str, object]
BASE: Final[Look] = {
    "font.family": ["STIXGeneral", "DejaVu Serif"],  # by name, so that a text keeps it wherever it is drawn
    "mathtext.fontset": "stix",
    "font.size": 9.5,
    "axes.linewidth": 0.5,
    "legend.frameon": False,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
}


@contextmanager
def styled(look: Look) -> Iterator[None]:
    """Draw with Matplotlib's defaults, `BASE` and ``look``, which use Matplotlib's setting names."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast("Any", {**BASE, **look}))  # matplotlib types the keys as literals
        yield


def png(figure: Figure, look: Look) -> bytes:
    """Return a figure as the bytes of a PNG file; see `rendered`."""
    return rendered(figure, look, "png")


def rendered(figure: Figure, look: Look, kind: str) -> bytes:
    """Return a figure as the bytes of a file, the same for the same figure: without date and random names.

    Matplotlib makes ticks when it renders, so rendering uses the style in which the figure was drawn.

    Args:
        figure: drawn within `styled`.
        look: that it was drawn in.
        kind: one of `KINDS`.
    """
    backend, silent = KINDS[kind]
    stream = BytesIO()
    # Publishers refuse the outlines of type 3 that Matplotlib embeds by default.
    with styled({**look, "svg.hashsalt": "pmjoint", "pdf.fonttype": 42}):
        figure.savefig(
            stream, format=kind, backend=backend, dpi=DPI, metadata=dict.fromkeys(silent), facecolor="white"
        )
    return stream.getvalue()


def scaled(look: Look, scale: float) -> Look:
    """The same look with text and lines of another size; ticks and lines of `BASE` included."""
    sizes = {
        name: value * scale
        for name, value in {**BASE, **look}.items()
        if isinstance(value, float) and not name.endswith("margin")
    }
    return {**look, **sizes}


def _printed(command: re.Match[str]) -> str:
    """What a command of TeX prints: nothing for an accent or a font, its name for max, else one letter."""
    name = command[1]
    return "" if name in _SILENT else name if name in _WORDS else "x"


def wrapped(text: str, characters: int = CAPTION_CHARACTERS) -> list[str]:
    """Break a caption into lines by its printed length; a formula is not broken."""
    lines: list[str] = []
    length = 0
    for word in re.findall(r"(?:\$[^$]*\$|\\\$|[^\s$])+", text):
        printed = len(re.sub(_UNPRINTED, "", re.sub(r"\\([a-z]+)", _printed, word)))
        if not lines or length + 1 + printed > characters:
            lines.append(word)
            length = printed
        else:
            lines[-1] += " " + word
            length += 1 + printed
    return lines
