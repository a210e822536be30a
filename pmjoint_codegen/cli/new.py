"""``pmjoint new``: a commented model file that simulates at once."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click

from pmjoint_codegen.cli.options import Place
from pmjoint_codegen.cli.terminal import result

TEMPLATES = Path(__file__).resolve().with_name("templates")

_ABOUT = """Write a model file for a new model called NAME, with a comment beside each entry.

It simulates as it stands; change it from there. A file that exists is never overwritten.
"""

_EXAMPLES = """\b
Examples
  pmjoint new elbow                    models/elbow.toml, a joint with two muscles
  pmjoint new motor --system           models/motor.toml, any states and rates, brought to the class
  pmjoint new oscillator --plant       models/oscillator.toml, any plant of the class
  pmjoint new elbow --out designs      designs/elbow.toml
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("name")
@click.option("--joint", "kind", flag_value="joint", default=True, help="Two muscles on a pulley [default].")
@click.option(
    "--plant", "kind", flag_value="plant", help="A plant in output-feedback form, by its equations."
)
@click.option("--system", "kind", flag_value="system", help="A plant by its own states and their rates.")
@click.option(
    "--out",
    type=Place(),
    metavar="DIR",
    help="Folder [default: the project's models, here or in a folder above].",
)
def command(name: str, kind: str | None, out: Path | None) -> None:
    """Run ``pmjoint new``: click passes the parsed arguments."""
    from pmjoint_codegen.workspace import project_models

    path = create(name, kind or "joint", out or project_models())
    result(f"{path}\nnext: pmjoint simulate {shlex.quote(str(path))}")


def create(name: str, kind: str, folder: Path) -> Path:
    """Write ``<folder>/<name>.toml``.

    Args:
        name: of the model; it also names its folder under ``generated/``.
        kind: ``joint``, ``system`` or ``plant``.
        folder: created if needed.

    Raises:
        UsageError: an invalid name, a file that exists, a folder that cannot be written.
    """
    from pmjoint_codegen.errors import UsageError, quoted
    from pmjoint_codegen.modelfile.names import MODEL_NAME
    from pmjoint_codegen.storage import ensure_folder, write_text

    if not re.fullmatch(MODEL_NAME, name):
        remedy = "allowed: letters, digits, - and _, beginning with a letter or digit, 64 at most"
        raise UsageError(f"{quoted(name)} is not a valid model name", remedy=remedy)
    path = folder / f"{name}.toml"
    if path.exists() or path.is_symlink():
        raise UsageError("exists already", where=str(path), remedy="choose another name, or delete it first")
    ensure_folder(folder)
    template = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8")
    write_text(path, template.replace('"NAME"', f'"{name}"', 1))
    return path
