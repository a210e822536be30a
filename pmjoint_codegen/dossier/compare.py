"""Two models side by side: what differs in values, equations and sizes, their runs and margins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pmjoint_codegen.dossier.chapters.runs import margins_table, summary_table
from pmjoint_codegen.dossier.facts import Absent, Facts
from pmjoint_codegen.dossier.markup import chapter, code, paragraph, picture, plain, table, tag
from pmjoint_codegen.dossier.page import definitions, document
from pmjoint_codegen.emit.changes import Change, Content, changes, content_of
from pmjoint_codegen.report.mathml import displayed
from pmjoint_codegen.simulate.compare import compare
from pmjoint_codegen.simulate.figures import look_of
from pmjoint_codegen.simulate.page import page_of
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.style import rendered


def comparison_page(before: Facts, after: Facts) -> str:
    """The report of two models as an HTML document."""
    names = before.called, after.called
    old, new = _content(before), _content(after)
    heads = ("name", *map(plain, names))
    title = f"{names[0]} and {names[1]}"
    rows = {
        name: f"{plain(facts.manifest.title)}, {code(facts.manifest.model_hash[:16])}"
        + (f"; {plain(facts.origin)}" if facts.origin else "")
        for name, facts in zip(names, (before, after), strict=True)
    }
    chapters = [
        chapter("values", "Values", _changed(heads, changes(old.values, new.values))),
        chapter("equations", "Equations", *_equations(changes(old.equations, new.equations), names)),
        chapter("operations", "Operations", _changed(heads, changes(old.operations, new.operations))),
        chapter("sizes", "Bytes of the files", _changed(heads, changes(old.sizes, new.sizes))),
        chapter(
            "runs",
            "Default runs",
            summary_table([(plain(names[0]), before.run), (plain(names[1]), after.run)]),
            _overlay(names, before.run, after.run),
        ),
        chapter("margins", "Margins", margins_table([(plain(names[0]), before), (plain(names[1]), after)])),
    ]
    return document(f"{title}: report", tag("h1", plain(title)) + definitions(rows), chapters)


def _content(facts: Facts) -> Content:
    folder = facts.provided.folder
    return content_of({path.name: path.read_bytes() for path in sorted(folder.glob("*.*"))})


def _changed(heads: tuple[str, ...], found: Iterable[Change]) -> str:
    rows = [(code(item.name), _value(item.before), _value(item.after)) for item in found]
    return table(heads, rows) if rows else paragraph("All are the same.")


def _value(value: object) -> str:
    return tag("span", "none", class_="same") if value is None else plain(str(value))


def _equations(found: Iterable[Change], names: tuple[str, str]) -> Iterator[str]:
    """Each equation that differs, as in either model."""
    some = False
    for item in found:
        some = True
        yield tag("p", code(item.name), class_="about")
        for name, text, kind in ((names[0], item.before, "removed"), (names[1], item.after, "added")):
            if text is not None:
                shown = tag("div", displayed(item.name, str(text)), class_="math", tabindex="0")
                yield tag("p", tag("span", plain(name), class_=kind), class_="about") + shown
    if not some:
        yield paragraph("All are the same.")


def _overlay(names: tuple[str, str], before: Run | Absent, after: Run | Absent) -> str:
    """Output, error and input of both runs, over each other."""
    if isinstance(before, Absent) or isinstance(after, Absent):
        return paragraph("One of the runs failed, so there is no figure.")
    page = page_of(caption=False)
    figure = compare(before, after, names=names).plot(("y", "e", "u"), page=page)
    alt = f"output, error and input over time, {names[0]} as a solid and {names[1]} as a dashed line"
    return picture(
        rendered(figure, look_of(page), "svg"), alt, plain(f"Solid: {names[0]}. Dashed: {names[1]}.")
    )
