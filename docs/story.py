"""The joint of docs/howto/change-the-model.md, step by step, for its figure and for the test of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pmjoint_codegen.cli.new import TEMPLATES

PAGE: Final = Path(__file__).resolve().parent / "howto" / "change-the-model.md"
GAIT: Final = "--reference gait.csv --reference-unit deg --reference-filter 15 --horizon 7"  # as on the page
_STEP: Final = re.compile(r"<!-- (step|try): ([^\n]+) -->\n```diff\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_CSV: Final = re.compile(r"^```csv\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def applied(text: str, diff: str) -> str:
    """Apply a diff without context: - lines give way to the + lines below.

    Raises:
        ValueError: lines that do not stand exactly once in the text.
    """
    for old, new in re.findall(r"((?:^-.*\n)+)((?:^\+.*\n)+)", diff, re.MULTILINE):
        removed, added = (re.sub(r"^[-+]", "", block, flags=re.MULTILINE) for block in (old, new))
        if text.count(removed) != 1:
            raise ValueError(f"not exactly once in the model file: {removed}")
        text = text.replace(removed, added)
    return text


def models() -> Iterator[tuple[str, str]]:
    """Name and text of the model after each step; what is only tried does not stay."""
    text = (TEMPLATES / "joint.toml").read_text(encoding="utf-8").replace('"NAME"', '"forearm"', 1)
    yield "as `pmjoint new` writes it", text
    for kind, name, diff in _STEP.findall(PAGE.read_text(encoding="utf-8")):
        changed = applied(text, diff)
        yield name, changed
        text = changed if kind == "step" else text


def gait() -> str:
    """The recorded gait, as a .csv file."""
    (found,) = _CSV.findall(PAGE.read_text(encoding="utf-8"))
    return str(found)
