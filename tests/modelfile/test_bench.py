"""Numbers of ``[actuator]`` and ``[sensor]`` that cannot be are refused as the file is read."""

from __future__ import annotations

from typing import Any

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.model import to_derive
from pmjoint_codegen.modelfile.schema import validate

DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "name": "bench",
    "parameters": {"wide": {"value": -3.0}},
    "plant": {"order": 2, "b": ["2"]},
    "actuator": {"lower": -1, "upper": 2},
    "sensor": {},
    "design": {"bandwidth": 6.0},
    "simulation": {"reference": "sin(t)", "x0": [0.1, 0.0], "horizon": 2.0},
}


@pytest.mark.parametrize(
    ("table", "keys", "message"),
    [
        ("actuator", {"lag": 0}, "actuator.lag: is 0; allowed: a number greater than 0"),
        ("actuator", {"rate": "wide"}, "parameters.wide.value: is -3; allowed: a number greater than 0"),
        ("actuator", {"lower": 2}, "actuator.upper: no room is left for u: upper - lower = 0;"),
        (
            "actuator",
            {"lower": 1, "dead_zone": 0.1},
            "actuator.lower: a dead zone lies around 0:",
        ),
        ("sensor", {"resolution": -1}, "sensor.resolution: is -1; allowed: a number, 0 or greater"),
        ("sensor", {"noise": 1, "seed": 0.5}, "sensor.seed: is 0.5; allowed: a whole number, 0 or greater"),
    ],
)
def test_a_number_that_no_bench_can_have(table: str, keys: dict[str, Any], message: str) -> None:
    document = {**DOCUMENT, table: {**DOCUMENT[table], **keys}}
    with pytest.raises(ModelError) as caught:
        to_derive(validate(document, "bench.toml"), "bench.toml")
    assert str(caught.value).startswith(f"bench.toml: {message}")


def test_the_same_bench_with_possible_numbers_is_read() -> None:
    to_derive(validate(DOCUMENT, "bench.toml"), "bench.toml")


@pytest.mark.parametrize(("key", "name"), [("resolution", "y_m"), ("filter", "y_f")])
def test_a_parameter_with_the_name_of_a_reading(key: str, name: str) -> None:
    """Beside a sensor; without one the name is free."""
    document = {**DOCUMENT, "parameters": {**DOCUMENT["parameters"], name: {"value": 1.0}}}
    to_derive(validate(document, "bench.toml"), "bench.toml")
    with pytest.raises(ModelError) as caught:
        validate({**document, "sensor": {key: 0.1}}, "bench.toml")
    assert str(caught.value) == (
        f"bench.toml: parameters.{name}: already names what the sensor reads; choose another name"
    )
