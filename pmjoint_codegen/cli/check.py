"""``pmjoint check``: check the generated code against the symbolic reference, gate by gate."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pmjoint_codegen.cli.options import ModelName, Place
from pmjoint_codegen.cli.terminal import activity, document, message, result
from pmjoint_codegen.errors import PmjointError

if TYPE_CHECKING:
    from pmjoint_codegen.check.result import GateResult
    from pmjoint_codegen.check.subject import Subject
    from pmjoint_codegen.check.table import Gate
    from pmjoint_codegen.cli.terminal import Shown


_ABOUT = """Check generated/<name>/ of each MODEL (of all models if none is named).

Every gate prints what it measured and the bound on it. The exit code is 1 if any gate failed. A gate whose
tool is missing says so and does not count as passed. If no gate could check anything, the exit code is 3.
"""

_EXAMPLES = """\b
Examples
  pmjoint check                             every model, every gate
  pmjoint check paper --gate symbolic       one gate
  pmjoint check --junit check.xml           for continuous integration
  pmjoint check paper --update-golden       make the present trajectory the reviewed one
"""


@click.command(help=_ABOUT, epilog=_EXAMPLES)
@click.argument("models", nargs=-1, type=ModelName(), metavar="[MODEL]...")
@click.option(
    "--gate",
    "names",
    multiple=True,
    metavar="NAME",
    help="Run this gate only; repeatable. `trajectory` selects every gate that begins so.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--junit", "report", type=Place(dir_okay=False), help="Write a JUnit file.")
@click.option(
    "--update-golden",
    is_flag=True,
    help="Rewrite golden/<model>.csv before checking; review the difference.",
)
def command(
    models: tuple[str, ...], names: tuple[str, ...], as_json: bool, report: Path | None, update_golden: bool
) -> int:
    """Run ``pmjoint check``: click passes the parsed arguments."""
    with activity("checking") as shown:
        shown.stage("loading the gates", 0.0)
        from pmjoint_codegen.check.table import select
        from pmjoint_codegen.storage import ensure_file

        gates = select(names)
        if report is not None:
            ensure_file(report)
        relay = _Relay()
        subjects = _subjects(models, relay)
    results: dict[str, list[GateResult]] = {}
    for subject in subjects:
        if update_golden:
            _update(subject)
        results[subject.model.name] = list(_checked(subject, gates, relay, quiet=as_json))
    if report is not None:
        from pmjoint_codegen.check.junit import junit
        from pmjoint_codegen.storage import write_text

        prints = {subject.model.name: subject.fingerprint for subject in subjects}
        write_text(report, junit(results, prints))
    if as_json:
        document([_record(model, gate) for model, found in results.items() for gate in found])
    return _conclude([gate for found in results.values() for gate in found])


def _conclude(found: Sequence[GateResult]) -> int:
    """Give the exit code.

    Raises:
        PmjointError: no gate could check anything.
    """
    if all(gate.verdict == "not run" for gate in found):
        names: dict[str, dict[str, None]] = {}  # reason -> gates, each once, in their order
        for gate in found:
            names.setdefault(gate.detail, {})[gate.name] = None
        reasons = (f"{reason} ({', '.join(gates)})" for reason, gates in names.items())
        raise PmjointError(f"nothing was checked: {'; '.join(reasons) or 'no model is known here'}")
    return int(any(gate.verdict == "failed" for gate in found))


class _Relay:
    """Passes stages to the activity shown at the time, so that no activity runs while a result is printed."""

    def __init__(self) -> None:
        self.shown: Shown | None = None

    def __call__(self, name: str, done: float) -> None:
        """Record the current stage."""
        if self.shown is not None:
            self.shown.stage(name, done)


def _subjects(models: Sequence[str], relay: _Relay) -> list[Subject]:
    from pmjoint_codegen.check.subject import load_subject
    from pmjoint_codegen.workspace import find_model, known_models

    files = [find_model(model) for model in models or known_models()]
    return [load_subject(file, os.environ, message, relay) for file in files]


def _update(subject: Subject) -> None:
    from pmjoint_codegen.check.gates import golden

    for path in golden.write(subject):
        message(f"written: {path}")


def _checked(subject: Subject, gates: Sequence[Gate], relay: _Relay, *, quiet: bool) -> Iterator[GateResult]:
    from pmjoint_codegen.check.table import run_gates

    if not quiet:
        result(f"{subject.model.name}: {subject.model.title}")
    running = run_gates(subject, gates, relay)
    while True:
        with activity(f"checking {subject.model.name}") as relay.shown:
            found = next(running, None)
        if found is None:
            return
        if not quiet:
            result("\n".join(lines(found)))
        yield found


def lines(found: GateResult) -> Iterator[str]:
    """One line per gate; for a failed gate, everything that helps to see why."""
    measured = (
        f"{found.figure:.3g} <= {found.bound:g}"
        if found.figure is not None and found.bound is not None
        else ""
    )
    if found.figure == found.bound == 0:
        measured = "0"  # a count of faults: only 0 is allowed
    if found.verdict == "failed":
        measured = measured.replace("<=", "against")
    yield f"  {found.name:23s} {found.verdict.value:8s} {measured:20s} {found.detail} ({found.seconds:.1f} s)"
    if found.verdict == "failed":
        details = [*(str(found.difference).splitlines() if found.difference else []), *found.findings]
        yield from (f"      {line}" for line in details)
    elif found.name == "proof":
        yield from (f"      {line}" for line in found.findings)


def _record(model: str, gate: GateResult) -> dict[str, object]:
    difference = gate.difference
    return {
        "model": model,
        "gate": gate.name,
        "verdict": gate.verdict.value,
        "figure": gate.figure,
        "bound": gate.bound,
        "detail": gate.detail,
        "seconds": round(gate.seconds, 3),
        "findings": list(gate.findings),
        "difference": None
        if difference is None
        else {
            name: getattr(difference, name)
            for name in ("kernel", "entry", "point", "expected", "found", "error", "bound")
        },
    }
