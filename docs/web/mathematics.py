"""Formulas as MathML, which browsers draw without a script: $`...`$ in a line, a block fenced as ``math``.

GitHub and GitLab draw both. This is a Markdown extension, which mkdocs.yml names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

if TYPE_CHECKING:
    import re

_INLINE = r"\$`([^`]+)`\$"
_BEFORE_CODE = 195  # priority: backticks are taken at 190


def mathml(latex: str, display: str) -> str:
    """Convert one formula.

    Args:
        latex: the formula, without delimiters.
        display: ``"inline"`` or ``"block"``.
    """
    known = latex.replace("{aligned}", "{align*}")  # the same rows, under the name that the converter knows
    return convert(known.strip(), display=display)


def block(source: str, language: str, css_class: str, options: Any, md: Markdown, **_rest: Any) -> str:
    """Draw a fenced block; the signature is that of ``pymdownx.superfences``."""
    return f'<div class="{css_class}" tabindex="0">{mathml(source, "block")}</div>'


class _Formula(InlineProcessor):  # type: ignore[misc] # the library has no types
    """A formula within a line."""

    def handleMatch(self, m: re.Match[str], data: str) -> tuple[str, int, int]:  # noqa: N802 # the library's name
        """Put the formula where Markdown leaves it alone."""
        return self.md.htmlStash.store(mathml(m[1], "inline")), m.start(0), m.end(0)


class Mathematics(Extension):  # type: ignore[misc] # the library has no types
    """Adds formulas within lines; blocks are a fence, set in mkdocs.yml."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 # the library's name
        """Register the pattern."""
        md.inlinePatterns.register(_Formula(_INLINE, md), "formula", _BEFORE_CODE)


def makeExtension(**settings: Any) -> Mathematics:  # noqa: N802 # the library's name
    """Make the extension: what Markdown asks a module for."""
    return Mathematics(**settings)
