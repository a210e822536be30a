"""HTML as text: elements, tables, prose with its symbols set as mathematics.

Functions that take prose escape it; what they return is HTML and goes into `tag` as it is.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from html import escape

from pmjoint_codegen.report.mathml import inline_symbol
from pmjoint_codegen.report.notation import prose_words


def tag(name: str, *children: str, **attributes: str) -> str:
    """An element with HTML inside; ``class_`` and ``data_x`` stand for ``class`` and ``data-x``."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items()
    )
    return f"<{name}{given}>{''.join(children)}</{name}>"


def plain(text: str) -> str:
    """Any text, escaped."""
    return escape(text, quote=False)


def code(text: str) -> str:
    """A name as in a file or on the command line."""
    return tag("code", plain(text))


def paragraph(*html: str) -> str:
    """A paragraph of HTML."""
    return tag("p", *html)


def items(rows: Iterable[str]) -> str:
    """A list of HTML."""
    return tag("ul", *(tag("li", row) for row in rows))


def prose(text: str) -> str:
    """A remark with its symbols set as mathematics and the powers of its units raised."""
    write = {"text": plain, "unit": unit, "symbol": _symbol}
    shown, before = [], ""
    for kind, piece in prose_words(text):
        owned = before.endswith("'") and piece == "s"  # a genitive, not the variable of a transfer function
        shown.append(plain(piece) if owned else write[kind](piece))
        before = piece
    return "".join(shown)


def unit(text: str) -> str:
    """A unit such as ``rad/(s^2 V)`` with its powers raised."""
    pieces = re.split(r"\^(-?\d+)", text)
    return "".join(tag("sup", plain(piece)) if i % 2 else plain(piece) for i, piece in enumerate(pieces))


def _symbol(word: str) -> str:
    name, _, power = word.partition("^")
    return inline_symbol(name, power)


def number(value: float | None, digits: int = 6) -> str:
    """A number for a table: minus signs and powers of ten as such."""
    if value is None:
        return "none"
    text = f"{value:.{digits}g}"
    found = re.fullmatch(r"(-?)([\d.]+)e([-+]?\d+)", text)
    if found is None:
        return text.replace("-", "−").replace("inf", "∞")
    lead = "" if found[2] == "1" else f"{found[2]}·"
    return f"{found[1].replace('-', '−')}{lead}10{tag('sup', str(int(found[3])).replace('-', '−'))}"


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str = "", right: Sequence[int] = ()
) -> str:
    """A table of HTML cells, in a frame that scrolls where the page is narrow.

    Args:
        head: of the columns.
        rows: the first cell of each names its row.
        caption: one line of HTML.
        right: columns of numbers.
    """
    sides = [{"class_": "number"} if i in right else {} for i in range(len(head))]
    top = tag("tr", *(tag("th", cell, scope="col", **side) for cell, side in zip(head, sides, strict=True)))
    body = "".join(
        tag(
            "tr",
            tag("th", row[0], scope="row"),
            *(tag("td", cell, **side) for cell, side in zip(row[1:], sides[1:], strict=True)),
        )
        for row in rows
    )
    title = tag("caption", caption) if caption else ""
    inside = tag("table", title, tag("thead", top), tag("tbody", body))
    return framed(inside, re.sub("<[^>]*>", "", caption) or f"table of {re.sub('<[^>]*>', '', head[0])}")


def framed(html: str, label: str) -> str:
    """A block that scrolls sideways, by keyboard too, where the page is narrow."""
    return tag("div", html, class_="frame", tabindex="0", role="region", aria_label=label)


def listing(text: str, label: str) -> str:
    """A file or a part of one, as it is."""
    return tag("div", tag("pre", code(text)), class_="frame", tabindex="0", role="region", aria_label=label)


def picture(svg: bytes, alt: str, caption: str = "", *, kind: str = "wide") -> str:
    """A figure whose data are in the page, with a text for those who do not see it."""
    data = base64.b64encode(svg).decode("ascii")
    image = f'<img src="data:image/svg+xml;base64,{data}" alt="{escape(alt)}">'
    return tag("figure", image, tag("figcaption", caption) if caption else "", class_=kind)


def absent(reason: str) -> str:
    """Why something is not here."""
    return tag("p", tag("strong", "Not here: "), plain(reason), class_="absent")


def chapter(key: str, title: str, *html: str) -> str:
    """A chapter with its heading."""
    return tag("section", tag("h2", plain(title), id=key), *html, aria_labelledby=key)
