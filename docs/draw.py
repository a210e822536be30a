"""Draw the figures that README and docs show: `make docs`. The same sources give the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.simulate.figures import png
from pmjoint_codegen.storage import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES = Path(__file__).resolve().parent / "figures"
STYLE: Any = {  # matplotlib types its keys as a list of literals
    "font.family": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.linewidth": 0.6,
    "legend.frameon": False,
    "xtick.direction": "in",
    "ytick.direction": "in",
}
SHOWN = 10.0  # s; after it the curves lie on zero


def curve(axes: Axes, run: Run, column: str, label: str, colour: str, dashes: str) -> None:
    """Add one column of one run."""
    axes.plot(run.t, run[column], color=colour, linestyle=dashes, linewidth=1.2, label=label)


def compensator_figure(with_it: Run, without: Run) -> Figure:
    """Draw tracking error and applied input with the compensator (23) and with plain clipping, r = 0."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 2.9), layout="constrained")
        error, actuation = figure.subplots(1, 2)
        labelled = (
            (with_it, "with the compensator (23)", "#1f4e79", "-"),
            (without, "without, r = 0", "#b03a2e", "--"),
        )
        for run, label, colour, dashes in labelled:
            curve(error, run, "e", label, colour, dashes)
            curve(actuation, run, "u", label, colour, dashes)
        error.set(xlabel="t (s)", ylabel="tracking error $e = y - y_r$ (rad)", xlim=(0, SHOWN))
        actuation.set(xlabel="t (s)", ylabel="applied input $u$ (V)", xlim=(0, 1.5))
        for axes in (error, actuation):
            axes.axhline(0, color="0.6", linewidth=0.5, zorder=0)
        error.legend()
        figure.supxlabel(
            "Assumed, not stated in the paper: $y_r = \\sin t$. Note the two time scales.", fontsize=9
        )
    return figure


def main() -> None:
    """Write every figure."""
    loop = ClosedLoop.load("paper")
    runs = [loop.simulate(compensator=switch, output_step=0.002) for switch in (True, False)]
    write_bytes(FIGURES / "compensator.png", png(compensator_figure(*runs)))


if __name__ == "__main__":
    main()
