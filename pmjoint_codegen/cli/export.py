"""``pmjoint export``: the controller of a model for somebody else's tool chain."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, message, result
from pmjoint_codegen.export.targets.target import PLATFORMS, TARGETS

_ABOUT = """Write the controller of MODEL for another tool chain.

Every target has the same arithmetic, printed from the derivation's equations, and a self test of recorded
data. With --run it is also built and run with the target's own tools, and the command fails if it does not
hold there. Several targets go into one folder each, named after them, inside DIR.

\b
Targets
""" + "\n".join(f"  {item.name:<12}{item.line}" for item in TARGETS)

_EXAMPLES = """\b
Examples
  pmjoint export paper --target c --run --out controller
  pmjoint export joint-lag --target c --precision float --out controller
  pmjoint export paper --target fmu --platform x86_64-windows --run --out units
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option(
    "--target",
    "targets",
    type=click.Choice([item.name for item in TARGETS]),
    multiple=True,
    required=True,
    help="What to write; repeatable.",
)
@click.option("--out", type=Place(), required=True, metavar="DIR", help="Folder to write to.")
@click.option(
    "--precision",
    type=click.Choice(["double", "float"]),
    default="double",
    show_default=True,
    help="Type of all numbers; float throughout is for processors whose hardware has no double.",
)
@click.option(
    "--hold",
    type=click.Choice(["computed", "baked"]),
    default="computed",
    show_default=True,
    help="Where the matrices of the exact hold come from: init computes them, or they are literals for the "
    "model's own sample time and gains, and init refuses others.",
)
@click.option(
    "--platform",
    "platforms",
    type=click.Choice(PLATFORMS),
    multiple=True,
    help="Add binaries for another platform to FMUs, built by ziglang; repeatable.",
)
@click.option("--run", "runs", is_flag=True, help="Build and run what was written.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    targets: tuple[str, ...],
    out: Path,
    precision: str,
    hold: str,
    platforms: tuple[str, ...],
    runs: bool,
    as_json: bool,
) -> None:
    """Run ``pmjoint export``: click passes the parsed arguments."""
    from pmjoint_codegen.storage import ensure_folder, write_bytes

    names = list(dict.fromkeys(targets))
    records: list[dict[str, Any]] = []
    lines: list[str] = []
    with activity(f"exporting {model}") as shown:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen import __version__
        from pmjoint_codegen.errors import UsageError
        from pmjoint_codegen.export.source import Identity
        from pmjoint_codegen.export.targets.target import Order, target_named
        from pmjoint_codegen.export.tree import DOUBLE, FLOAT
        from pmjoint_codegen.identity import model_hash
        from pmjoint_codegen.modelfile import model_of
        from pmjoint_codegen.modelfile.reader import read_document
        from pmjoint_codegen.workspace import find_model
        from pmjoint_derive import derive

        made = {name: target_named(name) for name in names}
        tunable = [name for name, target in made.items() if hold == "baked" and not target.bakes]
        if tunable:
            told = f"{tunable[0]} takes no baked-in hold: its gains stay tunable"
            raise UsageError(told, where="--hold", remedy="export it with --hold computed")
        ensure_folder(out)
        path = find_model(model)
        shown.stage("reading the model", 0.0)
        contents = read_document(path)
        source = model_of(contents, str(path))
        identity = Identity(source.name, model_hash(contents), __version__)
        kind = {"double": DOUBLE, "float": FLOAT}[precision]
        derivation = derive(source, shown.stage)
        file = path.absolute()
        order = Order(derivation, identity, contents, kind, os.environ, file, _tell, platforms, hold)
        for name in names:
            folder = out / name if len(names) > 1 else out
            shown.stage(f"writing {name}", 0.0)
            target = made[name]
            delivery = target.deliver(order)
            for place, contained in delivery.files.items():
                (folder / place).parent.mkdir(parents=True, exist_ok=True)
                write_bytes(folder / place, contained.encode() if isinstance(contained, str) else contained)
            lines.append(f"{source.name}: {name}: {len(delivery.files)} files in {folder}")
            lines += delivery.report.lines
            record = {"target": name, "folder": str(folder), "files": sorted(delivery.files)}
            record |= delivery.report.record
            if runs:
                shown.stage(f"running {name}", 0.0)
                ran = target.run(order, folder)
                record |= ran.record
                lines += ran.lines
            records.append(record)
    head = {"model": source.name, "model_hash": identity.model_hash, "precision": precision, "hold": hold}
    if as_json:
        document({**head, **records[0]} if len(records) == 1 else {**head, "targets": records})
    else:
        result("\n".join(lines))


def _tell(line: str) -> None:
    message(f"pmjoint: {line}")
