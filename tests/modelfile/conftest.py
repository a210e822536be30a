"""The paper's model file as a document that tests may change."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Model
from tests.modelfile.edits import with_changes

Edit = Callable[..., dict[str, Any]]
Made = Callable[..., Model]
PAPER = Path(__file__).resolve().parents[2] / "models" / "paper.toml"


@pytest.fixture(scope="session")
def paper() -> dict[str, Any]:
    """The document of models/paper.toml; not to be changed."""
    return read_document(PAPER)


@pytest.fixture
def edited(paper: dict[str, Any]) -> Edit:
    """Make a copy with some keys set, given as {"plant.order": 3}; a value of None takes the key away."""
    return partial(with_changes, paper)


@pytest.fixture
def made(edited: Edit) -> Made:
    """The paper's model with a table ``[adaptation]``, and with other keys, given as plant__order=3."""

    def make(table: dict[str, Any], **changes: Any) -> Model:
        keys = {key.replace("__", "."): value for key, value in changes.items()}
        return model_of(edited({**keys, "adaptation": table}), "paper.toml")

    return make
