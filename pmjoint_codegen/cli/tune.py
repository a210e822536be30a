"""``pmjoint tune``: gains that minimise an objective; a model file with them, and both designs drawn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from pmjoint_codegen.cli.drawing import ready_matplotlib
from pmjoint_codegen.cli.options import (
    ModelName,
    Place,
    run_options,
    tell_clock,
    tell_design,
)
from pmjoint_codegen.cli.terminal import activity, document, message, result, table
from pmjoint_codegen.loops.metrics import REPORTED

if TYPE_CHECKING:
    from pmjoint_codegen.provision import Reference
    from pmjoint_codegen.studies.tune import Tuned
    from pmjoint_codegen.tune.request import TuneOptions

_ABOUT = """Choose gains of MODEL that minimise an objective.

Writes a copy of MODEL with the gains found and a new name, comments kept, and a figure of both designs.
A start or saturation that is given is written there too; a reference is not.
The same seed finds the same gains.
"""

_EXAMPLES = """\b
Examples
  pmjoint tune paper --max-v 200
  pmjoint tune paper --gain c=2:60 --gain ck=0.5:20 --objective "ise + 0.01*max_abs_v"
  pmjoint tune paper --perturb "b0~uniform(1.6,2.4)" --plants 16 --seed 7 --max-v 300
  pmjoint tune paper --start matched --saturation braking --reference gait.csv --max-v 200
  pmjoint tune joint-damped --objective settling_s --controller sampled --sample-time 0.002
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option(
    "--gain",
    "gains",
    multiple=True,
    metavar="NAME[=LOW:HIGH]",
    help="What may change: c1, ..., or c, e, ck, k, poles, damping for all of a kind; repeatable "
    "[default: c, e, ck, poles, each from a fifth to five times the model's].",
)
@click.option(
    "--objective",
    default="ise",
    show_default=True,
    metavar="EXPR",
    help=f"To be minimised: a weighted sum of {', '.join(REPORTED)}.",
)
@click.option("--max-v", type=float, metavar="V", help="Limit of |v| in every run.")
@click.option(
    "--perturb",
    multiple=True,
    metavar="NAME~LAW(A,B)",
    help="Other plants: a parameter (unknown to the controller) or an initial state, as "
    "normal(MEAN,SD), uniform(A,B) or loguniform(A,B); repeatable.",
)
@click.option("--plants", type=int, metavar="N", help="How many plants --perturb draws [default: 16].")
@click.option(
    "--over",
    type=click.Choice(["worst", "mean"]),
    default="worst",
    show_default=True,
    help="How the objectives of all plants combine.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the draws and of the search.")
@click.option("--generations", type=int, default=60, show_default=True, help="Of the search, at most.")
@click.option(
    "--population", type=int, default=8, show_default=True, help="Designs in a generation, for each gain."
)
@run_options(x0={}, reference={}, horizon={}, controller={}, sample_time={}, start={}, saturation={})
@click.option("--threads", type=click.IntRange(1), help="Number of threads [default: all processors].")
@click.option(
    "--out",
    type=Place(),
    metavar="FILE",
    help="Model file to write [default: runs/<model>-tuned/<model>-tuned.toml]; the figure goes beside it.",
)
@click.option("--no-figure", is_flag=True, help="Draw nothing.")
@click.option("--json", "wants_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    reference: Reference,
    saturation: str | None,
    threads: int | None,
    out: Path | None,
    no_figure: bool,
    wants_json: bool,
    **asked: Unpack[TuneOptions],
) -> None:
    """Run ``pmjoint tune``: click passes the parsed arguments."""
    from pmjoint_codegen.studies.model import subject_of
    from pmjoint_codegen.studies.tune import check_target, make_study

    subject = subject_of(model, reference, None, saturation)
    file = out or _default_file(subject.source.file)
    check_target(subject, file)
    study = make_study(subject, notify=_notify, **asked)
    tell_clock(asked, study.provided.manifest)
    tell_design(study.provided.manifest)
    study.check_edit(file)
    tuned = study.run(threads=threads, watch=activity)
    files = [tuned.write(file)]
    if tuned.warning:
        _notify(tuned.warning)
    try:
        if not no_figure:
            files.append(_draw(tuned, file))
    finally:  # report the result even if the figure fails
        _report(tuned, files, wants_json=wants_json)


def _notify(line: str) -> None:
    message(f"pmjoint: {line}")


def _default_file(source: Path) -> Path:
    name = f"{source.stem}-tuned"
    return Path("runs") / name / f"{name}.toml"


def _draw(tuned: Tuned, file: Path) -> Path:
    from pmjoint_codegen.tune.figure import write_figure

    ready_matplotlib()
    path = file.with_suffix(".png")
    with activity("drawing the figure"):
        write_figure(tuned.costing, tuned.comparison, path)
    return path


def _report(tuned: Tuned, files: list[Path], *, wants_json: bool) -> None:
    told = {**tuned.summary, "files": files}
    if wants_json:
        document(told)
    else:
        result(_text(told))


def _text(told: Mapping[str, Any]) -> str:
    limit = f", |v| <= {told['max_v']:g}" if told["max_v"] is not None else ""
    over = f", {told['over']} of {told['plants']} plants" if told["over"] else ""
    head = f"{told['model']}: least {told['objective']}{limit}{over}"
    end = "until they converged" if told["settled"] else "the most allowed"
    generations = f"{told['generations']} generation{'' if told['generations'] == 1 else 's'}"
    tried = f"  {told['designs']} designs in {generations}, {end}; seed {told['seed']}"
    gains = [(name, *_pair(values)) for name, values in told["gains"].items()]
    rows = [("", "before", "after", ""), *gains, *_rows(told, "nominal")]
    if told["over"] == "mean":
        rows += [("mean of plants", "", "", ""), *_rows(told, "mean")]
    if told["plants"] > 1:
        rows += [("worst plant", "", "", ""), *_rows(told, "worst")]
        rows.append(("plants diverging", str(told["lost"]["before"]), str(told["lost"]["after"]), ""))
    edges = ", ".join(told["at_a_bound"])
    hint = [f"  at a bound: {edges}; wider bounds may give less"] if edges else []
    return "\n".join([head, tried, table(rows), *hint, *(f"  {path}" for path in told["files"])])


def _rows(told: Mapping[str, Any], side: str) -> list[tuple[str, ...]]:
    return [(name, *_pair(values), told["units"].get(name, "")) for name, values in told[side].items()]


def _pair(values: Mapping[str, float]) -> tuple[str, str]:
    return _shown(values["before"]), _shown(values["after"])


def _shown(value: float) -> str:
    """A number, or a dash if undefined, such as settling where the error starts at 0."""
    return "-" if value != value else f"{value:.6g}"
