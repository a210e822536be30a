"""The audit's three forms, and the committed one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from pmjoint_codegen.audit.findings import Evidence, Finding
from pmjoint_codegen.audit.judgement import Verdict
from pmjoint_codegen.audit.report import COMMAND, figure, groups, markdown_report, record, table_report

WRONG = Finding(
    "(2)", "second", Verdict.FAILS, "a|b fails", ("a_1 = b",), evidence=(Evidence("by", 0.5, "s"),)
)
RIGHT = Finding("(1)", "first", Verdict.FOLLOWS, "follows", ("a_1 = a_1",))


def test_documentation_is_current(root: Path, findings: Mapping[str, Finding]) -> None:
    committed = (root / "docs" / "audit.md").read_text(encoding="utf-8")
    assert committed == markdown_report(list(findings.values())), f"docs/audit.md is stale: {COMMAND}"


def test_what_is_right_comes_first() -> None:
    assert [heading for heading, _ in groups([WRONG, RIGHT])] == [
        "What the paper gets right",
        "What does not follow",
    ]
    table = table_report([WRONG, RIGHT])
    assert table.index("(1)") < table.index("(2)")
    assert "by: 0.5 s" in table


def test_the_record_is_json_in_the_papers_order(findings: Mapping[str, Finding]) -> None:
    read = json.loads(json.dumps(record(list(findings.values())), allow_nan=False))
    assert [item["number"] for item in read["findings"]] == list(findings)
    assert sum(read["verdicts"].values()) == len(findings)
    law = next(item for item in read["findings"] if item["number"] == "(29)")
    assert law["printed_latex"][0].startswith("v = -b_{0} z_{1} - C_{2} z_{2}")


def test_markdown_cannot_break_its_tables() -> None:
    text = markdown_report([WRONG])
    assert r"a\|b" in text
    assert "a_{1} &= b" in text
    assert "\n\n\n" not in text


def test_figures_have_units() -> None:
    assert figure(Evidence("", 1 / 3, "rad")) == "0.3333333 rad"
    assert figure(Evidence("", "k_0")) == "k_0"


def test_verdicts_are_sentences_but_a_symbol_at_the_beginning_stays() -> None:
    for summary, shown in (
        ("follows; by squares", "Follows; by squares."),
        ("a static muscle", "A static muscle."),
        ("d holds the damping", "d holds the damping."),
    ):
        assert f"\n{shown}\n" in markdown_report(
            [Finding("(1)", "first", Verdict.FOLLOWS, summary, ("a_1 = a_1",))]
        )
