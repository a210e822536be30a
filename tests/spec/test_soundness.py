"""What the plant class demands of numbers, for a plant and for a physical joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.spec import model_of
from pmjoint_codegen.spec.reader import read_document

MODELS = Path(__file__).resolve().parents[2] / "models"


@pytest.mark.parametrize("file", sorted(MODELS.glob("*.toml")), ids=lambda file: file.stem)
def test_every_shipped_model_is_sound(file: Path) -> None:
    assert model_of(read_document(file), file.name).name == file.stem


@pytest.mark.parametrize(("name", "value"), [("J", 1e-320), ("C1", 1e308), ("r", 1e200), ("l0", 1e-320)])
def test_a_joint_of_extreme_numbers_is_refused_in_one_line(name: str, value: float) -> None:
    document = read_document(MODELS / "joint.toml")
    document["joint"][name] = {**document["joint"][name], "value": value}
    with pytest.raises(ModelError, match=r"^m\.toml: joint.* has no finite real value"):
        model_of(document, "m.toml")
