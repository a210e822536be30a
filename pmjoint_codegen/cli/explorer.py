"""``pmjoint explorer``: a page that runs the closed loop in a browser."""

from __future__ import annotations

import os
from pathlib import Path

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, message, result

_ABOUT = """Write a page that runs the closed loop of MODEL in a browser.

It is one file that opens from disk, without a server or a network: sliders for gains, limits, start,
reference, load and mismatch, and plots that follow while they move. It holds the C of pmjoint simulate,
compiled to WebAssembly, so its numbers are the command line's. A link to the page carries the settings.
"""

_EXAMPLES = """\b
Examples
  pmjoint explorer
  pmjoint explorer joint --out joint.html
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName(), default="paper")
@click.option("--out", type=Place(), metavar="FILE", help="The page to write [default: <model>.html].")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(model: str, out: Path | None, as_json: bool) -> None:
    """Run ``pmjoint explorer``: click passes the parsed arguments."""
    from pmjoint_codegen.compile.zig import zig_compiler
    from pmjoint_codegen.storage import write_text

    zig_compiler(os.environ)  # without it, say so before a derivation
    with activity(f"preparing {model}") as shown:
        from pmjoint_codegen.explorer.page import make_page, prepare

        prepared = prepare(model, environment=os.environ, notify=_tell, stage=shown.stage)
        page = make_page(prepared, environment=os.environ, notify=_tell, stage=shown.stage)
        file = out or Path(f"{prepared.title}.html")
        write_text(file, page.html)
    record = {
        "model": prepared.title,
        "file": str(file),
        "bytes": len(page.html.encode()),
        "saturations": list(page.saturations),
        "knobs": list(page.knobs),
        "modules": dict(page.bytes),
    }
    if as_json:
        document(record)
    else:
        kinds = ", ".join(page.saturations)
        result(f"{prepared.title}: {file}, {record['bytes']} bytes; saturation: {kinds}")


def _tell(line: str) -> None:
    message(f"pmjoint: {line}")
