"""The paper's model, derivation and kernels, made once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen.emit.pipeline import Artifacts, generate
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Derivation, derive


@pytest.fixture(scope="session")
def document(root: Path) -> dict[str, Any]:
    """The paper's model file, parsed."""
    return read_document(root / "models" / "paper.toml")


@pytest.fixture(scope="session")
def paper(document: dict[str, Any]) -> Derivation:
    """The paper's derivation."""
    return derive(model_of(document, "paper.toml"))


@pytest.fixture(scope="session")
def artifacts(document: dict[str, Any]) -> Artifacts:
    """What the paper's model generates."""
    return generate(document, model_of(document, "paper.toml"))
