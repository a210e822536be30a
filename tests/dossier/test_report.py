"""The report of a model: what it says is the model's, it stands alone, and no stale result gets into it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pmjoint_codegen.check.junit import junit, read_junit
from pmjoint_codegen.check.result import passed
from pmjoint_codegen.dossier.browser import QUIET, find_browser, undated
from pmjoint_codegen.dossier.chapters.checks import margin
from pmjoint_codegen.dossier.chapters.model import remarks
from pmjoint_codegen.dossier.compare import comparison_page
from pmjoint_codegen.dossier.facts import Absent, Facts, gather
from pmjoint_codegen.dossier.gates import FILE, QUICK, checked
from pmjoint_codegen.dossier.markup import number, prose
from pmjoint_codegen.dossier.page import model_page
from pmjoint_codegen.errors import MissingToolError, UsageError
from pmjoint_codegen.simulate.run import Run
from pmjoint_derive.progress import unwatched

BROWSER = shutil.which("chromium")
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Collects anchors and links, and every element that is closed out of turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.faults: list[str] = []
        self.anchors: list[str] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.alts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attrs}
        if tag not in VOID:
            self.open.append(tag)
        self.anchors += [given["id"]] if "id" in given else []
        self.links += [given["href"]] if "href" in given else []
        self.sources += [given["src"]] if "src" in given else []
        self.alts += [given.get("alt", "")] if tag == "img" else []

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)


@pytest.fixture(scope="module")
def facts() -> Facts:
    return gather("paper", environment=os.environ, notify=lambda line: None)


@pytest.fixture(scope="module")
def html(facts: Facts) -> str:
    return model_page(facts)


def test_the_page_is_well_formed_and_stands_alone(facts: Facts, html: str) -> None:
    page = Page()
    page.feed(html)
    assert not page.faults and not page.open
    assert len(page.anchors) == len(set(page.anchors))
    assert page.links and all(link[1:] in page.anchors for link in page.links)
    assert page.sources and all(source.startswith("data:") for source in page.sources)
    assert all(len(alt) > 30 for alt in page.alts)
    assert "<script" not in html and "http" not in re.sub(r'"data:[^"]*"', "", html)
    assert model_page(facts) == html


def test_every_equation_is_there_as_mathematics(facts: Facts, html: str) -> None:
    anchors = re.findall(r'id="eq-([^"]+)"', html)
    assert sorted(anchors) == sorted(item.name for item in facts.equations)
    found = re.findall(r"<math .*?</math>", html)
    assert len(found) > len(facts.equations)
    for text in found:
        ElementTree.fromstring(text)
    law = re.search(r'id="eq-v">.*?</math>', html, re.DOTALL)
    assert law is not None and "<mfrac>" in law[0] and "∂" in law[0]


def test_its_numbers_are_those_of_the_run(facts: Facts, html: str) -> None:
    assert isinstance(facts.run, Run) and not isinstance(facts.sampled, Absent)
    for key in ("ise", "max_abs_e", "settling_s", "max_abs_v"):
        assert f">{number(facts.run.summary[key])} " in html
    assert not isinstance(facts.certificate, Absent) and number(facts.certificate.f, 4) in html


def test_gates_that_were_not_run_are_said_to_be_so(facts: Facts, html: str) -> None:
    assert {row.gate.name for row in facts.checks.passed} == set(QUICK)
    assert {row.gate.name for row in facts.checks.open}.isdisjoint(QUICK)
    assert "not run" in html and "pmjoint check paper --junit" in html


def test_results_of_a_file_count_only_for_the_same_model(facts: Facts, tmp_path: Path) -> None:
    subject, file = facts.subject, tmp_path / "check.xml"
    result = replace(passed("largest error/bound", 0.5, 1), name="symbolic")
    for fingerprint, taken in ((subject.fingerprint, True), ("of yesterday", False)):
        file.write_text(junit({"paper": [result]}, {"paper": fingerprint}))
        found = checked(subject, recorded=file, full=False, stage=unwatched)
        row = next(row for row in found.rows if row.gate.name == "symbolic")
        assert (row.verdict == "passed", row.origin == FILE, not found.refused) == (taken,) * 3


def test_a_file_that_is_none_is_refused(facts: Facts, tmp_path: Path) -> None:
    file = tmp_path / "check.xml"
    file.write_text("<testsuites name='other'/>")
    with pytest.raises(UsageError, match=r"pmjoint check .*--junit"):
        checked(facts.subject, recorded=file, full=False, stage=unwatched)


def test_a_figure_beyond_its_bound_fails_whatever_the_file_calls_it() -> None:
    text = junit({"paper": [replace(passed("error", 0.5, 1), name="symbolic")]}, {"paper": "f"})
    (good,) = read_junit(text)["paper"].results
    (bad,) = read_junit(text.replace('value="0.5"', 'value="1.5"'))["paper"].results
    assert (good.verdict, margin(good)) == ("passed", "50 %")
    assert (bad.verdict, margin(bad)) == ("failed", "exceeded by 50 %")


def test_remarks_and_prose() -> None:
    assert list(remarks("a = 1 # m\nb = 2 # chosen")) == [(2, "b = 2 # chosen")]
    assert "<msub>" in prose("decay of z1") and "</math>" not in prose("the paper's")


def test_a_pdf_without_dates_keeps_its_length() -> None:
    data = b"<< /CreationDate (D:20240102030405+00'00') >>"
    assert len(undated(data)) == len(data) and b"1970" in undated(data)


def test_no_browser_is_said_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(MissingToolError, match="chromium"):
        find_browser({"PATH": str(tmp_path)})


@pytest.mark.skipif(BROWSER is None, reason="chromium is not installed")
def test_a_phone_shows_it_without_a_sideways_scroll(html: str, tmp_path: Path) -> None:
    probe = (
        "<script>addEventListener('load', () => document.documentElement.setAttribute('data-wide',"
        "document.getElementById('phone').contentDocument.documentElement.scrollWidth))</script>"
    )
    (tmp_path / "page.html").write_text(html)
    frame = '<iframe id="phone" src="page.html" width="390" height="800" style="border:0"></iframe>'
    (tmp_path / "probe.html").write_text(f"<!DOCTYPE html>{probe}{frame}")
    assert BROWSER is not None
    flags = [*QUIET, "--no-sandbox", "--allow-file-access-from-files", "--dump-dom"]
    flags.append(f"--user-data-dir={tmp_path / 'profile'}")
    address = (tmp_path / "probe.html").as_uri()
    done = subprocess.run([BROWSER, *flags, address], capture_output=True, text=True, timeout=120, check=True)
    wide = re.search(r'data-wide="(\d+)"', done.stdout)
    assert wide is not None and int(wide[1]) <= 390


def test_a_model_beside_itself_does_not_differ(facts: Facts) -> None:
    page = Page()
    text = comparison_page(facts, facts)
    page.feed(text)
    assert not page.faults and all(link[1:] in page.anchors for link in page.links)
    assert text.count("All are the same.") == 4
