"""Draw the figures that README and docs show, and fill in stated numbers: `make docs`.

The same sources give the same bytes.
"""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from docs import story
from docs.stated import REGION, SATURATION, fill
from pmjoint_codegen import ClosedLoop, Run
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.simulate import style
from pmjoint_codegen.storage import write_bytes, write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES = Path(__file__).resolve().parent / "figures"
LOOK: style.Look = {"legend.fontsize": 9}  # beside what all figures have
SHOWN = 10.0  # s; after it the curves lie on zero


def curve(axes: Axes, done: Run, column: str, label: str, colour: str, dashes: str) -> None:
    """Add one column of one run."""
    axes.plot(done.t, done[column], color=colour, linestyle=dashes, linewidth=1.2, label=label)


def compensator_figure(with_it: Run, without: Run) -> Figure:
    """Draw tracking error and applied input with the compensator (23) and with plain clipping, r = 0."""
    from matplotlib.figure import Figure

    with style.styled(LOOK):
        figure = Figure(figsize=(7.4, 2.9), layout="constrained")
        error, actuation = figure.subplots(1, 2)
        labelled = (
            (with_it, "with the compensator (23)", style.BLUE, "-"),
            (without, "without, r = 0", style.RED, "--"),
        )
        for done, label, colour, dashes in labelled:
            curve(error, done, "e", label, colour, dashes)
            curve(actuation, done, "u", label, colour, dashes)
        error.set(xlabel="t (s)", ylabel="tracking error $e = y - y_r$ (rad)", xlim=(0, SHOWN))
        actuation.set(xlabel="t (s)", ylabel="applied input $u$ (V)", xlim=(0, 1.5))
        for axes in (error, actuation):
            axes.axhline(0, color="0.6", linewidth=0.5, zorder=0)
        error.legend()
        figure.supxlabel(
            "Assumed, not stated in the paper: $y_r = \\sin t$. Note the two time scales.", fontsize=9
        )
    return figure


def from_command(
    arguments: str, drawn: str, shown: str, prepare: Callable[[Path], str] | None = None
) -> None:
    """Run a command as the documentation gives it, in a folder of its own, and keep one of its figures.

    Args:
        arguments: of `pmjoint`, with OUT for the place of its results.
        drawn: the figure, in that place.
        shown: its name among the documentation's figures.
        prepare: writes files that the command needs, and gives its arguments.
    """
    with tempfile.TemporaryDirectory() as folder:
        if prepare is not None:
            arguments = prepare(Path(folder))
        command = [word.replace("OUT", folder) for word in shlex.split(arguments)]
        with redirect_stdout(StringIO()):
            code = run(command)
        if code:
            raise SystemExit(f"docs: pmjoint {arguments} failed")
        write_bytes(FIGURES / shown, (Path(folder) / drawn).read_bytes())


TUNE = (
    'tune paper --perturb "b0~uniform(1.6,2.4)" --perturb "x1~uniform(-3,3)" --plants 16 --seed 7 --max-v 100'
    ' --objective "ise + 0.01*max_abs_v" --out OUT/paper-tuned.toml'
)


def forearm(folder: Path) -> str:
    """Write the files of docs/howto/change-the-model.md; gives its command."""
    *_, (_, text) = story.models()
    write_text(folder / "forearm.toml", text)
    write_text(folder / "gait.csv", story.gait())
    return f"simulate OUT/forearm.toml {story.GAIT.replace('gait.csv', 'OUT/gait.csv')} --out OUT"


def main() -> None:
    """Write every figure but that of the benchmarks, which `make bench` draws."""
    loop = ClosedLoop.load("paper")
    runs = [loop.simulate(compensator=switch, output_step=0.002) for switch in (True, False)]
    write_bytes(FIGURES / "compensator.png", style.png(compensator_figure(*runs), LOOK))
    from_command(f"{REGION} --out OUT", "region.png", "region.png")
    from_command(f"{SATURATION} --out OUT", "region.png", "saturation.png")
    from_command(TUNE, "paper-tuned.png", "tune.png")
    from_command("", "overview.png", "forearm.png", forearm)
    fill()


if __name__ == "__main__":
    main()
