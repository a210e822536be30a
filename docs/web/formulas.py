"""Formulas in plain text, as pages are read on GitHub and in an editor: y_r, s^2, x_{i+1}.

The site lowers indices and raises powers: in a line by a Markdown extension, which mkdocs.yml names; in a
block fenced as ``formula``, whose letters become italic too. Columns of a block are three spaces apart.
"""

from __future__ import annotations

import html
import re
from typing import Any, Final
from xml.etree.ElementTree import Element

from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

_LETTER: Final = "[A-Za-zΑ-Ωα-ω]"
_INDEX: Final = r"\{[^{}\n]+\}|[A-Za-z0-9₋+∞]+(?:[,=][A-Za-z0-9])*"
_POWER: Final = r"\{[^{}\n]+\}|\((?:[^()\n]|\([^()\n]*\))*\)|[−-]?[A-Za-z0-9]+"
# In a line, the letter before an index stands alone: `y_r` is a symbol, `output_step` a name.
_LINE_INDEX: Final = rf"(?:(?<=(?<![\w.])[^\W\d_])|(?<=\u0307))_({_INDEX})(?![A-Za-z0-9_])"
_LINE_POWER: Final = rf"(?<=[\w)])\^({_POWER})"
_TOKEN: Final = re.compile(rf"_({_INDEX})|\^({_POWER})|({_LETTER}+)")
_AFTER_HTML: Final = 80  # priority: below tags (90), which are left alone, above emphasis (60)


def block(source: str, language: str, css_class: str, options: Any, md: Markdown, **_rest: Any) -> str:
    """Draw a fenced block; the signature is that of ``pymdownx.superfences``."""
    rows = [re.split(r" {3,}", line.strip()) for line in source.splitlines()]
    drawn = ("".join(f"<span>{marked(cell)}</span>" for cell in row) for row in rows)
    inside = "".join(f"<div>{row}</div>" for row in drawn)
    return f'<div class="{css_class}" tabindex="0">{inside}</div>'


def marked(text: str) -> str:
    """Mark up one formula as HTML."""
    parts, end = [], 0
    for match in _TOKEN.finditer(text):
        parts += [html.escape(text[end : match.start()]), _token(match)]
        end = match.end()
    return "".join([*parts, html.escape(text[end:])])


def _token(match: re.Match[str]) -> str:
    index, power, word = match.groups()
    if index is not None:
        return f"<sub>{marked(_bare(index))}</sub>"
    if power is not None:
        return f"<sup>{marked(_bare(power))}</sup>"
    return f"<i>{word}</i>" if len(word) == 1 else str(word)


def _bare(text: str) -> str:
    return text[1:-1] if text.startswith("{") else text


class _Moved(InlineProcessor):  # type: ignore[misc] # the library has no types
    """An index or a power in a line."""

    def __init__(self, pattern: str, tag: str, md: Markdown) -> None:
        super().__init__(pattern, md)
        self.tag = tag

    def handleMatch(self, m: re.Match[str], data: str) -> tuple[Element, int, int]:  # noqa: N802 # the library's name
        """Lower or raise it."""
        element = Element(self.tag)
        element.text = _bare(m[1])
        return element, m.start(0), m.end(0)


class Formulas(Extension):  # type: ignore[misc] # the library has no types
    """Lowers indices and raises powers within lines."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 # the library's name
        """Register both patterns."""
        md.inlinePatterns.register(_Moved(_LINE_INDEX, "sub", md), "index", _AFTER_HTML)
        md.inlinePatterns.register(_Moved(_LINE_POWER, "sup", md), "power", _AFTER_HTML - 1)


def makeExtension(**settings: Any) -> Formulas:  # noqa: N802 # the library's name
    """Make the extension: what Markdown asks a module for."""
    return Formulas(**settings)
