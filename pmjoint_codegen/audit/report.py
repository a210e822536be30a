"""Findings for people and programs: a table for the terminal, Markdown for docs/, one JSON record.

What the paper gets right comes first in all of them but the record, which keeps the paper's order.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain as flattened
from types import MappingProxyType

from pmjoint_codegen.audit.findings import Evidence, Finding
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.audit.notation import latex

SOURCE = (
    "J. Cai, F. Qian, R. Yu, L. Shen, "
    '"Output Feedback Control for Pneumatic Muscle Joint System With Saturation Input", '
    "IEEE Access 8 (2020), DOI 10.1109/ACCESS.2020.2991729"
)
COMMAND = "pmjoint audit --format markdown --out docs/audit.md"
_PREDICATES = MappingProxyType(  # of one, of several
    {
        Verdict.FOLLOWS: ("follows", "follow"),
        Verdict.DEFINITION: ("is a definition", "are definitions"),
        Verdict.ASSUMPTION: ("is an assumption", "are assumptions"),
        Verdict.CORRECTED: ("follows with a correction", "follow with a correction"),
        Verdict.FAILS: ("does not follow", "do not follow"),
    }
)
_WIDTH = 110  # columns of the terminal table
_SHORT_FORMULA = 40  # characters of LaTeX
_INDENT = 14  # of what stands beside a number


def groups(findings: Sequence[Finding]) -> list[tuple[str, list[Finding]]]:
    """Findings under their headings, what is right first."""
    headings = (
        ("What the paper gets right", (Verdict.FOLLOWS,)),
        ("Definitions that agree with how they are used", (Verdict.DEFINITION,)),
        ("Right with a correction", (Verdict.CORRECTED,)),
        ("Assumptions", (Verdict.ASSUMPTION,)),
        ("What does not follow", (Verdict.FAILS,)),
    )
    sorted_ = (
        (heading, [item for item in findings if item.verdict in verdicts]) for heading, verdicts in headings
    )
    return [(heading, members) for heading, members in sorted_ if members]


def counts(findings: Sequence[Finding]) -> dict[str, int]:
    """How many findings have each verdict, in the order of the verdicts."""
    found = Counter(item.verdict for item in findings)
    return {verdict.value: found[verdict] for verdict in Verdict}


def tally(findings: Sequence[Finding]) -> str:
    """The verdicts in one line."""
    numbers = ", ".join(f"{number} {_said(verdict, number)}" for verdict, number in counts(findings).items())
    return f"{len(findings)} displays and claims: {numbers}"


def _said(verdict: str, number: int) -> str:
    """A verdict as the predicate of so many displays."""
    one, many = _PREDICATES[Verdict(verdict)]
    return one if number == 1 else many


def figure(evidence: Evidence) -> str:
    """A computed fact's value with its unit."""
    value = f"{evidence.value:.7g}" if isinstance(evidence.value, float | int) else evidence.value
    return f"{value} {evidence.unit}".rstrip()


def table_report(findings: Sequence[Finding]) -> str:
    """Findings for a terminal: a paragraph each, with its correction; the facts where a claim is at stake."""
    lines = [SOURCE, tally(findings)]
    for heading, members in groups(findings):
        lines += ["", heading.upper(), *flattened.from_iterable(_paragraph(item) for item in members)]
    return "\n".join(lines)


def _paragraph(item: Finding) -> Iterator[str]:
    margin = " " * _INDENT
    head = f"{item.number:<{_INDENT - 1}} " if len(item.number) < _INDENT else f"{item.number}  "
    yield from textwrap.wrap(
        f"{item.title}: {item.summary}", _WIDTH, initial_indent=head, subsequent_indent=margin
    )
    for line in item.corrected:
        yield f"{margin}should be: {line}"
    if item.reading:
        yield from textwrap.wrap(item.reading, _WIDTH, initial_indent=margin, subsequent_indent=margin)
    if item.verdict is Verdict.FAILS or not item.printed:
        yield from (f"{margin}{fact.label}: {figure(fact)}" for fact in item.evidence)


def record(findings: Sequence[Finding]) -> dict[str, object]:
    """Findings as plain data, in the paper's order."""
    return {
        "source": SOURCE,
        "verdicts": counts(findings),
        "findings": [
            {
                "number": item.number,
                "title": item.title,
                "verdict": item.verdict.value,
                "summary": item.summary,
                "printed": list(item.printed),
                "printed_latex": [" ".join(latex(line)) for line in item.printed],
                "corrected": list(item.corrected),
                "corrected_latex": [" ".join(latex(line)) for line in item.corrected],
                "derived": list(item.derived),
                "reading": item.reading or None,
                "evidence": [
                    {"label": fact.label, "value": fact.value, "unit": fact.unit or None}
                    for fact in item.evidence
                ],
            }
            for item in findings
        ],
    }


def markdown_report(findings: Sequence[Finding]) -> str:
    """Findings as Markdown with formulas, which the documentation shows."""
    lines = [
        "# The paper, equation by equation",
        "",
        f"{SOURCE}.",
        "",
        "Each display is checked against what follows from the paper's own model: by expanding differences "
        "to zero, by writing remainders as sums of squares, and by running the closed loop with the "
        "generated kernels. Every verdict and every number "
        f"below is computed; `{COMMAND}` computes them again.",
        "",
        f"**{tally(findings)}.**",
        "",
    ]
    for heading, members in groups(findings):
        lines += [f"## {heading}", "", "| | | |", "|---|---|---|"]
        lines += [f"| **{item.number}** | {item.title} | {_prose(item.summary)} |" for item in members]
        lines.append("")
    lines += ["## Every display, in the paper's order", ""]
    for item in findings:
        lines += [*_section(item), ""]
    return "\n".join(lines).rstrip() + "\n"


def _section(item: Finding) -> Iterator[str]:
    yield from (f"### {item.number}: {item.title} ({item.verdict})", "")
    if item.printed:
        yield from ("Printed:", "", *_formulas(item.printed))
    yield f"{_sentence(item.summary)}."
    if item.corrected:
        yield from ("", "It should be:", "", *_formulas(item.corrected)[:-1])
    if item.reading:
        yield from ("", f"*Reading: {_prose(item.reading)}.*")
    if item.derived:
        yield from ("", "Derived:", "", "```python", *item.derived, "```")
    if item.evidence:
        yield ""
        yield from (f"- {_prose(fact.label)}: {_value(fact)}" for fact in item.evidence)


def _sentence(text: str) -> str:
    """A summary as a sentence; a symbol at its beginning stays as it is."""
    word = text.split()[0].rstrip(",;:")
    return _prose(text[:1].upper() + text[1:] if word.isalpha() and (len(word) > 1 or word == "a") else text)


def _formulas(lines: Sequence[str]) -> list[str]:
    """One block of mathematics and an empty line; only short chains stay on one line."""
    rows = [_row(*latex(line)) for line in lines]
    ended = [f"{row} \\\\" for row in rows[:-1]]
    return ["```math", r"\begin{aligned}", *ended, *rows[-1:], r"\end{aligned}", "```", ""]


def _row(first: str, *rest: str) -> str:
    short = sum(len(part) for part in rest) < _SHORT_FORMULA
    return f"{first} &" + (" " if short else " \\\\\n&").join(rest)


def _value(fact: Evidence) -> str:
    text = figure(fact)
    plain = not isinstance(fact.value, str) or text.replace(" ", "").isalpha()
    return text if plain else f"`{text}`"


def _prose(text: str) -> str:
    """Text in Markdown: what would be emphasis or a table's border is not."""
    return text.replace("_", r"\_").replace("*", r"\*").replace("|", r"\|")
