"""Results of ``pmjoint check`` for a report: quick gates run here, the others come from a file or are absent.

A result from a file is taken only if the file's fingerprint is the model's: a stale one is never shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pmjoint_codegen.check.junit import Recorded, read_junit
from pmjoint_codegen.check.result import GateResult, Verdict, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.table import GATES, Gate, run_gates
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.workspace import GENERATED, called
from pmjoint_derive.progress import Stage

QUICK: Final = (
    "current",
    "proof",
    "guards",
    "derivatives",
    "trajectory.golden",
    "trajectory.certificate",
)
HERE, FILE, NOWHERE = "here", "in the file", ""


@dataclass(frozen=True)
class Row:
    """A gate and what came of it.

    Attributes:
        gate: the gate.
        result: its result, or None if it was not run for this model as it is.
        origin: `HERE`, `FILE` or `NOWHERE`.
    """

    gate: Gate
    result: GateResult | None
    origin: str

    @property
    def verdict(self) -> str:
        """Passed, failed or not run."""
        return "not run" if self.result is None else self.result.verdict.value


@dataclass(frozen=True)
class Checked:
    """All gates.

    Attributes:
        rows: in the order of the table.
        refused: why results of the file were not taken, or nothing.
        command: runs all gates and leaves a file for the report.
    """

    rows: tuple[Row, ...]
    refused: str
    command: str

    @property
    def failed(self) -> tuple[Row, ...]:
        """Gates that failed."""
        return tuple(row for row in self.rows if row.verdict == Verdict.FAILED)

    @property
    def passed(self) -> tuple[Row, ...]:
        """Gates that passed."""
        return tuple(row for row in self.rows if row.verdict == Verdict.PASSED)

    @property
    def open(self) -> tuple[Row, ...]:
        """Gates that were not run, or could not."""
        return tuple(row for row in self.rows if row.verdict == Verdict.NOT_RUN)


def checked(subject: Subject, *, recorded: Path | None, full: bool, stage: Stage) -> Checked:
    """Run the quick gates, or all, and read the results of the others.

    Args:
        subject: the model.
        recorded: a JUnit file of ``pmjoint check``, or None.
        full: run every gate.
        stage: called with the current gate.

    Raises:
        UsageError: the file cannot be read, or is none of ``pmjoint check``.
    """
    from_file, refused = _from_file(subject, recorded)
    here = [gate for gate in GATES if full or gate.name in QUICK]
    found = {result.name: result for result in run_gates(subject, here, stage)}
    rows = []
    for gate in GATES:
        if gate.name == "current" and not subject.folder.is_dir():
            told = f"nothing is generated; pmjoint regenerate {called(subject.file)} writes {GENERATED}/"
            rows.append(Row(gate, not_run(told), HERE))
        elif gate.name in found:
            rows.append(Row(gate, found[gate.name], HERE))
        elif gate.name in from_file:
            rows.append(Row(gate, from_file[gate.name], FILE))
        else:
            rows.append(Row(gate, None, NOWHERE))
    name = called(subject.file)
    command = f"pmjoint check {name} --junit check.xml && pmjoint report {name} --check check.xml"
    return Checked(tuple(rows), refused, command)


def _from_file(subject: Subject, recorded: Path | None) -> tuple[dict[str, GateResult], str]:
    """Results by gate, and why there are none of a file that was given."""
    if recorded is None:
        return {}, ""
    remedy = f"pmjoint check {called(subject.file)} --junit {recorded}"
    try:
        contents = read_junit(recorded.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        what = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageError(what, where=str(recorded), remedy=f"write it: {remedy}") from None
    return _accepted(contents.get(subject.model.name), subject.fingerprint)


def _accepted(suite: Recorded | None, fingerprint: str) -> tuple[dict[str, GateResult], str]:
    if suite is None:
        return {}, "the file of pmjoint check has no results of this model"
    if suite.fingerprint != fingerprint:
        return {}, (
            "the file of pmjoint check is of another state of the model, its generated files or this "
            "program; its results are left out"
        )
    return {result.name: result for result in _ran(suite.results)}, ""


def _ran(results: Sequence[GateResult]) -> list[GateResult]:
    return [result for result in results if result.name]
