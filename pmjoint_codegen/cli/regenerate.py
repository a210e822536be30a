"""``pmjoint regenerate``: write ``generated/<model>/``, or report what is stale and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import ModelName
from pmjoint_codegen.cli.terminal import activity, document, result

if TYPE_CHECKING:
    from pmjoint_codegen.emit.regenerate import Report


_ABOUT = """Write generated/<name>/ of each MODEL (of all models if none is named).

A folder is replaced as a whole, and only if it would change. The output lists the named equations that are
new, gone or different.
"""

_EXAMPLES = """\b
Examples
  pmjoint regenerate paper
  pmjoint regenerate --check       what continuous integration runs
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("models", nargs=-1, type=ModelName(), metavar="[MODEL]...")
@click.option("--check", is_flag=True, help="Write nothing; exit with 1 if anything is stale.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(models: tuple[str, ...], check: bool, as_json: bool) -> int:
    """Run ``pmjoint regenerate``: click passes the parsed arguments."""
    with activity("regenerating") as shown:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen.emit.regenerate import regenerate

        reports = regenerate(models, check=check, stage=shown.stage)
    if as_json:
        document([_record(report) for report in reports])
    else:
        width = max((len(report.name) for report in reports), default=0)
        result("\n".join(line for report in reports for line in report_lines(report, width)))
    return int(check and any(report.stale for report in reports))


def report_lines(report: Report, width: int = 0) -> Iterator[str]:
    """Describe one model, its name in a column: verdict, reasons, changed equations, and what to do."""
    comparison = report.comparison
    done = f"  written to {report.folder}" if report.written else ""
    yield f"{report.name:<{width}}  {comparison.verdict.value}{done}"
    for detail in comparison.details:
        yield f"    {detail}"
    for change in comparison.changes:
        yield from (f"    {line}" for line in change.equation_lines())
    if report.stale and not report.written:
        yield f"    to fix it: {report.remedy}"


def _record(report: Report) -> dict[str, object]:
    comparison = report.comparison
    return {
        "model": report.name,
        "folder": report.folder,
        "verdict": comparison.verdict.value,
        "written": report.written,
        "details": comparison.details,
        "changes": [asdict(change) for change in comparison.changes],
        "remedy": report.remedy if report.stale and not report.written else None,
    }
