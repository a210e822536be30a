"""``pmjoint export``: the controller of a model for somebody else's tool chain."""

from __future__ import annotations

from pathlib import Path

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, result

_ABOUT = """Write the controller of MODEL for another tool chain.

Target c is a folder of readable C99: the controller with a self test of recorded data, an example, a
Makefile, and trace.json, which names the line of each term of the equations. `make -C DIR test` builds and
runs all of it.
"""

_EXAMPLES = """\b
Examples
  pmjoint export paper --target c --out controller && make -C controller test
  pmjoint export joint-lag --target c --precision float --out controller
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.option("--target", type=click.Choice(["c"]), required=True, help="What to write.")
@click.option("--out", type=Place(), required=True, metavar="DIR", help="Folder to write to.")
@click.option(
    "--precision",
    type=click.Choice(["double", "float"]),
    default="double",
    show_default=True,
    help="Type of all numbers; float throughout is for processors whose hardware has no double.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(model: str, target: str, out: Path, precision: str, as_json: bool) -> None:
    """Run ``pmjoint export``: click passes the parsed arguments."""
    from pmjoint_codegen.storage import ensure_folder, write_text

    ensure_folder(out)
    with activity(f"exporting {model}") as shown:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen import __version__
        from pmjoint_codegen.export.package import cost_of, export_c
        from pmjoint_codegen.export.source import Identity
        from pmjoint_codegen.export.tree import DOUBLE, FLOAT
        from pmjoint_codegen.identity import model_hash
        from pmjoint_codegen.modelfile import model_of
        from pmjoint_codegen.modelfile.reader import read_document
        from pmjoint_codegen.workspace import find_model
        from pmjoint_derive import derive

        path = find_model(model)
        shown.stage("reading the model", 0.0)
        contents = read_document(path)
        source = model_of(contents, str(path))
        derivation = derive(source, shown.stage)
        shown.stage("writing", 0.0)
        identity = Identity(source.name, model_hash(contents), __version__)
        made = export_c(derivation, identity, {"double": DOUBLE, "float": FLOAT}[precision])
        cost = cost_of(made.program, made.precision)
        for name, text in made.files.items():
            write_text(out / name, text)
    record = {
        "model": source.name,
        "model_hash": identity.model_hash,
        "target": target,
        "precision": precision,
        "folder": str(out),
        "files": sorted(made.files),
        "v_error_bound": cost.bound,
        "v_largest": cost.largest,
    }
    if as_json:
        document(record)
    else:
        bound, reach = f"{cost.bound:.2g} {source.u_unit}", f"{cost.largest:.3g} {source.u_unit}"
        result(
            f"{source.name}: {len(made.files)} files in {out}; test them with make -C {out} test\n"
            f"{precision} moves v by at most {bound} where |v| reaches {reach} "
            "(derived bound, over the samples of the self test)"
        )
