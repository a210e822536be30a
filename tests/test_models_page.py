"""What docs/models.md says of each joint's error is what its run shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
PARAGRAPHS = dict(re.findall(r"^\*\*([\w-]+)\.\*\* (.*?)\n\n", PAGE, re.DOTALL | re.MULTILINE))
NAMES = sorted(path.stem for path in (ROOT / "models").glob("*.toml"))


def test_every_shipped_model_has_a_paragraph() -> None:
    assert set(NAMES) <= set(PARAGRAPHS)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "paper"])  # README tells of the paper's
def test_error_is_as_said(name: str) -> None:
    """The last error named is the largest one: after the start, or over all where the start has no offset."""
    said = [float(text) for text in re.findall(r"(\d(?:\.\d)?e-\d+) rad\b(?!/)", PARAGRAPHS[name])]
    run = ClosedLoop.load(name).simulate()
    at_rest = run["e"][0] == 0.0
    largest = float(np.max(np.abs(run["e"][run.t > (-1.0 if at_rest else 4.0)])))
    assert said[-1] / 2 < largest <= said[-1]
    assert not at_rest or len(said) == 1
