"""``pmjoint plot``: redraw the figures of a run from its folder, or draw several runs over each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pmjoint_codegen.cli.drawing import FIGURE_FORMATS, kinds_of, page_options, ready_matplotlib
from pmjoint_codegen.cli.options import Place
from pmjoint_codegen.cli.terminal import document, result, table
from pmjoint_codegen.simulate.page import page_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pmjoint_codegen.simulate.compare import Comparison
    from pmjoint_codegen.simulate.folder import RunFolder
    from pmjoint_codegen.simulate.page import Page

COMPARISON = Path("runs") / "comparison"

_ABOUT = """Redraw the figures of a run from its folder, or compare several runs.

RUN is a folder that `pmjoint simulate` wrote. Nothing is simulated: model and compiler may be gone. With one
folder, the figures of `simulate` are drawn again in it. With several, one figure shows the runs over each
other, its legend names the settings in which they differ, and a table compares them.
"""

_EXAMPLES = """\b
Examples
  pmjoint plot runs/paper --format pdf --width ieee --no-caption
  pmjoint plot runs/paper --signals y+y_r,e,x1-x_hat1
  pmjoint simulate paper --set c1=30 --no-figures --out runs/faster
  pmjoint plot runs/paper runs/faster
  pmjoint plot runs/paper runs/faster --signals e,u --out figures --json
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("runs", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--signals",
    metavar="A,B+C,...",
    help="Draw these columns instead, a panel for each entry: a column, a difference x1-x_hat1, or several of"
    " one unit, y+y_r.",
)
@click.option(
    "--out",
    type=Place(),
    metavar="DIR",
    help=f"Folder of the figures [default: that of the run; of several, {COMPARISON}].",
)
@click.option(
    "--format",
    "formats",
    type=click.Choice(FIGURE_FORMATS),
    multiple=True,
    help="Format of the figures, by default png; repeatable.",
)
@page_options
@click.option("--json", "wants_json", is_flag=True, help="Print one JSON document, not a table.")
def command(
    runs: tuple[Path, ...],
    signals: str | None,
    out: Path | None,
    formats: tuple[str, ...],
    no_caption: bool,
    style: str,
    width: str | None,
    wants_json: bool,
) -> int:
    """Run ``pmjoint plot``: click passes the parsed arguments."""
    from pmjoint_codegen.simulate.folder import read_folder
    from pmjoint_codegen.storage import ensure_folder

    page = page_of(style, width, caption=not no_caption)
    found = [read_folder(path) for path in runs]
    folder = out or (found[0].path if len(found) == 1 else COMPARISON)
    ensure_folder(folder)
    ready_matplotlib()
    named = None if signals is None else signals.split(",")
    if len(found) == 1:
        files = _redraw(found[0], folder, named, page, kinds_of(formats))
        told: dict[str, Any] = {"run": str(runs[0]), "command": found[0].origin.command, "files": files}
        rows = [("run", str(runs[0])), ("made by", found[0].origin.command)]
        text = table([row for row in rows if row[1]])
    else:
        from pmjoint_codegen.simulate.compare import compare

        comparison = compare(*(item.run for item in found), names=[str(path) for path in runs])
        files = _draw_over(comparison, folder, named, page, kinds_of(formats))
        told, text = {**comparison.contents(), "files": files}, str(comparison)
    if wants_json:
        document(told)
    else:
        listed = [("files" if k == 0 else "", str(path)) for k, path in enumerate(files)]
        result(f"{text}\n{table(listed)}")
    return 0


def _redraw(
    found: RunFolder, folder: Path, signals: Sequence[str] | None, page: Page, kinds: Sequence[str]
) -> tuple[Path, ...]:
    """Draw the figures as `simulate` does, or one of the chosen signals."""
    from pmjoint_codegen.simulate.figures import chosen_figure, save_figure, write_figures

    notes = found.origin.notes
    if signals is None:
        return write_figures(
            found.run,
            folder,
            detail=found.detail,
            notes=notes,
            log=found.log,
            frozen=found.frozen,
            page=page,
            kinds=kinds,
        )
    figure = chosen_figure(found.run, signals, notes=notes, log=found.log, page=page)
    return save_figure(figure, folder / f"signals_{'_'.join(signals)}", page, kinds)


def _draw_over(
    comparison: Comparison, folder: Path, signals: Sequence[str] | None, page: Page, kinds: Sequence[str]
) -> tuple[Path, ...]:
    from pmjoint_codegen.simulate.figures import save_figure

    return save_figure(comparison.plot(signals, page=page), folder / "comparison", page, kinds)
