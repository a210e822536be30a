"""A derivation as Markdown with mathematics that GitHub and GitLab render, made to be read as a diff.

Each formula follows the name that ``pmjoint diff`` and the generated code use. A long one has a line for each
term, so a changed term is a changed line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from pmjoint_codegen.report.latex import gains, scope, section_note
from pmjoint_codegen.report.notation import latex_name, prose_pieces
from pmjoint_codegen.report.rows import equation_rows
from pmjoint_codegen.report.sections import by_section
from pmjoint_codegen.values import from_si
from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model


def markdown_report(model: Model, equations: Iterable[Equation], head: Sequence[str] = ()) -> str:
    """Print a derivation as one page.

    Args:
        model: what was derived from.
        equations: the derivation, in its order.
        head: lines of a comment that precedes the page: what made it, and from what.

    Returns:
        the page, without a newline at the end.
    """
    lines = [f"<!-- {_commented(line)} -->" for line in head] + [""] * bool(head)
    lines += [f"# {_plain(model.title) or model.name}", ""]
    lines += [_prose(model.source), ""] if model.source else []
    lines += [_inline(scope(model)), "", "## Parameters", "", *_parameters(model), "", _inline(gains(model))]
    for section, members in by_section(equations):
        lines += ["", f"## {section}"]
        lines += [text for note in section_note(section, model, members) for text in ("", _inline(note))]
        for equation in members:
            lines += ["", *_display(equation)]
    return "\n".join(lines)


def _parameters(model: Model) -> Iterator[str]:
    yield "| name | symbol | value | unit | meaning |"
    yield "|---|---|---|---|---|"
    for item in model.parameters:
        value = from_si(item.value, item.scale)
        cells = (f"`{item.name}`", _math(latex_name(item.name)), repr(value), _plain(item.unit))
        yield f"| {' | '.join(cells)} | {_prose(item.about)} |"


def _display(equation: Equation) -> Iterator[str]:
    """Give an equation's name, number, meaning and unit, then its formula.

    A fence keeps Markdown away from backslashes and underscores, which it takes out of dollar signs.
    """
    unit = "" if equation.unit is None or str(equation.unit) == "1" else f" [{_plain(str(equation.unit))}]"
    number = f" {equation.number}" if equation.number else ""
    yield f"`{equation.name}`{number}: {_prose(equation.meaning)}{unit}"
    yield from ("", "```math", *equation_rows(equation, fill=False), "```")


def _prose(text: str) -> str:
    """Write a remark as Markdown, with its symbols set as mathematics."""
    pieces = prose_pieces(" ".join(text.split()))
    return "".join(_math(piece) if kind == "symbol" else _plain(piece) for kind, piece in pieces)


def _inline(text: str) -> str:
    """Turn the mathematics in a sentence of LaTeX into Markdown's."""
    return re.sub(r"\$([^$]+)\$", lambda found: _math(found[1]), text)


def _math(latex: str) -> str:
    return f"$`{latex}`$"


def _plain(text: str) -> str:
    """Escape what Markdown and HTML would read as markup."""
    return re.sub(r"([\\`*_\[\]<>|#$&~])", r"\\\1", text)


def _commented(text: str) -> str:
    """Break up the hyphens that would end a comment."""
    return re.sub(r"-(?=-|>)", "- ", text)
