"""The derivation with rendered mathematics."""

from __future__ import annotations

from pmjoint_codegen.dossier.facts import CERTIFICATE, Facts
from pmjoint_codegen.dossier.markup import chapter, code, items, paragraph, plain, prose, tag, unit
from pmjoint_codegen.report.mathml import displayed, inline_symbol
from pmjoint_codegen.report.notation import text_expression
from pmjoint_codegen.report.sections import by_section, own_parameters
from pmjoint_derive.equation import Equation
from pmjoint_derive.true_plant import SECTION as TRUE_PLANT


def derivation_chapter(facts: Facts) -> str:
    """Every named equation except those of the certificate, section by section."""
    parts = []
    for name, members in sections(facts):
        parts.append(tag("h3", plain(name), id=section_id(name)))
        if name == TRUE_PLANT:
            parts.append(_own(facts, members))
        parts += [equation_html(item) for item in members]
    words = (
        "Each equation has its name in the generated code, its meaning and its unit. A number on the right "
        "is the equation of the paper; an equation without a number is a step of the derivation."
    )
    return chapter("derivation", "Derivation", paragraph(words), *parts)


def sections(facts: Facts) -> list[tuple[str, list[Equation]]]:
    """Sections of this chapter; the certificate is part of the proof."""
    return [(name, members) for name, members in by_section(facts.equations) if name != CERTIFICATE]


def section_id(name: str) -> str:
    """Anchor of a section."""
    return "section-" + "-".join(name.lower().split())


def equation_html(item: Equation) -> str:
    """One equation: what it is, and the formula with its number."""
    text = text_expression(item.expression)
    measured = "" if item.unit is None or str(item.unit) == "1" else f" [{unit(str(item.unit))}]"
    about = tag("p", code(item.name), " ", prose(item.meaning), measured, class_="about")
    number = tag("span", plain(item.number), class_="eqno") if item.number else ""
    shown = tag(
        "div", displayed(item.name, text), class_="math", tabindex="0", role="group", aria_label=item.name
    )
    return tag(
        "div", about, tag("div", shown, number, class_="formula"), class_="equation", id=f"eq-{item.name}"
    )


def _own(facts: Facts, members: list[Equation]) -> str:
    pairs = own_parameters(facts.subject.model, members).items()
    same = [f"{inline_symbol(own)} = {inline_symbol(name)}" for own, name in pairs]
    if not same:
        return ""
    return paragraph("Where no other value is set, the plant has what the controller believes:") + items(same)
