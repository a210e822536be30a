"""``law = "adrc"``: what it takes, what it refuses, and what it makes of a file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from pmjoint_codegen import modelfile
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.identity import model_hash, structure_hash
from pmjoint_derive import derive

FILE = Path(__file__).parents[1] / "simulate" / "joint-adrc.toml"


@pytest.fixture
def adrc() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def changed(document: Mapping[str, Any], table: str, **keys: Any) -> dict[str, Any]:
    """A copy with other keys in a table; None removes one."""
    found = {**document.get(table, {}), **keys}
    return {**document, table: {key: value for key, value in found.items() if value is not None}}


def test_the_gains_are_c_and_observer(adrc: dict[str, Any]) -> None:
    model = modelfile.model_of(adrc, "x.toml")
    assert model.design == "adrc" and model.gains.observer == 120.0
    assert model.gains.by_kind == {"c": (15.0, 15.0), "e": (), "ck": (), "k": ()}
    assert not model.gains.compensator
    assert [str(symbol) for symbol in derive(model).signals.gains] == [
        "c1", "c2", "compensator", "input_scale", "observer",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"observer": None}, "x.toml: design.observer: is missing; allowed: a finite number of 1/s greater"),
        ({"c": None}, "x.toml: design.c: is missing; allowed: a list"),
        ({"observer": 0.0}, "x.toml: design.observer: is 0.0; allowed: a finite number of 1/s greater"),
        ({"c": [15.0]}, "x.toml: design.c: has 1 entry; allowed: 2"),
        ({"c": [15.0, -1.0]}, "x.toml: design.c, entry 2: is -1; allowed: a number greater than 0"),
        ({"law": "adcr"}, 'x.toml: design.law: is the text \'adcr\'; allowed: "backstepping" or "adrc"'),
        *(
            ({key: value}, f'x.toml: design.{key}: means nothing to law = "adrc"; leave it out')
            for key, value in {
                "e": [1.0, 1.0],
                "ck": [1.0, 1.0],
                "k": [6.0, 8.0],
                "poles": 20.0,
                "bandwidth": 10.0,
                "braking": 0.5,
                "input_scale": 2.0,
            }.items()
        ),
        ({"saturation": "compensator"}, "design.saturation: is 'compensator', but law = \"adrc\" is clipped"),
        ({"saturation": "braking"}, "design.saturation: is 'braking', but law = \"adrc\" is clipped plainly"),
        ({"compensator": True}, "design.compensator: is 'true', but law = \"adrc\" is clipped plainly"),
    ],
)
def test_a_design_that_does_not_fit_is_refused(
    adrc: dict[str, Any], keys: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError) as caught:
        modelfile.model_of(changed(adrc, "design", **keys), "x.toml")
    assert message in str(caught.value)


@pytest.mark.parametrize("keys", [{"saturation": "clip"}, {"compensator": False}, {"start": "matched"}])
def test_what_is_true_of_it_may_be_said(adrc: dict[str, Any], keys: dict[str, Any]) -> None:
    assert modelfile.model_of(changed(adrc, "design", **keys), "x.toml").design == "adrc"


def test_an_observer_without_its_law_is_refused(paper: dict[str, Any]) -> None:
    with pytest.raises(
        ModelError, match=r'design.observer: has no effect on backstepping; give law = "adrc"'
    ):
        modelfile.model_of(changed(paper, "design", observer=10.0), "x.toml")


def test_a_plant_with_zeros_is_refused(adrc: dict[str, Any]) -> None:
    zeros = changed(changed(adrc, "plant", b=["1", "b0"]), "design", c=[15.0])
    with pytest.raises(
        ModelError, match=r'plant.b: has 2 entries.* give b = \[b_0\] alone, or law = "backst'
    ):
        modelfile.model_of(zeros, "x.toml")


@pytest.mark.parametrize("table", [{"load": True}, {"unknown": ["d1"], "gain": {"d1": 1.0}}])
def test_estimates_are_refused(adrc: dict[str, Any], table: dict[str, Any]) -> None:
    with pytest.raises(
        ModelError, match=r'x.toml: adaptation: law = "adrc" estimates no parameter; leave it'
    ):
        modelfile.model_of(changed(adrc, "adaptation", **table), "x.toml")


def test_a_guess_alone_is_what_the_observer_and_the_law_take(adrc: dict[str, Any]) -> None:
    found = derive(modelfile.model_of(changed(adrc, "adaptation", guess={"b0": 60.0}), "x.toml"))
    assert "b0_guess" in str(found.equations["v"].expression)
    assert "b0_guess*u" in str(found.equations["eso2_dot"].expression)
    assert "b0*u" in str(found.equations["x2_dot"].expression)
    assert all(identity.holds for identity in found.design.prove(found))


@pytest.mark.parametrize("name", ["observer", "eso2"])
def test_names_of_the_observer_are_taken(adrc: dict[str, Any], name: str) -> None:
    more = changed(adrc, "parameters", **{name: {"value": 1.0}})
    with pytest.raises(ModelError, match=f"parameters.{name}: already names something of law"):
        modelfile.model_of(more, "x.toml")


def test_the_law_is_structure_and_its_bandwidth_a_number(adrc: dict[str, Any]) -> None:
    faster = changed(adrc, "design", observer=200.0)
    other = changed(adrc, "design", law=None)
    assert structure_hash(faster) == structure_hash(adrc) != structure_hash(other)
    assert model_hash(faster) != model_hash(adrc)
