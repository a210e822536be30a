"""The gates of ``pmjoint check``, with what was measured against what is allowed."""

from __future__ import annotations

from pmjoint_codegen.check.result import GateResult
from pmjoint_codegen.dossier.facts import Facts
from pmjoint_codegen.dossier.gates import NOWHERE, Row
from pmjoint_codegen.dossier.markup import chapter, code, items, number, paragraph, plain, table, tag


def checks_chapter(facts: Facts) -> str:
    """A table of the gates, and all that failed ones found."""
    checks = facts.checks
    told = f"{len(checks.passed)} gates passed, {len(checks.failed)} failed, {len(checks.open)} were not run."
    parts = [
        paragraph(
            tag("strong", told),
            " A margin is the share of the bound that is left. "
            "A gate ran here, with the report, or its result is in the file of pmjoint check.",
        )
    ]
    if checks.refused:
        parts.append(paragraph(tag("strong", "Left out: "), plain(checks.refused), "."))
    if any(row.origin == NOWHERE for row in checks.rows):
        words = "The other gates take longer than a report may. They run, and come into the report, with"
        parts.append(paragraph(words, " ", code(checks.command), ", or with ", code("--full"), "."))
    head = ("gate", "checked side against the reference", "result", "measured", "bound", "margin", "ran")
    parts.append(table(head, map(_row, checks.rows), right=(3, 4, 5)))
    parts += [_findings(row) for row in checks.rows if _told(row)]
    return chapter("checks", "Checks", *parts)


def _told(row: Row) -> bool:
    """Whether its findings stand below the table; those of a proof that holds have their own chapter."""
    if row.result is None or (row.gate.name == "proof" and row.verdict == "passed"):
        return False
    return bool(row.result.findings or row.result.difference)


def _row(row: Row) -> tuple[str, ...]:
    result = row.result
    verdict = tag("span", row.verdict, class_=row.verdict.replace(" ", "-"))
    about = plain(row.gate.about)
    if result is None:
        return code(row.gate.name), about, verdict, "", "", "", ""
    detail = tag("div", plain(result.detail), class_="detail")
    shown = (number(result.figure, 3), number(result.bound, 6)) if result.figure is not None else ("", "")
    return code(row.gate.name), about + detail, verdict, *shown, margin(result), row.origin


def margin(result: GateResult) -> str:
    """The share of the bound that is left, in percent; of a count of faults, that none is allowed."""
    if result.figure is None or result.bound is None:
        return ""
    if result.bound == 0:
        return "exact" if result.figure == 0 else "none allowed"
    left = 1 - result.figure / result.bound
    return f"{number(100 * left, 3)} %" if left >= 0 else f"exceeded by {number(-100 * left, 3)} %"


def _findings(row: Row) -> str:
    assert row.result is not None
    lines = [plain(line) for line in row.result.findings if not line.startswith("squares given away")]
    difference = [plain(line) for line in str(row.result.difference or "").splitlines()]
    return tag("h3", code(row.gate.name), id=f"gate-{row.gate.name}") + items([*lines, *difference])
