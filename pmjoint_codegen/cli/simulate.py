"""``pmjoint simulate``: integrate the closed loop, write trajectory, summary and figures, print a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack, cast

import click

from pmjoint_codegen.cli.drawing import FIGURE_FORMATS, kinds_of, page_options, ready_matplotlib
from pmjoint_codegen.cli.options import (
    ModelName,
    Place,
    check_saturation,
    run_options,
    tell_clock,
    tell_design,
)
from pmjoint_codegen.cli.summary_table import summary_table
from pmjoint_codegen.cli.terminal import activity, document, message, result
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.logs.formats import FORMATS, available
from pmjoint_codegen.simulate.page import page_of

if TYPE_CHECKING:
    from pmjoint_codegen.closed_loop import ClosedLoop
    from pmjoint_codegen.provision import Reference
    from pmjoint_codegen.simulate.against import Log
    from pmjoint_codegen.simulate.estimates import FrozenError
    from pmjoint_codegen.simulate.run import Run
    from pmjoint_codegen.simulate.settings import CommandOptions

_DETAIL_ROWS = 500  # of the saturated transient in the figures

_ABOUT = """Integrate the closed loop of MODEL.

Writes trajectory.csv, summary.json, run.json and figures into a folder and prints a short table. Defaults
come from the model file. The folder is the run's own record: `pmjoint plot` redraws it, and compares it with
others. A run that fails still writes what it has, and exits with 3.
"""

_EXAMPLES = """\b
Examples
  pmjoint simulate paper
  pmjoint simulate paper --set c1=20 --set u_max=6 --x0 1,0 --horizon 10
  pmjoint simulate paper --reference "0.5*sin(2*t)" --disturbance 0 --disturbance "0.2*cos(t)"
  pmjoint simulate paper --controller sampled --sample-time 0.002 --out runs/sampled
  pmjoint simulate paper --start matched --saturation braking --set ck1=12 --set ck2=12
  pmjoint simulate joint --reference gait.csv --reference-unit deg --reference-filter 20
  pmjoint simulate joint --against log.csv --against-column y=angle
  pmjoint simulate paper --format parquet --format mat --format mcap
  pmjoint simulate paper --format pdf --width ieee --no-caption
  pmjoint simulate paper --no-compensator --no-figures --json
  pmjoint simulate paper --no-figures --plot
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@run_options(
    parameters={
        "help": "Another value for a parameter (d1, u_max, ...) or gain (c1, e1, ck1, k1, ...); d1_plant sets"
        " it for the plant only, unknown to the controller; repeatable."
    },
    x0={"help": "Initial plant states; for those of the controller see --start."},
    reference={},
    disturbance={},
    horizon={"help": "Length of the run in seconds."},
    output_step={},
    controller={},
    sample_time={},
    start={},
    saturation={},
    compensator={},
    tolerance={"default": 1e-10},
    max_step={},
    divergence={},
)
@click.option(
    "--evaluator",
    type=click.Choice(["compiled", "interpreted"]),
    help="How kernels run; by default compiled if a C compiler is found.",
)
@click.option("--out", type=Place(), metavar="DIR", help="Results folder [default: runs/<model>].")
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A recorded run to draw over the figures and compare with: a .csv file, time first, columns by the"
    " run's names, units as in `y [deg]`.",
)
@click.option(
    "--against-column",
    multiple=True,
    metavar="NAME=COLUMN",
    help="Its column for a name of the run; repeatable.",
)
@click.option(
    "--format",
    "formats",
    type=click.Choice([*(item.name for item in FORMATS), *FIGURE_FORMATS]),
    multiple=True,
    help="A format of the trajectory, written beside trajectory.csv with units and settings inside: "
    + ", ".join(f"{item.name} ({item.about})" for item in FORMATS)
    + f"; or of the figures, {', '.join(FIGURE_FORMATS)}, by default png; repeatable.",
)
@page_options
@click.option("--no-figures", is_flag=True, help="Draw no figures.")
@click.option(
    "--plot", "plots", is_flag=True, help="Also plot y, y_r and u in the terminal; needs the extra terminal."
)
@click.option(
    "--json", "wants_json", is_flag=True, help="Print the summary as one JSON document, not as a table."
)
def command(
    model: str,
    evaluator: str | None,
    reference: Reference,
    disturbance: tuple[str, ...],
    saturation: str | None,
    out: Path | None,
    against: Path | None,
    against_column: tuple[str, ...],
    formats: tuple[str, ...],
    no_caption: bool,
    style: str,
    width: str | None,
    no_figures: bool,
    plots: bool,
    wants_json: bool,
    **asked: Unpack[CommandOptions],
) -> int:
    """Run ``pmjoint simulate``: click passes the parsed arguments."""
    from pmjoint_codegen.cli.plotted import check_plots, terminal_plot
    from pmjoint_codegen.cli.records import check_owner, recorded_command
    from pmjoint_codegen.simulate.figures import write_figures
    from pmjoint_codegen.simulate.folder import Origin, write_run
    from pmjoint_codegen.storage import ensure_folder

    check_saturation(saturation, asked)
    for name in formats:  # a package that is absent is named before the run, not after it
        if name not in FIGURE_FORMATS:
            available(name, "--format")
    if plots:
        check_plots(wants_json)
    page = page_of(style, width, caption=not no_caption)
    if out:
        ensure_folder(out)
    loop = _load(model, evaluator, reference, disturbance, saturation)
    tell_clock(asked, loop.manifest)
    folder = out or Path("runs") / loop.manifest.name
    if not out:
        check_owner(folder, model)
    ensure_folder(folder)
    run, failure = _run(loop, asked)
    tell_design(run.manifest, _warning(run))
    notes = (f"disturbance = ({', '.join(disturbance)})",) if disturbance else ()
    log = _compared(run, against, against_column)
    detail = _transient(loop, run, asked)
    frozen = None if no_figures else _frozen(loop, run, asked)
    origin = Origin(recorded_command(), model, notes)
    files = write_run(run, folder, origin, formats=formats, detail=detail, log=log, frozen=frozen)
    try:
        if not no_figures:
            ready_matplotlib()
            with activity("drawing figures") as progress:
                files += write_figures(
                    run,
                    folder,
                    detail=detail,
                    notes=notes,
                    log=log,
                    frozen=frozen,
                    page=page,
                    kinds=kinds_of(formats),
                    progress=progress,
                )
    finally:  # report the result even if the figures fail
        if wants_json:
            document({**run.summary, "files": files})
        else:
            result(summary_table(run, notes, files))
    if plots:
        result(terminal_plot(run))
    if failure is not None:
        message(f"pmjoint: {failure}")
    return failure.exit_code if failure else 0


