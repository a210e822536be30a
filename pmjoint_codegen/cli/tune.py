"""``pmjoint tune``: gains that minimise an objective; a model file with them, and both designs drawn."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from pmjoint_codegen.cli.drawing import ready_matplotlib
from pmjoint_codegen.cli.options import (
    ModelName,
    Place,
    processors,
    run_options,
    tell_clock,
    tell_design,
)
from pmjoint_codegen.cli.terminal import activity, document, message, result, table
from pmjoint_codegen.loops.metrics import REPORTED

if TYPE_CHECKING:
    from pmjoint_codegen.provision import Provided, Reference
    from pmjoint_codegen.tune.comparison import Comparison
    from pmjoint_codegen.tune.cost import CostFunction
    from pmjoint_codegen.tune.request import Request, TuneOptions
    from pmjoint_codegen.tune.search import Found

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
_TUNED = "with gains tuned for least"  # in the note at the head of a file that tune writes
_FILE_STEM = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


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
    from pmjoint_codegen.errors import UsageError
    from pmjoint_codegen.provision import provide
    from pmjoint_codegen.storage import ensure_folder
    from pmjoint_codegen.tune.comparison import compare
    from pmjoint_codegen.tune.request import make_request
    from pmjoint_codegen.tune.rewrite import rewrite
    from pmjoint_codegen.workspace import find_model, is_stream

    source = find_model(model)
    if is_stream(source):
        raise UsageError(
            "is not a file that could be rewritten with other gains",
            where=str(source),
            remedy="save the model as NAME.toml first",
        )
    file = out or _default_file(source)
    _check_target(file, source)
    provided = provide(
        source,
        reference=reference,
        saturation=saturation,
        environment=os.environ,
        notify=_notify,
        lanes=True,
    )
    tell_clock(asked, provided.manifest)
    request = make_request(provided.manifest, **asked)
    tell_design(provided.manifest)
    words = _words(saturation, asked.get("start"))
    text = _text_of(source, file, request, words)
    ensure_folder(file.parent)
    costing = _costing(provided, request, threads or processors())
    found = _search(costing)
    comparison = compare(costing, found)
    edited = rewrite(
        text, file.stem, found.gains, _note(comparison, reference), str(source), request.own, words
    )
    _write_model(edited, file)
    _notify_pace(comparison)
    files = [file]
    try:
        if not no_figure:
            files.append(_draw(costing, comparison, file))
    finally:  # report the result even if the figure fails
        _report(comparison, files, wants_json=wants_json)


def _notify(line: str) -> None:
    message(f"pmjoint: {line}")


def _notify_pace(comparison: Comparison) -> None:
    """Warn where the gains found are too fast for the clock: those before matter no more."""
    from pmjoint_codegen.tune.comparison import too_fast_plants

    line = too_fast_plants(comparison)
    if line:
        _notify(line)


def _default_file(source: Path) -> Path:
    name = f"{source.stem}-tuned"
    return Path("runs") / name / f"{name}.toml"


def _check_target(file: Path, source: Path) -> None:
    """Refuse, before the search, a file that could not be used or that is the model itself."""
    from pmjoint_codegen.errors import UsageError

    if file.suffix != ".toml" or not _FILE_STEM.fullmatch(file.stem):
        raise UsageError(
            f"is {str(file)!r}",
            where="--out",
            remedy="allowed: NAME.toml, letters, digits, - and _ in NAME, which becomes the model's name",
        )
    if file.exists() and file.samefile(source):
        raise UsageError("is the model itself", where=f"--out {file}", remedy="give another file")
    if file.is_dir() or (file.exists() and not _is_tuned(file)):
        raise UsageError(
            "exists already, and was not written by tune",
            where=f"--out {file}",
            remedy="give another file",
        )


def _is_tuned(file: Path) -> bool:
    """Whether a file begins with the note that tune writes."""
    with file.open("rb") as stream:
        return f" {_TUNED} ".encode() in stream.readline()


def _costing(provided: Provided, request: Request, threads: int) -> CostFunction:
    from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
    from pmjoint_codegen.tune.cost import CostFunction

    with activity("preparing the simulation"):
        return CostFunction(library_of(make_inputs(provided.folder), os.environ), request, threads)


def _search(costing: CostFunction) -> Found:
    from pmjoint_codegen.tune.search import search

    total = costing.request.most_designs
    with activity(f"trying up to {total} designs", total=total, unit="designs") as progress:
        return search(costing, lambda tried: progress(tried / total))


def _words(saturation: str | None, start: str | None) -> dict[str, str]:
    """Keys of the design that options replace: the gains are found for these."""
    given = {"saturation": saturation, "start": start}
    return {key: word for key, word in given.items() if word is not None}


def _text_of(source: Path, file: Path, request: Request, words: Mapping[str, str]) -> str:
    """The model file's text, after a trial edit: a search should not end at a file that cannot be edited."""
    from pmjoint_codegen.tune.rewrite import rewrite

    text = source.read_bytes().decode("utf-8-sig")
    rewrite(
        text,
        file.stem,
        {name: 1.5 * request.own[name] for name in request.space.gains},
        "",
        str(source),
        request.own,
        words,
    )
    return text


def _write_model(edited: str, file: Path) -> None:
    """Write the model with the gains found, after validating it; whole or not at all."""
    from pmjoint_codegen.modelfile.reader import parse_document
    from pmjoint_codegen.storage import write_bytes

    found = parse_document(edited, str(file))
    try:
        from pmjoint_codegen.modelfile import model_of

        model_of(found, str(file))
    except ModuleNotFoundError:  # without the toolchain: only the gains have changed, and they were simulated
        pass
    write_bytes(file, edited.encode())


def _note(comparison: Comparison, reference: Reference) -> str:
    """How the gains were found, in one line."""
    request = comparison.request
    parts = [f"{comparison.manifest.name} {_TUNED} {request.objective.text}"]
    if request.max_v is not None:
        parts.append(f"|v| <= {request.max_v:g}")
    if request.count > 1:
        drawn = ", ".join(
            f"{item.name}~{item.law}({item.first:g},{item.second:g})" for item in request.drawn.samples
        )
        parts.append(f"{request.over} of {request.count} plants, {drawn}")
    if reference is not None:  # it stays out of the file: a task, not the design
        parts.append(f"y_r = {request.runs.reference}")
    return f"{'; '.join(parts)}; seed {request.seed}"


def _draw(costing: CostFunction, comparison: Comparison, file: Path) -> Path:
    from pmjoint_codegen.tune.figure import write_figure

    ready_matplotlib()
    path = file.with_suffix(".png")
    with activity("drawing the figure"):
        write_figure(costing, comparison, path)
    return path


def _report(comparison: Comparison, files: list[Path], *, wants_json: bool) -> None:
    from pmjoint_codegen.tune.comparison import summary_table

    told = {**summary_table(comparison), "files": files}
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
