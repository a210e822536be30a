"""The rules that a manifest hands to the runtime: they mean what the model's expressions mean."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.emit.describe import linear_of, rules_of
from pmjoint_codegen.emit.vocabulary import vocabulary
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.values import Rule, check_rules, obeys
from pmjoint_derive import derive


def rules(document: dict[str, Any], **changed: Any) -> tuple[Rule, ...]:
    other = copy.deepcopy(document)
    for key, value in changed.items():
        table = other["simulation" if key == "reference" else "plant"]
        table[key] = value
    return rules_of(derive(model_of(other, "paper.toml")))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("b0 - 1/3", 5 / 3),
        ("sqrt(b0)*exp(-d1)*pi - 1e-300", math.sqrt(2) * math.exp(-0.2) * math.pi),
        ("sin(b0)*cos(d1)/tan(u_max) + tanh(b0)", math.sin(2) * math.cos(0.2) / math.tan(10) + math.tanh(2)),
        ("log(u_max)**3/b0**1.5 - exp(1)", math.log(10) ** 3 / 2**1.5 - math.e),
        ("sqrt(d1*d1)", 0.2),
        ("1e-310*b0 + 12345678901234567890123*d1", 0.2 * 12345678901234567890123),
    ],
)
def test_b_m_means_to_the_runtime_what_it_means_to_the_model(
    document: dict[str, Any], text: str, value: float
) -> None:
    (rule,) = rules(document, b=[text])
    (term,) = rule.terms
    columns = {"d1": np.array([0.2]), "b0": np.array([2.0]), "u_max": np.array([10.0])}
    slack = 1e-13 * abs(value)
    for bound, expected in ((value - slack, True), (value + slack, False)):
        positive = Rule("b_m", "positive", (f"{term} - ({bound!r})",), "", "")
        assert bool(obeys(positive, columns)[0]) == expected


def test_a_reference_is_finite_at_the_start_as_far_as_parameters_decide(document: dict[str, Any]) -> None:
    values = {"d1": 0.2, "b0": 2.0, "u_max": 10.0}
    found = rules(document, reference="exp(-t/d1) + sin(b0*t)")
    check_rules(values, found)
    with pytest.raises(ModelError, match=r"^reference: has no finite value at these parameters; allowed: "):
        check_rules(values | {"d1": 0.0}, found)
    assert [item.name for item in rules(document, reference="d1*sin(b0*t)")] == ["b_m"]


@pytest.mark.parametrize(
    ("plant", "found"),
    [
        ({}, ("0", "d1", "b0")),
        ({"phi": ["-3*y", "u_max*y"], "b": ["-b0/2"], "sigma": "4"}, ("-3", "d1 + u_max", "-2*b0")),
        ({"phi": ["0", "y**3"]}, ()),
        ({"sigma": "1 + y**2"}, ()),
        ({"phi": ["0", "1"]}, ()),
        ({"disturbance": ["0.1*sin(t)", "0"]}, ()),
        ({"disturbance_bound": None}, ()),
        ({"disturbance": ["0", "0"], "disturbance_bound": None}, ("0", "d1", "b0")),
        ({"b": ["b0", "b0"]}, ()),
    ],
)
def test_a_linear_plant_of_two_states_is_recognised_whatever_its_names(
    document: dict[str, Any], plant: dict[str, Any], found: tuple[str, ...]
) -> None:
    other = copy.deepcopy(document)
    other["plant"] = {key: item for key, item in {**other["plant"], **plant}.items() if item is not None}
    if len(plant.get("b", "1")) == 2:
        other["design"] |= {"c": [15], "e": [0.1], "ck": [1]}
    derivation = derive(model_of(other, "paper.toml"))
    assert linear_of(derivation.model, vocabulary(derivation)) == found


def test_twins_of_a_joint_s_values_obey_the_same(root: Path) -> None:
    found = rules_of(derive(model_of(read_document(root / "models" / "joint-lag.toml"), "joint-lag.toml")))
    named = [item.name for item in found if item.kind == "positive"]
    assert {"J", "tau", "J_plant", "tau_plant"} <= set(named)
    assert named.count("u0") == named.count("u0_plant") == 2