def _load(
    model: str,
    evaluator: str | None,
    reference: Reference,
    disturbance: Sequence[str],
    saturation: str | None,
) -> ClosedLoop:
    """Load the model's kernels, deriving and compiling what is missing."""
    from pmjoint_codegen.closed_loop import ClosedLoop

    with activity(f"preparing {model}") as shown:
        return ClosedLoop.load(
            model,
            evaluator,
            reference=reference,
            disturbance=disturbance or None,
            saturation=saturation,
            notify=lambda line: message(f"pmjoint: {line}"),
            stage=shown.stage,
        )


def _warning(run: Run) -> str | None:
    """Whether the law is too fast for a sampled controller."""
    from pmjoint_codegen.simulate.pace import too_fast

    if run.settings.controller != "sampled":
        return None
    return too_fast(run.manifest, run.settings.parameters, run.settings.sample_time)


def _run(loop: ClosedLoop, asked: CommandOptions) -> tuple[Run, SimulationError | None]:
    """Simulate; a run that ended early comes with its error."""
    with activity("simulating") as progress:
        try:
            return loop.simulate(**asked, progress=progress), None
        except SimulationError as error:
            if error.run is None:
                raise
            return cast("Run", error.run), error


def _compared(run: Run, against: Path | None, chosen: Sequence[str]) -> Log | None:
    """Read a recorded run; its distance from the run enters the summary."""
    from pmjoint_codegen.simulate.against import differences, read_log

    if against is None:
        if chosen:
            raise UsageError("belongs to --against", where="--against-column", remedy="give the file too")
        return None
    log = read_log(against, run, chosen)
    run.summary["against"] = differences(run, log)
    return log


def _frozen(loop: ClosedLoop, run: Run, asked: CommandOptions) -> FrozenError | None:
    """The error of the same run with estimates that stay at their guesses; None if none moves anyway."""
    from pmjoint_codegen.simulate.estimates import frozen_error, frozen_parameters, is_frozen

    if is_frozen(run):
        return None
    parameters = {**(asked.get("parameters") or {}), **frozen_parameters(run.manifest)}
    return frozen_error(_run(loop, {**asked, "parameters": parameters})[0])


def _transient(loop: ClosedLoop, run: Run, asked: CommandOptions) -> Run | None:
    """The saturated transient, if there is one, from a second, short run on a fine grid."""
    from pmjoint_codegen.simulate.sheets import transient_window

    window = transient_window(run)
    if window is None:
        return None
    step = min(window / _DETAIL_ROWS, run.settings.output_step)
    return _run(loop, {**asked, "horizon": window, "output_step": step})[0]
