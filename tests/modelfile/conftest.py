"""The paper's model file as a document that tests may change."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.modelfile.reader import read_document

Edit = Callable[..., dict[str, Any]]
PAPER = Path(__file__).resolve().parents[2] / "models" / "paper.toml"


@pytest.fixture(scope="session")
def paper() -> dict[str, Any]:
    """The document of models/paper.toml; not to be changed."""
    return read_document(PAPER)


@pytest.fixture
def edited(paper: dict[str, Any]) -> Edit:
    """Make a copy with some keys set, given as {"plant.order": 3}; a value of None takes the key away."""

    def edit(changes: dict[str, Any]) -> dict[str, Any]:
        document = deepcopy(paper)
        for path, value in changes.items():
            *tables, key = path.split(".")
            table = document
            for name in tables:
                table = table[name]
            table[key] = value
            if value is None:
                del table[key]
        return document

    return edit
