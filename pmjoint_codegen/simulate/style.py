"""How figures look, whatever Matplotlib's surroundings say: its own defaults, and on them ours.

A user's ``matplotlibrc`` may ask for TeX, black axes or another backend. Figures are drawn and rendered
within `styled`, which starts from Matplotlib's defaults and leaves the process as it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, cast

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI: Final = 220
Look = Mapping[str, object]
BASE: Final[Look] = {
    "font.family": ["STIXGeneral", "DejaVu Serif"],  # by name: a text keeps it wherever it is drawn
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
    """Draw with Matplotlib's defaults, `BASE` and ``look``, by Matplotlib's names of settings."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast("Any", {**BASE, **look}))  # matplotlib types the keys as literals
        yield


def png(figure: Figure, look: Look) -> bytes:
    """Give a figure as the bytes of a PNG file, the same for the same figure.

    Matplotlib makes ticks when it renders: it does that in the look that the figure was drawn in.
    """
    stream = BytesIO()
    with styled(look):
        figure.savefig(stream, format="png", backend="agg", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()
