"""Numbers in the prose of docs/ are what their commands give."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

from benchmarks.report import Section

pytest.importorskip("xarray")

DOCS = Path(__file__).resolve().parent.parent.parent / "docs"


@pytest.fixture(scope="module")
def stated() -> dict[str, Any]:
    """Return the names of docs/stated.py, which is a script's and of no package."""
    return runpy.run_path(str(DOCS / "stated.py"))


def test_every_marked_number_is_the_computed_one(stated: dict[str, Any]) -> None:
    pages = [(DOCS / page).read_text(encoding="utf-8") for page in stated["PAGES"]]
    found = {name: text for page in pages for name, text in stated["stated"](page).items()}
    assert found == stated["computed"]()


def test_every_page_with_marks_is_filled(stated: dict[str, Any]) -> None:
    marked = {path.name for path in DOCS.rglob("*.md") if stated["stated"](path.read_text(encoding="utf-8"))}
    assert marked == set(stated["PAGES"])


def test_filling_changes_the_number_and_nothing_else(stated: dict[str, Any]) -> None:
    page = "It holds <!-- a.b -->77 %<!-- / --> of 9 states."
    assert stated["filled"](page, {"a.b": "82.8 %"}) == page.replace("77", "82.8")
    with pytest.raises(KeyError):
        stated["filled"](page, {"a.c": "1"})


def test_every_benchmark_names_its_processor() -> None:
    _, *sections = (DOCS / "benchmarks.md").read_text(encoding="utf-8").split("\n## ")
    assert [text.partition("\n")[0] for text in sections if " Processor: " not in text] == ["Promises missed"]
    section = Section("Title", "About.", lines=[("",) * 6]).markdown("Abacus, beads")
    assert "\nAbout. Processor: Abacus, beads.\n" in section
