"""What the model is, where its numbers come from, and what is assumed."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pmjoint_codegen.dossier.facts import Absent, Facts
from pmjoint_codegen.dossier.markup import (
    absent,
    chapter,
    code,
    items,
    listing,
    number,
    paragraph,
    plain,
    prose,
    table,
    tag,
    unit,
)
from pmjoint_codegen.report.mathml import inline_symbol
from pmjoint_codegen.simulate.assumptions import assumed
from pmjoint_codegen.values import from_si


def model_chapter(facts: Facts) -> str:
    """Class, parameters with their provenance, gains, assumptions, the model file."""
    plant = facts.derivation.plant
    words = (
        f"Order {inline_symbol('n')} = {plant.order}, zeros {inline_symbol('m')} = {plant.m}, relative "
        f"degree {inline_symbol('rho')} = {plant.rho}. The output {inline_symbol('y')} is measured, "
        f"the input is limited by {code(facts.manifest.limit)}."
    )
    return chapter(
        "model",
        "Model and sources",
        paragraph(words),
        tag("p", tag("strong", "Source: "), plain(facts.manifest.source or "none is stated")),
        tag("h3", "Parameters", id="parameters"),
        _parameters(facts),
        tag("h3", "Gains", id="gains"),
        _gains(facts),
        tag("h3", "Assumed", id="assumed"),
        items(assumptions(facts)),
        tag("h3", "The model file", id="model-file"),
        listing(facts.text, "the model file") if facts.text else absent("the model came from a pipe"),
    )


def _parameters(facts: Facts) -> str:
    rows = [
        (
            code(item.name),
            inline_symbol(item.name),
            number(from_si(item.value, item.scale), 12),
            unit(item.unit) if item.unit not in ("", "1") else "",
            prose(item.about),
        )
        for item in facts.subject.model.parameters
    ]
    head = ("name", "symbol", "value", "unit", "meaning, and where the value comes from")
    return table(head, rows, right=(2,))


def _gains(facts: Facts) -> str:
    kinds = {"gain", "switch"}
    rows = [
        (
            code(item.name),
            inline_symbol(item.name),
            number(from_si(item.value, item.scale), 12),
            unit(item.unit) if item.unit not in ("", "1") else "",
            prose(item.about),
        )
        for item in facts.manifest.settable
        if item.kind in kinds or item.name not in {p.name for p in facts.subject.model.parameters}
    ]
    return table(("name", "symbol", "value", "unit", "meaning"), rows, right=(2,))


def assumptions(facts: Facts) -> Iterator[str]:
    """What the results rest on and no source states, one HTML line each."""
    if not isinstance(facts.run, Absent):
        for item in assumed(facts.run):
            yield f"{plain(item)}: the source does not state it."
    for line, remark in remarks(facts.text):
        yield f"Line {line} of the model file: {plain(remark)}"
    bound = facts.manifest.disturbance_bound
    if bound is None:
        yield "No bound of the disturbance is stated, so the proof gives no ultimate bound of the error."
    else:
        yield f"The disturbance stays below {inline_symbol('D_max')} = {number(bound)}."
    yield from _known(facts)
    yield "The controller measures the output, and the applied input or knows its limit."
    start = facts.manifest.simulation.start
    yield f"The filters start {'at zero' if start == 'zero' else 'matched to the measured output'}."


def _known(facts: Facts) -> Iterator[str]:
    """What the controller knows of the plant, and what it guesses or estimates."""
    adaptation = facts.subject.model.adaptation
    if adaptation is None:
        yield "The controller knows its parameters. The plant of the default run has the same values."
        return
    for entry in adaptation.entries:
        start = f"{number(entry.guess)}{unit_words(entry.unit)}"
        how = f"estimates it from {start} on" if entry.unknown else f"takes it to be {start}, for good"
        yield f"The controller does not know {inline_symbol(entry.name)}: it {how}."
    yield (
        "The controller knows the other parameters. The plant of the default run has the values of the model "
        "file."
    )


def unit_words(text: str) -> str:
    """A unit after a number, or nothing."""
    return f" {unit(text)}" if text not in ("", "1") else ""


def remarks(text: str) -> Iterator[tuple[int, str]]:
    """Lines of a model file whose comment or description says that something was assumed or chosen."""
    for place, line in enumerate(text.splitlines(), start=1):
        if re.search(r"\b(assumed|chosen|guess(ed)?|estimated|not stated|does not state)\b", line, re.I):
            yield place, " ".join(line.strip().lstrip("# ").split())
