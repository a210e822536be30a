"""``pmjoint sweep``: many runs over grids and samples; one dataset, and figures of it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from pmjoint_codegen.cli.drawing import ready_matplotlib
from pmjoint_codegen.cli.options import (
    ModelName,
    Place,
    check_saturation,
    processors,
    run_options,
    tell_clock,
    tell_design,
)
from pmjoint_codegen.cli.terminal import activity, document, message, result, table

if TYPE_CHECKING:
    from pmjoint_codegen.provision import Provided, Reference
    from pmjoint_codegen.simulate.settings import CommandOptions
    from pmjoint_codegen.sweep.store import Store

_SHOWN = 3  # damaged files that a message names

_ABOUT = """Simulate MODEL many times over: on a grid, with random values, or both.

Writes one dataset, sweep.zarr, and figures into a folder. After any interruption, the same command resumes
the sweep where it stopped, with the same result.
"""

_EXAMPLES = """\b
Examples
  pmjoint sweep paper --grid x1=-100:100:201 --grid x2=-40:40:81 --grid compensator=0,1
  pmjoint sweep paper --grid x1=-100:100:201 --grid x2=-40:40:81 --grid saturation=compensator,clip,braking
  pmjoint sweep paper --grid c1=2:40:77 --grid ck1=0.2:8:79
  pmjoint sweep joint --sample "J~normal(0.05,0.005)" --runs 100000 --seed 7
  pmjoint sweep joint --sample "J_plant~normal(0.05,0.005)" --runs 100000   # J unknown to the controller
  pmjoint sweep paper --grid x1=-90:90:1001 --controller sampled --sample-time 0.002
  pmjoint sweep paper --grid x1=-90:90:2001 --scheduler tcp://10.0.0.1:8786
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option(
    "--grid",
    multiple=True,
    metavar="NAME=A:B:N",
    help="An axis: N values from A to B, or NAME=A,B,C; repeatable.",
)
@click.option(
    "--sample",
    multiple=True,
    metavar="NAME~LAW(A,B)",
    help="A random value: normal(MEAN,SD), uniform(A,B), loguniform(A,B); repeatable.",
)
@click.option(
    "--runs", "draws", type=int, metavar="N", help="How many draws --sample makes (on every grid point)."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the draws.")
@click.option(
    "--method",
    type=click.Choice(["latin-hypercube", "sobol"]),
    default="latin-hypercube",
    show_default=True,
    help="How draws fill the space.",
)
@run_options(
    parameters={"help": "A fixed value for a parameter or gain; J_plant sets the plant's only; repeatable."},
    x0={"help": "Initial plant states where they are not varied."},
    reference={},
    disturbance={},
    horizon={},
    controller={},
    sample_time={},
    start={},
    saturation={},
    compensator={},
    tolerance={"default": 1e-6},
    max_step={},
    divergence={},
)
@click.option(
    "--trajectories",
    "output_step",
    type=float,
    metavar="S",
    help="Store trajectories too, a row every S seconds.",
)
@click.option(
    "--format",
    "formats",
    type=click.Choice(["netcdf", "parquet"]),
    multiple=True,
    help="Another file beside sweep.zarr; repeatable.",
)
@click.option("--threads", type=click.IntRange(1), help="Number of threads [default: all processors].")
@click.option("--scheduler", metavar="ADDRESS", help="Compute on the workers of this Dask scheduler instead.")
@click.option(
    "--out",
    type=Place(),
    metavar="DIR",
    help="Results folder [default: runs/<model>-sweep].",
)
@click.option("--restart", is_flag=True, help="Discard what is in the folder instead of resuming.")
@click.option("--no-figures", is_flag=True, help="Draw no figures.")
@click.option("--json", "wants_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    grid: tuple[str, ...],
    sample: tuple[str, ...],
    draws: int | None,
    seed: int,
    method: str,
    reference: Reference,
    disturbance: tuple[str, ...],
    saturation: str | None,
    formats: tuple[str, ...],
    threads: int | None,
    scheduler: str | None,
    out: Path | None,
    restart: bool,
    no_figures: bool,
    wants_json: bool,
    **asked: Unpack[CommandOptions],
) -> None:
    """Run ``pmjoint sweep``: click passes the parsed arguments."""
    from pmjoint_codegen.provision import provide
    from pmjoint_codegen.sweep.formats import require
    from pmjoint_codegen.sweep.pace import too_fast_runs
    from pmjoint_codegen.sweep.plan import make_plan
    from pmjoint_codegen.sweep.request import make_request
    from pmjoint_codegen.sweep.store import Store

    require((*formats, *(["dask"] if scheduler is not None else [])))
    plan = make_plan(grid, sample, draws, seed, method)
    check_saturation(saturation, asked)
    provided = provide(
        model,
        reference=reference,
        disturbance=disturbance or None,
        saturation=saturation or plan.saturation,
        environment=os.environ,
        notify=lambda line: message(f"pmjoint: {line}"),
        lanes=True,
    )
    tell_clock(asked, provided.manifest)
    request = make_request(provided.manifest, plan, **asked)
    tell_design(provided.manifest, too_fast_runs(provided.manifest, request))
    folder = out or Path("runs") / f"{provided.manifest.name}-sweep"
    store = Store(folder, request, provided.manifest.nX)
    with store.alone():
        _compute(store, provided, threads=threads, scheduler=scheduler, restart=restart)
        files = _write(store, provided, formats)
        account = _account(store, provided, files)
        try:
            if not no_figures:
                account["files"] = (*files, *_draw(store, provided))
        finally:  # report the result even if the figures fail
            if wants_json:
                document(account)
            else:
                result(_text(account))


def _compute(
    store: Store, provided: Provided, *, threads: int | None, scheduler: str | None, restart: bool
) -> None:
    """Compute what is missing or damaged, and report it."""
    from pmjoint_codegen.sweep.repair import find_damage, mend

    store.open(restart=restart)
    work = partial(_simulate, store, provided, threads=threads, scheduler=scheduler)
    if not store.dataset.exists():
        with activity("reading the finished runs"):
            missing = store.missing()
            damaged = store.damaged(missing)
        _tell_damage(store, damaged, missing)
        work(missing)
        return
    with activity("reading the dataset"):
        damage = find_damage(store, provided.manifest)
    if damage.files:
        _tell_damage(store, [store.dataset / name for name in damage.files], damage.starts)
        work(damage.starts)
        with activity("repairing the dataset"):
            mend(store, provided.manifest, damage)


def _tell_damage(store: Store, files: Sequence[Path], starts: Sequence[int]) -> None:
    """Report which files were removed or altered, and how many runs that costs."""
    if files:
        some = ", ".join(str(path.relative_to(store.folder)) for path in files[:_SHOWN])
        more = f" and {len(files) - _SHOWN} more" if len(files) > _SHOWN else ""
        runs = sum(store.length(start) for start in starts)
        message(f"pmjoint: {store.folder}: removed or altered: {some}{more}; computing {runs} runs")


def _simulate(
    store: Store, provided: Provided, starts: Sequence[int], *, threads: int | None, scheduler: str | None
) -> None:
    """Compute these chunks, with a progress bar; say how to resume after an interruption."""
    from pmjoint_codegen.sweep.build_inputs import make_inputs
    from pmjoint_codegen.sweep.dataset import import_ahead
    from pmjoint_codegen.sweep.executor import execute

    total = store.request.plan.runs
    inputs = make_inputs(provided.folder)
    import_ahead()
    try:
        with activity(f"simulating {total} runs", total=total, unit="runs") as progress:
            execute(
                store,
                inputs,
                threads=threads or processors(),
                scheduler=scheduler,
                tell=lambda done: progress(done / total),
                starts=starts,
            )
    except KeyboardInterrupt:
        kept = f"{store.done()} of {total} runs are kept in {store.folder}"
        message(f"pmjoint: {kept}; the same command resumes there")
        raise


def _write(store: Store, provided: Provided, formats: tuple[str, ...]) -> tuple[Path, ...]:
    from pmjoint_codegen.sweep.dataset import assemble

    with activity("writing the dataset"):
        if not store.dataset.exists():
            assemble(store, provided.manifest)
    files = [store.dataset]
    if formats:
        from pmjoint_codegen.sweep.formats import export

        with activity(f"writing {' and '.join(formats)}"):
            files += [export(store.dataset, kind) for kind in formats]
    return tuple(files)


def _draw(store: Store, provided: Provided) -> tuple[Path, ...]:
    from pmjoint_codegen.sweep.dataset import read
    from pmjoint_codegen.sweep.maps import write_maps

    ready_matplotlib()
    with activity("drawing figures"):
        return write_maps(read(store.dataset), provided.manifest, store.folder)


def _account(store: Store, provided: Provided, files: tuple[Path, ...]) -> dict[str, Any]:
    """The sweep in a few numbers."""
    from pmjoint_codegen.sweep.metrics import quantities
    from pmjoint_codegen.sweep.totals import totals

    request = store.request
    with activity("counting"):
        ends = totals(store.dataset)
    units = {item.name: item.unit for item in quantities(provided.manifest)}
    return {
        "model": request.model,
        "model_hash": request.model_hash,
        "request_hash": request.hash,
        "runs": request.plan.runs,
        "dimensions": request.plan.dimensions,
        "seed": request.plan.seed,
        "status": ends.status,
        "held": ends.held,
        "quantiles_of_held": ends.quantiles,
        "units": {name: units[name] for name in ends.quantiles},
        "files": files,
    }


def _text(account: Mapping[str, Any]) -> str:
    size = " x ".join(f"{length} of {name}" for name, length in account["dimensions"].items())
    ends = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in account["status"].items())
    runs = f"{account['runs']} run{'' if account['runs'] == 1 else 's'}"
    head = f"{account['model']}: {runs} ({size}): {ends}; {account['held']} stay bounded"
    rows = [("of bounded runs", "5th percentile", "median", "95th percentile", "")]
    for name, values in account["quantiles_of_held"].items():
        if values:
            rows.append((name, *(f"{value:.6g}" for value in values.values()), account["units"][name]))
    lines = [head, table(rows), *(f"  {path}" for path in account["files"])]
    return "\n".join(lines)
