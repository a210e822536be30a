"""The page of one model: its head, a table of contents, the chapters."""

from __future__ import annotations

import re
from collections.abc import Iterable
from html import unescape
from pathlib import Path

from pmjoint_codegen import __version__
from pmjoint_codegen.dossier.chapters.checks import checks_chapter
from pmjoint_codegen.dossier.chapters.derivation import derivation_chapter
from pmjoint_codegen.dossier.chapters.generated import generated_chapter
from pmjoint_codegen.dossier.chapters.limits import limits_chapter
from pmjoint_codegen.dossier.chapters.model import model_chapter
from pmjoint_codegen.dossier.chapters.proof import proof_chapter
from pmjoint_codegen.dossier.chapters.runs import margins_chapter, region_chapter, run_chapter
from pmjoint_codegen.dossier.facts import Facts
from pmjoint_codegen.dossier.markup import code, number, plain, tag

STYLE = Path(__file__).parent / "web" / "style.css"
CHAPTERS = (
    model_chapter,
    derivation_chapter,
    proof_chapter,
    checks_chapter,
    generated_chapter,
    run_chapter,
    region_chapter,
    margins_chapter,
    limits_chapter,
)


def model_page(facts: Facts) -> str:
    """The report of one model as an HTML document; the same facts give the same bytes."""
    chapters = [write(facts) for write in CHAPTERS]
    title = facts.manifest.title or facts.manifest.name
    return document(f"{title}: report", tag("h1", plain(title)) + _head(facts), chapters)


def document(title: str, head: str, chapters: Iterable[str]) -> str:
    """A whole document: no script, and nothing from a network.

    Args:
        title: of the window.
        head: HTML before the table of contents.
        chapters: HTML with headings that have an ``id``.
    """
    body = "\n".join(chapters)
    version = f"Written by pmjoint report, version {__version__}. The page needs no network and no script."
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            tag("title", plain(title)),
            tag("style", STYLE.read_text(encoding="utf-8")),
            "</head>",
            "<body>",
            tag("header", head),
            contents(body),
            tag("main", body),
            tag("footer", plain(version)),
            "</body>",
            "</html>",
            "",
        ]
    )


def contents(body: str) -> str:
    """A table of contents from the headings."""
    found = re.findall(r'<h([23]) id="([^"]+)">(.*?)</h\1>', body)
    groups: list[tuple[str, list[str]]] = []
    for level, key, words in found:
        link = tag("a", plain(unescape(re.sub("<[^>]*>", "", words))), href=f"#{key}")
        if level == "2":
            groups.append((link, []))
        elif groups:
            groups[-1][1].append(link)
    rows = (
        tag("li", link, tag("ul", *(tag("li", item) for item in inner)) if inner else "")
        for link, inner in groups
    )
    return tag("nav", tag("h2", "Contents", id="contents"), tag("ol", *rows), aria_labelledby="contents")


def _head(facts: Facts) -> str:
    manifest, checks = facts.manifest, facts.checks
    versions = ", ".join(f"{name} {version}" for name, version in manifest.versions.items())
    told = f"{len(checks.passed)} passed, {len(checks.failed)} failed, {len(checks.open)} not run"
    rows = {
        "Model": code(facts.called),
        "Model hash": code(manifest.model_hash),
        "Made with": plain(versions),
        "Gates": tag("span", plain(told), class_="failed" if checks.failed else "passed"),
        "Proof": _proved(facts),
    }
    return definitions(rows)


def definitions(rows: dict[str, str]) -> str:
    """A list of terms and their HTML."""
    return tag(
        "dl", *(tag("dt", plain(key)) + tag("dd", value) for key, value in rows.items()), class_="facts"
    )


def _proved(facts: Facts) -> str:
    count, broken = len(facts.identities), sum(not item.holds for item in facts.identities)
    if broken:
        return tag("span", f"{broken} of {count} identities do not hold", class_="failed")
    rate = getattr(facts.certificate, "f", None)
    return f"all {count} identities hold" + (f"; V decays at {number(rate, 4)} 1/s" if rate else "")
