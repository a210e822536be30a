r"""How wide LaTeX sets a formula, estimated from the widths of its letters: what breaks lines needs no LaTeX.

The unit is the em of the text. A fraction is as wide as its wider half; a script is smaller, and one above
another takes the room of the wider.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

_DISPLAY, _TEXT, _SCRIPT, _SMALLEST = range(4)  # TeX's styles, each of whose letters has its size
_SIZE = (1.0, 1.0, 0.73, 0.55)
_SCRIPT_SPACE = 0.05
_BAR = 0.22  # by which a fraction exceeds its wider half
_DELIMITER = 0.65
_DELIMITED = (r"\left", r"\right", r"\Bigl", r"\Bigr", r"\Big")
_BINARY, _UNARY, _RELATION = 1.22, 0.78, 1.33
_UPRIGHT = 0.49
_NAMED = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log", "exp", "max", "min")
_SET: dict[str, float] = {
    **dict.fromkeys("ijlt", 0.37),
    **dict.fromkeys("mw", 0.8),
    **dict.fromkeys("()", 0.39),
    **dict.fromkeys("[]|!.", 0.28),
    ",": 0.44,
    **dict.fromkeys("&{}", 0.0),
    **dict.fromkeys(("=", r"\le", r"\ge", "<", ">"), _RELATION),
    **dict.fromkeys((r"\hat", r"\bar", r"\dot", r"\ddot", r"\overline", r"\underline", r"\\"), 0.0),
    **dict.fromkeys((r"\,", r"\;"), 0.2),
    **{rf"\{name}": _UPRIGHT * len(name) + 0.17 for name in _NAMED},
    r"\cdot": 0.72,
    r"\sqrt": 0.83,
}


def width(latex: str) -> float:
    """Estimate the width of displayed mathematics in em, to about a twentieth."""
    return _width(re.findall(r"\\[A-Za-z]+|\\.|\S", latex), _DISPLAY)


def _width(tokens: Sequence[str], style: int) -> float:
    total, script, place = 0.0, 0.0, 0
    opened = True  # where a sign is that of what follows
    while place < len(tokens):
        token, place = tokens[place], place + 1
        if token in ("_", "^"):
            inner, place = _argument(tokens, place)
            wide = _width(inner, max(style + 1, _SCRIPT) if style < _SMALLEST else style) + _SCRIPT_SPACE
            total, script = total + max(0.0, wide - script), max(wide, script)
            continue
        script = 0.0
        if token == r"\frac":
            below = min(style + 1, _SMALLEST)
            above, place = _argument(tokens, place)
            under, place = _argument(tokens, place)
            total += max(_width(above, below), _width(under, below)) + _BAR * _SIZE[style]
        elif token == r"\mathrm":
            letters, place = _argument(tokens, place)
            total += _UPRIGHT * len(letters) * _SIZE[style]
        elif token == "{":
            inner, place = _argument(tokens, place - 1)
            total += _width(inner, style)
        elif token in _DELIMITED:
            place += 1
            total += _DELIMITER * _SIZE[style]
        elif token in ("+", "-"):
            total += (_UNARY if opened or style >= _SCRIPT else _BINARY) * _SIZE[style]
        else:
            total += _letter(token) * _SIZE[style]
        opened = token in ("=", "(", "[", ",", *_DELIMITED)
    return total


def _argument(tokens: Sequence[str], place: int) -> tuple[Sequence[str], int]:
    """Give the tokens of a group, without its braces, or the one token there, and the place after it."""
    if tokens[place] != "{":
        return tokens[place : place + 1], place + 1
    depth, end = 1, place + 1
    while depth:
        depth += {"{": 1, "}": -1}.get(tokens[end], 0)
        end += 1
    return tokens[place + 1 : end - 1], end


def _letter(token: str) -> float:
    if token in _SET:
        return _SET[token]
    capital = token.lstrip("\\")[0].isupper()
    return 0.72 if capital else 0.53
