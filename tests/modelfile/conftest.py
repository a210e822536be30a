"""The paper's model file as a document that tests may change."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.modelfile.reader import read_document
from tests.modelfile.edits import with_changes

Edit = Callable[..., dict[str, Any]]
PAPER = Path(__file__).resolve().parents[2] / "models" / "paper.toml"


@pytest.fixture(scope="session")
def paper() -> dict[str, Any]:
    """The document of models/paper.toml; not to be changed."""
    return read_document(PAPER)


@pytest.fixture
def edited(paper: dict[str, Any]) -> Edit:
    """Make a copy with some keys set, given as {"plant.order": 3}; a value of None takes the key away."""
    return partial(with_changes, paper)
