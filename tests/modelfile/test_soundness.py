"""What the plant class demands of numbers, for a plant and for a physical joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document

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


def test_a_misspelt_keep_is_named_before_the_lengths_that_follow_from_it() -> None:
    document = read_document(MODELS / "joint-lag.toml")
    document["joint"]["keep"] = ["damping", "lag"]
    with pytest.raises(ModelError, match=r"^m\.toml: joint\.keep: 'lag' is nothing that a design can keep"):
        model_of(document, "m.toml")


@pytest.mark.parametrize("name", ["joint", "joint-lag"])
def test_muscles_that_the_input_does_not_move_are_refused_by_that_name(name: str) -> None:
    document = read_document(MODELS / f"{name}.toml")
    for constant in ("C1", "C2", "C3"):
        document["joint"][constant] = 0.0
    with pytest.raises(
        ModelError,
        match=r"^m\.toml: joint: b0, the input gain .*, is 0 .* so no input acts; allowed: muscles",
    ):
        model_of(document, "m.toml")


@pytest.mark.parametrize(("reference", "order"), [("sqrt(t)", 1), ("t**1.5", 2)])
def test_a_reference_whose_derivatives_are_not_finite_is_refused(reference: str, order: int) -> None:
    """Assumption 1: the law of relative degree 2 takes y_r and two derivatives."""
    document = read_document(MODELS / "paper.toml")
    document["simulation"]["reference"] = reference
    with pytest.raises(
        ModelError, match=rf"simulation\.reference, derivative {order}: .* no finite real value"
    ):
        model_of(document, "m.toml")
    document["simulation"]["reference"] = "t**2"
    assert model_of(document, "m.toml").plant.rho == 2


@pytest.mark.parametrize(
    ("reference", "power"), [("t**2.5", r"t\*\*\(5/2\)"), ("1 + sin(t)**9.5", r"sin\(t\)\*\*\(19/2\)")]
)
def test_a_reference_without_a_taylor_series_where_the_run_starts_is_refused(
    reference: str, power: str
) -> None:
    """Derivative 3 of t^(5/2) is a multiple of t^(-1/2): the law needs two, a Taylor step all."""
    document = read_document(MODELS / "paper.toml")
    document["simulation"]["reference"] = reference
    with pytest.raises(ModelError, match=rf"simulation\.reference: '{power}' has derivatives that are not"):
        model_of(document, "m.toml")


@pytest.mark.parametrize(
    "reference", ["(t + 1)**2.5", "cos(t)**2.5", "(sin(t) + d1)**0.5", "t**5", "2**0.5*t"]
)
def test_powers_that_have_a_taylor_series_there_are_taken(reference: str) -> None:
    document = read_document(MODELS / "paper.toml")
    document["simulation"]["reference"] = reference
    assert model_of(document, "m.toml").plant.rho == 2
