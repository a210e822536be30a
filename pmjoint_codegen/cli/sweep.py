"""``pmjoint sweep``: many runs over grids and samples; one dataset, and figures of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from pmjoint_codegen.cli.drawing import ready_matplotlib
from pmjoint_codegen.cli.options import (
    ModelName,
    Place,
    check_saturation,
    run_options,
    tell_clock,
    tell_design,
)
from pmjoint_codegen.cli.terminal import activity, document, message, result, table

if TYPE_CHECKING:
    from pmjoint_codegen.manifest import Manifest
    from pmjoint_codegen.provision import Reference
    from pmjoint_codegen.simulate.settings import CommandOptions
    from pmjoint_codegen.sweep.store import Store

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
    from pmjoint_codegen.studies.sweep import make_study

    check_saturation(saturation, asked)
    study = make_study(
        model,
        grid=grid,
        sample=sample,
        runs=draws,
        seed=seed,
        method=method,
        reference=reference,
        disturbance=disturbance,
        saturation=saturation,
        formats=formats,
        scheduler=scheduler,
        notify=_notify,
        **asked,
    )
    manifest = study.provided.manifest
    tell_clock(asked, manifest)
    tell_design(manifest, study.warning)
    folder = out or Path("runs") / f"{manifest.name}-sweep"
    with study.computed(
        folder, threads=threads, scheduler=scheduler, restart=restart, watch=activity, notify=_notify
    ) as store:
        files = _export(store, formats)
        account = _account(store, manifest, files)
        try:
            if not no_figures:
                account["files"] = (*files, *_draw(store, manifest))
        finally:  # report the result even if the figures fail
            if wants_json:
                document(account)
            else:
                result(_text(account))


def _notify(line: str) -> None:
    message(f"pmjoint: {line}")


def _export(store: Store, formats: tuple[str, ...]) -> tuple[Path, ...]:
    files = [store.dataset]
    if formats:
        from pmjoint_codegen.sweep.formats import export

        with activity(f"writing {' and '.join(formats)}"):
            files += [export(store.dataset, kind) for kind in formats]
    return tuple(files)


def _draw(store: Store, manifest: Manifest) -> tuple[Path, ...]:
    from pmjoint_codegen.sweep.dataset import read
    from pmjoint_codegen.sweep.maps import write_maps

    ready_matplotlib()
    with activity("drawing figures"):
        return write_maps(read(store.dataset), manifest, store.folder)


def _account(store: Store, manifest: Manifest, files: tuple[Path, ...]) -> dict[str, Any]:
    """The sweep in a few numbers."""
    from pmjoint_codegen.sweep.metrics import quantities
    from pmjoint_codegen.sweep.totals import totals

    request = store.request
    with activity("counting"):
        ends = totals(store.dataset)
    units = {item.name: item.unit for item in quantities(manifest)}
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
        "counts_of_held": ends.counts,
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
            count, unit = account["counts_of_held"][name], account["units"][name]
            some = "" if count == account["held"] else f", in {count}"  # the others have not settled
            rows.append((name, *(f"{value:.6g}" for value in values.values()), f"{unit}{some}"))
    lines = [head, table(rows), *(f"  {path}" for path in account["files"])]
    return "\n".join(lines)
