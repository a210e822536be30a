"""``pmjoint audit``: check the paper's printed equations against what follows from its model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import Place
from pmjoint_codegen.cli.terminal import activity, as_json, message, result

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pmjoint_codegen.audit.findings import Finding

FORMATS = ("table", "markdown", "json")

_ABOUT = """Check every printed equation of the paper against what follows from its model.

Each of (1)-(37), and each claim made in words, gets a verdict: follows, definition, assumption, follows
with a correction, does not follow. Verdicts are computed: differences expand to zero, remainders are sums
of squares, and claims about the closed loop are tested on it.
"""

_EXAMPLES = """\b
Examples
  pmjoint audit
  pmjoint audit --json | jq '.findings[] | select(.verdict == "does not follow")'
  pmjoint audit --format markdown --out docs/audit.md
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    help="What to print; markdown has formulas. [default: table]",
)
@click.option("--json", "json_wanted", is_flag=True, help="Print one JSON document, as --format json does.")
@click.option("--out", type=Place(dir_okay=False), help="Write to a file instead.")
def command(form: str | None, json_wanted: bool, out: Path | None) -> None:
    """Run ``pmjoint audit``: click passes the parsed arguments."""
    if json_wanted and form not in (None, "json"):
        raise click.UsageError(f"--json and --format {form} exclude each other")
    if out is not None:
        from pmjoint_codegen.storage import ensure_file

        ensure_file(out)  # before the audit, which takes a while
    text = _written(_findings(), "json" if json_wanted else form or "table")
    if out is None:
        result(text.rstrip("\n"))
        return
    from pmjoint_codegen.storage import write_text

    write_text(out, text if text.endswith("\n") else f"{text}\n")
    message(f"wrote {out}")


def _findings() -> tuple[Finding, ...]:
    with activity("auditing the paper") as progress:
        try:
            from pmjoint_codegen.audit.examination import audit
        except ModuleNotFoundError as error:
            from pmjoint_codegen.errors import MissingToolError, installing

            remedy = f"install it: {installing('pmjoint-codegen[derive]')}"
            raise MissingToolError(f"{error.name} is needed to audit", where="audit", remedy=remedy) from None
        try:
            return audit(lambda done: progress.stage("examining claims", done), message)
        except ArithmeticError as error:  # a claim lacks its basis: another model has that name
            from pmjoint_codegen.errors import ModelError
            from pmjoint_codegen.workspace import find_model

            remedy = "run the audit in a folder without a model called paper"
            what = f"is not the paper's model ({error})"
            raise ModelError(what, where=str(find_model("paper")), remedy=remedy) from error


def _written(findings: Sequence[Finding], form: str) -> str:
    from pmjoint_codegen.audit import report

    if form == "json":
        return as_json(report.record(findings))
    return report.markdown_report(findings) if form == "markdown" else report.table_report(findings)
