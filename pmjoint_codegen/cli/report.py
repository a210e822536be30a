"""``pmjoint report``: a model, its proof, its checks and its runs as one page."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, message, result

if TYPE_CHECKING:
    from pmjoint_codegen.dossier.facts import Facts
    from pmjoint_codegen.dossier.gates import Checked
    from pmjoint_codegen.dossier.versions import Side
    from pmjoint_derive.progress import Stage

_ABOUT = """Write a report of MODEL: one HTML page that needs no network and no script.

The page has the model and its sources, the derivation, the proof with its squares, the results of the checks
with their margins, kernels and the line of each term, figures of the run, the region of recovery, margins,
and what is not covered. The quick gates run with the report; results of the others come from a file of
pmjoint check, if it is of this model as it is. With OTHER, the page shows
what differs between two models instead, and no gate is run. MODEL@REV is a model as it was in a revision of
git; --rev REV compares MODEL@REV with MODEL.
"""

_EXAMPLES = """\b
Examples
  pmjoint report paper
  pmjoint report paper --pdf
  pmjoint report joint joint-damped         two models side by side
  pmjoint report paper --rev main           what a branch changes
  pmjoint report paper@v1 paper@HEAD~3      two revisions side by side
  pmjoint check paper --junit check.xml && pmjoint report paper --check check.xml
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("model", type=ModelName())
@click.argument("other", type=ModelName(), required=False)
@click.option("--rev", "revision", metavar="REV", help="Compare MODEL in this revision with MODEL as it is.")
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
@click.option("--full", is_flag=True, help="Run every gate; it takes a minute or more.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(
    model: str,
    other: str | None,
    revision: str | None,
    out: Path | None,
    pdf: bool,
    recorded: Path | None,
    full: bool,
    as_json: bool,
) -> int:
    """Run ``pmjoint report``: click passes the parsed arguments."""
    two = other is not None or revision is not None
    if other is not None and revision is not None:
        raise click.UsageError("--rev compares a model with itself; for two, append the revision: MODEL@REV")
    if two and (full or recorded is not None):
        option = "--full" if full else "--check"
        raise click.UsageError(f"{option} is for the report of one model; a comparison has no gates")
    with activity(f"reporting on {model}") as shown, ExitStack() as stack:
        shown.stage("loading the toolchain", 0.0)
        from pmjoint_codegen.dossier.browser import find_browser, printed
        from pmjoint_codegen.dossier.page import model_page
        from pmjoint_codegen.dossier.versions import opened
        from pmjoint_codegen.storage import ensure_file, write_bytes, write_text
        from pmjoint_codegen.workspace import called

        browser = find_browser(os.environ) if pdf else ""
        if out is not None:
            ensure_file(out)
        sides = [stack.enter_context(opened(model, revision))]
        if two:
            sides.append(stack.enter_context(opened(other or model)))
            made = [_facts(side, shown.stage, None, False, True) for side in sides]
            from pmjoint_codegen.dossier.compare import comparison_page

            shown.stage("drawing figures", 0.0)
            page = comparison_page(made[0], made[1])
        else:
            if sides[0].revision is not None:
                raise click.UsageError(
                    f"a revision is compared with something: pmjoint report {model} {called(sides[0].shown)}"
                )
            made = [_facts(sides[0], shown.stage, recorded, full, False)]
            shown.stage("drawing figures", 0.0)
            page = model_page(made[0])
        stems = [
            "-".join(filter(None, (facts.manifest.name, side.commit)))
            for facts, side in zip(made, sides, strict=True)
        ]
        file = out or Path(f"{'-'.join(stems)}-report.html")
        write_text(file, page)
        files = [file]
        if pdf:
            shown.stage("printing", 0.0)
            files.append(file.with_suffix(".pdf"))
            write_bytes(files[-1], printed(page, browser))
    told = ", ".join(map(str, files))
    names = [facts.called if two else facts.manifest.name for facts in made]
    record: dict[str, object] = {"model": names[0], "files": [str(item) for item in files]}
    if two:
        line = f"{names[0]} and {names[1]}: {told}"
        record["other"] = names[1]
    else:
        counts = _counts(made[0].checks, recorded)
        line = f"{names[0]}: {told}; gates: {', '.join(f'{count} {word}' for word, count in counts.items())}"
        record["gates"] = counts
    if as_json:
        document(record)
    else:
        result(line)
    return 1 if made[0].checks.failed else 0


def _facts(side: Side, stage: Stage, recorded: Path | None, full: bool, compared: bool) -> Facts:
    from contextlib import nullcontext

    from pmjoint_codegen.dossier.facts import gather
    from pmjoint_codegen.review.checkout import named_as

    earlier = side.revision
    with named_as(side.shown, side.file, earlier) if earlier is not None else nullcontext():
        return gather(
            side.file,
            environment=os.environ,
            notify=_tell,
            stage=stage,
            recorded=recorded,
            full=full,
            called=side.called,
            origin=side.origin,
            compared=compared,
        )


def _counts(checks: Checked, recorded: Path | None) -> dict[str, int]:
    """Gates by what came of them; says why a file's results were not taken."""
    if checks.refused:
        _tell(f"--check {recorded}: {checks.refused}")
    return {"passed": len(checks.passed), "failed": len(checks.failed), "not run": len(checks.open)}


def _tell(line: str) -> None:
    message(f"pmjoint: {line}")
