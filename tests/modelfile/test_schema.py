"""Each mistake in a model file is one line: file, key, what is wrong, what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.schema import ModelSpec, validate

Edit = Callable[[dict[str, Any]], dict[str, Any]]


def complaint(document: dict[str, Any]) -> str:
    with pytest.raises(ModelError) as caught:
        validate(document, "m.toml")
    return str(caught.value)


def test_the_papers_file_is_read_whole(paper: dict[str, Any]) -> None:
    spec = validate(paper, "m.toml")
    assert list(spec.parameters) == ["d1", "b0", "u_max"]
    assert spec.parameters["b0"].unit == "rad/(s^2 V)"
    assert spec.plant is not None and spec.plant.Phi == (("0",), ("y",))
    assert spec.design.c == (15.0, 15.0)
    assert spec.simulation.x0 == (1.5, 0.0)
    assert (spec.units.y, spec.units.u) == ("rad", "V")


def test_a_spec_cannot_be_changed(paper: dict[str, Any]) -> None:
    spec = validate(paper, "m.toml")
    with pytest.raises(ValueError, match="frozen"):
        spec.name = "other"


def test_optional_keys_may_be_left_out(edited: Edit) -> None:
    left_out = ["plant.phi", "plant.Phi", "plant.theta", "plant.sigma", "plant.disturbance"]
    left_out += ["plant.disturbance_bound", "design.compensator", "simulation.output_step", "title"]
    spec = validate(edited(dict.fromkeys(left_out)), "m.toml")
    assert spec.plant is not None and spec.plant.sigma == "1"
    assert spec.plant.theta == () and spec.design.compensated


def test_a_bare_number_is_an_expression(edited: Edit) -> None:
    plant = validate(edited({"plant.phi": [0, 0.5]}), "m.toml").plant
    assert plant is not None and plant.phi == ("0", "0.5")


NAN, INF = float("nan"), float("inf")
MISTAKES = [
    ({"schema": 2}, "schema: is 2; allowed: 1, the only schema there is"),
    ({"schema": True}, "schema: is true; allowed: 1,"),
    ({"nam": "x"}, "nam: unknown key; did you mean 'name'? allowed: schema, name,"),
    ({"spring": {}}, "spring: unknown key; allowed: schema"),
    (
        {"simulation.horizn": 20, "simulation.horizon": None},
        "simulation.horizn: unknown key (and 1 more); did you mean",
    ),
    (
        {"parameters.d1.units": "s"},
        "parameters.d1.units: unknown key; did you mean 'unit'? allowed: value, unit, about",
    ),
    ({"name": "../x"}, "name: is the text '../x'; allowed: letters, digits, - and _"),
    ({"name": None}, "name: is missing; allowed: letters"),
    ({"title": "a\nb"}, "title: is the text 'a\\nb'; allowed: one line of text"),
    ({"title": "x" * 401}, "title: has 401 characters; allowed: one line of text, 400 characters at most"),
    (
        {"plant": None},
        "plant: is missing, and so are [joint] and [system]; allowed: one of [plant], [joint] and [system]",
    ),
    ({"plant": 3}, "plant: is 3; allowed: the table [plant]"),
    ({"parameters.d1": 0.2}, "parameters.d1: is 0.2; allowed: lines such as b0 = { value = 2.0"),
    ({"parameters.d1.value": "0.2"}, "parameters.d1.value: is the text '0.2'; allowed: a finite number"),
    ({"parameters.d1.value": NAN}, "parameters.d1.value: is nan; allowed: a finite number"),
    ({"parameters.d1.value": -INF}, "parameters.d1.value: is -inf; allowed: a finite number"),
    ({"parameters.d1.value": True}, "parameters.d1.value: is true; allowed: a finite number"),
    ({"parameters.c1": {"value": 1}}, "parameters.c1: already names a signal, gain, state, function or step"),
    ({"parameters.a b": {"value": 1}}, "parameters.'a b': is not a name: a letter, then letters"),
    ({"plant.order": 2.0}, "plant.order: is 2.0; allowed: a whole number from 1 to 9"),
    ({"plant.order": 0}, "plant.order: is 0; allowed: a whole number from 1 to 9"),
    ({"plant.order": 10**6}, "plant.order: is 1000000; allowed: a whole number from 1 to 9"),
    ({"plant.order": 3}, "plant.phi: has 2 entries; allowed: 3 (order of the plant)"),
    ({"plant.phi": "0"}, "plant.phi: is the text '0'; allowed: a list of order expressions"),
    ({"plant.phi": ["0"]}, "plant.phi: has 1 entry; allowed: 2 (order of the plant)"),
    ({"plant.phi": ["0", True]}, "plant.phi, entry 2: is true; allowed: a list of order expressions"),
    ({"plant.Phi": [["0"]]}, "plant.Phi: has 1 entry; allowed: 2 (order of the plant)"),
    ({"plant.Phi": [["0"], ["y", "y"]]}, "plant.Phi, entry 2: has 2 entries; allowed: 1 (as long as theta)"),
    ({"plant.theta": []}, "plant: Phi and theta belong together; give both, or neither"),
    ({"plant.Phi": None}, "plant: Phi and theta belong together; give both, or neither"),
    ({"plant.theta": ["d1"] * 10}, "plant.theta: has 10 entries; allowed: a list of at most 9"),
    ({"plant.b": []}, "plant.b: has 0 entries; allowed: 1 to 2 (b_m ... b_0, order = 2)"),
    ({"plant.b": ["b0"] * 3}, "plant.b: has 3 entries; allowed: 1 to 2 (b_m ... b_0, order = 2)"),
    ({"plant.disturbance": ["0"]}, "plant.disturbance: has 1 entry; allowed: 2 (order of the plant)"),
    (
        {"plant.disturbance_bound": -0.1},
        "plant.disturbance_bound: is -0.1; allowed: a finite number, 0 or greater",
    ),
    ({"actuator.limit": "u_mx"}, "actuator.limit: no parameter is called 'u_mx'; allowed: d1, b0, u_max"),
    ({"parameters": {}}, "actuator.limit: no parameter is called 'u_max'; declare it in [parameters]"),
    ({"design.c": [15]}, "design.c: has 1 entry; allowed: 2 (relative degree = order + 1 - length of b)"),
    ({"design.c": [15, INF]}, "design.c, entry 2: is inf; allowed: a list of finite numbers greater than 0"),
    ({"design.k": [6, 8, 1]}, "design.k: has 3 entries; allowed: 2 (order of the plant)"),
    ({"design.compensator": 1}, "design.compensator: is 1; allowed: true or false"),
    ({"simulation.x0": [1, 2, 3]}, "simulation.x0: has 3 entries; allowed: 2 (order of the plant)"),
    ({"simulation.x0": [1, NAN]}, "simulation.x0, entry 2: is nan; allowed: a list of finite numbers"),
    (
        {"simulation.horizon": 0},
        "simulation.horizon: is 0; allowed: a finite number of seconds greater than 0",
    ),
    (
        {"simulation.horizon": -1.5},
        "simulation.horizon: is -1.5; allowed: a finite number of seconds greater than 0",
    ),
    ({"simulation.output_step": INF}, "simulation.output_step: is inf; allowed: a finite number of seconds"),
    ({"simulation.sample_time": 0}, "simulation.sample_time: is 0; allowed: a finite number of seconds"),
    ({"units": {"x": "m"}}, "units.x: unknown key; allowed: y, u"),
]


@pytest.mark.parametrize(("changes", "line"), MISTAKES, ids=[line[:40] for _, line in MISTAKES])
def test_a_mistake_is_one_clear_line(changes: dict[str, Any], line: str, edited: Edit) -> None:
    said = complaint(edited(changes))
    assert said.startswith(f"m.toml: {line}")
    assert said.isprintable()


def test_every_key_says_what_is_allowed_there() -> None:
    def undescribed(table: Any) -> list[str]:
        return [
            f"{table.__name__}.{name}" for name, field in table.model_fields.items() if not field.description
        ]

    tables = [ModelSpec, *(field.annotation for field in ModelSpec.model_fields.values())]
    assert [name for table in tables if hasattr(table, "model_fields") for name in undescribed(table)] == []


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(data=st.data())
@settings(deadline=None)
def test_any_value_at_any_key_is_read_or_refused_in_one_line(
    data: st.DataObject, paper: dict[str, Any]
) -> None:
    document = dict(paper)
    table = data.draw(st.sampled_from([None, *(key for key in paper if isinstance(paper[key], dict))]))
    if table is None:
        document[data.draw(st.sampled_from(list(paper)))] = data.draw(VALUES)
    else:
        document[table] = {**paper[table], data.draw(st.sampled_from(list(paper[table]))): data.draw(VALUES)}
    try:
        assert isinstance(validate(document, "m.toml"), ModelSpec)
    except ModelError as error:
        assert str(error).startswith("m.toml: ") and str(error).isprintable() and len(str(error)) < 600
