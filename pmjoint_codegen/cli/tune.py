"""``pmjoint tune``: search for gains, write a model file that has them, and a figure of before and after."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import Assignment, assignments
from pmjoint_codegen.cli.terminal import activity, as_json, document, message, result, table

if TYPE_CHECKING:
    from pmjoint_codegen.manifest import Manifest
    from pmjoint_codegen.sweep.request import Request
    from pmjoint_codegen.sweep.tune import Goal, Tuned

_EXAMPLES = """\b
Examples
  pmjoint tune paper --bound c1=2:40 --bound c2=2:40 --bound ck1=0.5:20 --bound ck2=0.5:20
  pmjoint tune paper --bound c1=2:40 --bound ck1=0.5:20 --weight ise=1 --weight max_abs_v=0.5 --limit-v 150
  pmjoint tune joint --bound c1=2:40 --bound c2=2:40 --perturb "J~normal(0.05,0.005)" --plants 64
"""


@click.command(epilog=_EXAMPLES)
@click.argument("model")
@click.option(
    "--bound", "bounds", multiple=True, metavar="GAIN=LOW:HIGH", help="A free gain and its range; repeatable."
)
@click.option(
    "--weight",
    "weights",
    type=Assignment(),
    multiple=True,
    callback=assignments,
    help="Weight of ise, max_abs_e, settling_s, saturated_s or max_abs_v [default: ise=1]; repeatable.",
)
@click.option("--limit-v", type=float, metavar="V", help="Largest |v| that any plant may see.")
@click.option(
    "--perturb",
    multiple=True,
    metavar="NAME~LAW(A,B)",
    help="A random value of the plant or x0, as in sweep.",
)
@click.option(
    "--plants", type=click.IntRange(1), default=32, show_default=True, help="How many perturbed plants."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the plants and of the search.")
@click.option("--generations", type=click.IntRange(1), default=60, show_default=True, help="Of the search.")
@click.option("--horizon", type=float, metavar="S", help="Length of every run in seconds.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR", help="Results [default: runs/<model>-tune]."
)
@click.option("--json", "wants_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    bounds: tuple[str, ...],
    weights: dict[str, float],
    limit_v: float | None,
    perturb: tuple[str, ...],
    plants: int,
    seed: int,
    generations: int,
    horizon: float | None,
    out: Path | None,
    wants_json: bool,
) -> None:
    """Choose gains of MODEL within bounds, so that weighted metrics over perturbed plants are least.

    Writes a copy of the model file with the gains found, tune.json and a figure. Weights apply to metrics
    relative to what the gains of the model file give.
    """
    from pmjoint_codegen.provision import provide
    from pmjoint_codegen.storage import ensure_folder, write_text
    from pmjoint_codegen.sweep.kit import library_of, make_kit
    from pmjoint_codegen.sweep.tune import tune

    provided = provide(model, environment=os.environ, notify=lambda line: message(f"pmjoint: {line}"))
    goal, request = _task(
        provided.manifest, bounds, weights or {"ise": 1.0}, limit_v, perturb, plants, seed, horizon
    )
    folder = out or Path("runs") / f"{provided.manifest.name}-tune"
    ensure_folder(folder)
    with activity("building"):
        library = library_of(make_kit(provided.folder), os.environ)
    with activity("searching") as progress:
        tuned = tune(library, request, goal, seed=seed, generations=generations, tell=progress)
    path = _write_model(model, tuned, folder)
    write_text(folder / "tune.json", as_json(asdict(tuned)) + "\n")
    figure = _draw(model, tuned, folder, horizon)
    files = (path, folder / "tune.json", figure)
    if wants_json:
        document({**asdict(tuned), "files": files})
    else:
        result(_text(provided.manifest, tuned, files))


def _task(
    manifest: Manifest,
    bounds: tuple[str, ...],
    weights: Mapping[str, float],
    limit: float | None,
    perturb: tuple[str, ...],
    plants: int,
    seed: int,
    horizon: float | None,
) -> tuple[Goal, Request]:
    """Read the options.

    Raises:
        UsageError: one that cannot be met.
    """
    from pmjoint_codegen.sweep.plan import Axis, Plan, make_plan
    from pmjoint_codegen.sweep.request import make_request
    from pmjoint_codegen.sweep.tune import Goal, check_goal, perturbed

    defaults = {item.name: item.value for item in manifest.parameters}
    states = (state.name for state in manifest.states[: manifest.nx])
    own = defaults | dict(zip(states, manifest.simulation.x0, strict=True))
    plan = (
        make_plan((), perturb, plants, seed, "sobol") if perturb else Plan((Axis(next(iter(own)), (0.0,)),))
    )
    request = make_request(manifest, plan, horizon=horizon)
    ranges = dict(_bound(text) for text in bounds)
    goal = Goal(ranges, weights, float("inf") if limit is None else limit, perturbed(own, plan.drawn))
    check_goal(manifest, goal)
    return goal, request


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    from pmjoint_codegen.errors import UsageError

    name, _, ends = text.partition("=")
    try:
        low, high = (float(end) for end in ends.split(":"))
    except ValueError:
        raise UsageError(
            f"is {text!r}", where="--bound", remedy="allowed: GAIN=LOW:HIGH, such as c1=2:40"
        ) from None
    return name.strip(), (low, high)


def _write_model(model: str, tuned: Tuned, folder: Path) -> Path:
    from pmjoint_codegen.spec.reader import read_document
    from pmjoint_codegen.storage import write_text
    from pmjoint_codegen.sweep.tune import with_gains
    from pmjoint_codegen.workspace import find_model

    source = find_model(model)
    design = read_document(source)["design"]
    lists = {key: design[key] for key in ("c", "e", "ck", "k")}
    path = folder / f"{source.stem}.toml"
    write_text(path, with_gains(source.read_text(encoding="utf-8"), tuned.gains, lists))
    return path


def _draw(model: str, tuned: Tuned, folder: Path, horizon: float | None) -> Path:
    from pmjoint_codegen.closed_loop import ClosedLoop
    from pmjoint_codegen.sweep.maps import write_before_after
    from pmjoint_codegen.workspace import cache_dir

    os.environ.setdefault("MPLCONFIGDIR", str(cache_dir(os.environ) / "matplotlib"))
    loop = ClosedLoop.load(model)
    runs = [loop.simulate(horizon=horizon, parameters=gains) for gains in ({}, tuned.gains)]
    return write_before_after(runs[0], runs[1], folder / "before-after.png")


def _text(manifest: Manifest, tuned: Tuned, files: tuple[Path, ...]) -> str:
    own = {item.name: item.value for item in manifest.parameters}
    rows = [("gain", "before", "after")]
    rows += [(name, f"{own[name]:g}", f"{value:.6g}") for name, value in tuned.gains.items()]
    rows += [("mean over the plants", "before", "after")]
    rows += [(name, f"{tuned.before[name]:.6g}", f"{tuned.after[name]:.6g}") for name in tuned.before]
    rows += [("largest |v|", f"{tuned.peak_before:.6g}", f"{tuned.peak_after:.6g}")]
    head = (
        f"{manifest.name}: cost {tuned.cost_before:.4g} before, {tuned.cost:.4g} after, in {tuned.runs} runs"
    )
    return "\n".join([head, table(rows), *(f"  {path}" for path in files)])
