"""``pmjoint report``: a model, its proof, its checks and its runs as one page."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, message, result
from pmjoint_codegen.errors import UsageError

_ABOUT = """Write a report of MODEL: one HTML page that needs no network and no script.

The page has the model and its sources, the derivation, the proof with its squares, the results of the checks
with their margins, kernels and the line of each term, figures of the run, the region of recovery, margins,
and what is not covered. The quick gates run with the report; results of the others come from a file of
pmjoint check, if it is of this model as it is. With OTHER, the page shows what differs between two models.
MODEL@REV is a model as it was in a revision of git.
"""

_EXAMPLES = """\b
Examples
  pmjoint report paper
  pmjoint report paper --pdf
  pmjoint report joint joint-damped         two models side by side
  pmjoint report paper@HEAD~3 paper         what changed since; also: pmjoint report paper --rev HEAD~3
  pmjoint check paper --junit check.xml && pmjoint report paper --check check.xml
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.argument("other", type=ModelName(), required=False)
@click.option(
    "--out", type=Place(dir_okay=False), metavar="FILE", help="The page [default: <model>-report.html]."
)
@click.option("--pdf", is_flag=True, help="Print it as PDF too, beside the page; needs a browser.")
@click.option(
    "--check",
    "recorded",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="A JUnit file of pmjoint check, for the gates that are not run here.",
)
@click.option("--rev", "revision", metavar="REV", help="Compare MODEL with what it was in a git revision.")
@click.option("--full", is_flag=True, help="Run every gate; it takes a minute or more.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    other: str | None,
    out: Path | None,
    pdf: bool,
    recorded: Path | None,
    revision: str | None,
    full: bool,
    as_json: bool,
) -> int:
    """Run ``pmjoint report``: click passes the parsed arguments."""
    if revision is not None:
        if other is not None:
            raise UsageError(
                "compares one model", where="--rev", remedy="name both: pmjoint report A@REV1 B@REV2"
            )
        model, other = f"{model}@{revision}", model
    if other is not None and (recorded or full):
        raise UsageError(
            "belongs to a report of one model", where="--full" if full else "--check", remedy="leave it out"
        )
    with activity(f"reporting on {model}") as shown, ExitStack() as places:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen.dossier.browser import find_browser, printed
        from pmjoint_codegen.dossier.facts import gather
        from pmjoint_codegen.dossier.page import model_page
        from pmjoint_codegen.storage import ensure_file, write_bytes, write_text

        browser = find_browser(os.environ) if pdf else ""
        if out is not None:
            ensure_file(out)
        facts = gather(
            _located(model, places),
            environment=os.environ,
            notify=_tell,
            stage=shown.stage,
            recorded=recorded,
            full=full,
            called=model,
        )
        page, stem = "", facts.manifest.name
        if other is not None:
            from pmjoint_codegen.dossier.compare import comparison_page

            place = _located(other, places)
            second = gather(place, environment=os.environ, notify=_tell, stage=shown.stage, called=other)
            page, stem = comparison_page(facts, second), f"{stem}-{second.manifest.name}"
        shown.stage("drawing figures", 0.0)
        page = page or model_page(facts)
        file = out or Path(f"{stem}-report.html")
        write_text(file, page)
        files = [file]
        if pdf:
            shown.stage("printing", 0.0)
            files.append(file.with_suffix(".pdf"))
            write_bytes(files[-1], printed(page, browser))
    checks = facts.checks
    if checks.refused:
        _tell(f"--check {recorded}: {checks.refused}")
    counts = {"passed": len(checks.passed), "failed": len(checks.failed), "not run": len(checks.open)}
    if as_json:
        document({"model": facts.manifest.name, "files": [str(item) for item in files], "gates": counts})
    else:
        told = ", ".join(f"{count} {word}" for word, count in counts.items())
        result(f"{facts.manifest.name}: {', '.join(map(str, files))}; gates: {told}")
    return 1 if checks.failed else 0


def _located(asked: str, places: ExitStack) -> str | Path:
    """The model as asked; that of ``MODEL@REV`` stands in a temporary folder while `places` is open."""
    name, at, revision = asked.rpartition("@")
    if not at or Path(asked).exists():
        return asked
    from pmjoint_codegen.review.earlier import earlier
    from pmjoint_codegen.workspace import find_model

    return places.enter_context(earlier(find_model(name), revision))


def _tell(line: str) -> None:
    message(f"pmjoint: {line}")
