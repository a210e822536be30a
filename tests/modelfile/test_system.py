"""``[system]`` in a model file: what it fills, and what it refuses, each in one line."""

from __future__ import annotations

from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.units import Scales
from pmjoint_derive import Model, real_symbol
from tests.modelfile.edits import with_changes

AXIS: dict[str, Any] = {
    "schema": 1,
    "name": "axis",
    "parameters": {
        "J": {"value": 50.0, "unit": "kg cm^2"},
        "B": {"value": 0.1, "unit": "N m s/rad"},
        "K": {"value": 2.0, "unit": "N m/bar"},
        "tau": {"value": 200.0, "unit": "ms"},
        "u_max": {"value": 2.5, "unit": "bar"},
    },
    "system": {
        "states": ["theta", "omega", "p"],
        "rates": ["omega", "(K*p - B*omega - sin(theta))/J", "(u - p)/tau"],
        "input": "u",
        "output": "theta",
        "units": ["rad", "rad/s", "Pa"],
    },
    "actuator": {"limit": "u_max"},
    "units": {"y": "rad", "u": "Pa"},
    "design": {"bandwidth": 20.0, "input_scale": "auto"},
    "simulation": {"reference": "sin(t)", "x0": [0.1, 0.2, 3e4], "horizon": 1.0},
}
TRANSFER = {
    "system": {"transfer_function": {"num": ["K"], "den": ["tau", 1, 0]}},
    "simulation.x0": [0.0, 0.0],
}


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """A copy of the axis with some keys set; None takes one away."""
    return with_changes(AXIS, changes)


def read(changes: dict[str, Any]) -> Model:
    return model_of(changed(changes), "m.toml")


def rates(second: str, third: str = "(u - p)/tau") -> dict[str, Any]:
    return {"system.rates": ["omega", second, third]}


def test_parameters_are_in_si_units_and_the_start_is_in_the_file_s_states() -> None:
    model = read({})
    values = {item.name: (item.value, item.scale) for item in model.parameters}
    assert values["J"] == (0.005, "0.0001")
    assert values["u_max"] == (2.5e5, "1E+5")
    assert model.start is not None
    assert [(item.name, str(item.unit)) for item in model.start.variables] == [
        ("theta", "rad"),
        ("omega", "rad/s"),
        ("p", "Pa"),
    ]
    assert model.plant.rho == 3
    assert len(model.gains.c) == 3


def test_a_reference_is_in_the_unit_of_y_and_names_quantities() -> None:
    changes = {
        "units.y": "deg",
        "parameters.amplitude": {"value": 0.3, "unit": "rad"},
        "parameters.w": {"value": 60.0, "unit": "deg/s"},
        "parameters.share": {"value": 2.0, "unit": "1"},
        "simulation.reference": "share*(amplitude*sin(w*t) + 20)",
    }
    amplitude, w, share, t = (real_symbol(name) for name in ("amplitude", "w", "share", "t"))
    expected = share * (180 / sp.pi * amplitude * sp.sin(w * t) + 20)
    assert sp.simplify(read(changes).reference - expected) == 0
    plain = read(changes | {"units.y": "rad"}).reference
    assert plain == share * (amplitude * sp.sin(w * t) + 20)


@pytest.mark.parametrize(
    ("unit", "of", "power"),
    [
        ("mm/s", "m", 1),
        ("inch^2", "mm", 2),
        ("1/mm", "m", -1),
        ("deg/s", "rad", 1),
        ("1/s", "rad", 0),
        ("N", "m", 0),
        ("bar s", "Pa", 1),
        ("%", "deg", 0),
    ],
)
def test_the_power_of_a_dimension_in_a_unit(unit: str, of: str, power: int) -> None:
    assert Scales("m.toml").power(unit, of) == power


def test_a_transfer_function_in_other_units_is_the_same() -> None:
    """The gain has the units of y over u; sampled values of phi agree at the same angle."""
    one, other = read(TRANSFER).plant, read(TRANSFER | {"units.y": "deg", "units.u": "bar"}).plant
    assert sp.simplify(other.b[0] / one.b[0] - sp.Integer(10) ** 5 * 180 / sp.pi) == 0
    assert other.phi == one.phi


def test_a_transfer_function_has_the_states_of_its_form() -> None:
    model = read(TRANSFER)
    assert model.start is None
    assert (model.plant.order, model.plant.rho) == (2, 2)
    assert [item.free_symbols for item in model.plant.b] == [{real_symbol("K"), real_symbol("tau")}]


def test_the_units_of_states_follow_from_the_output_s() -> None:
    model = read({"system.units": None})
    assert [item.unit and str(item.unit) for item in model.reported] == ["rad", "rad/s", None]


def test_the_input_and_the_output_have_names_of_their_own() -> None:
    model = read({**rates("(K*p - B*omega)/J", "(voltage - p)/tau"), "system.input": "voltage"})
    assert model.plant.b == read(rates("(K*p - B*omega)/J")).plant.b


MISTAKES: list[tuple[dict[str, Any], str]] = [
    (
        rates("(K*p - B*omega*p)/J"),
        "system.rates, entry 2: the term -B*omega*p/J is a product of omega and p, which are not measured; "
        "leave it to the key disturbance",
    ),
    (rates("K*p - B*omega**2"), "system.rates, entry 2: the term -B*omega**2 is not linear in omega"),
    (rates("K*p*theta**2 + p"), "system.rates, entry 2: the term K*p*theta**2 multiplies p"),
    (rates("K*p", "u**2 - p"), "system.rates, entry 3: u**2 is not linear in the input; redefine the input"),
    (rates("K*p", "u*p - p"), "system.rates, entry 3: the term p*u multiplies u by p, which is not measured"),
    ({"system.output": "theta + u"}, "system.output: u acts on the output at once"),
    (
        rates("u", "-p"),
        "system.output: p cannot be told from the output theta and its derivatives; leave p out",
    ),
    (rates("K*p", "-p"), "system.rates: u does not reach the output"),
    (rates("K*p + sin(theta)*u"), "system.rates: u acts by way of two functions of the output"),
    (rates("K*(p - u*tau/2)"), "system: the zero dynamics are unstable"),
    ({"parameters.K": {"value": 0.0}}, "design.input_scale: b_m is 0 or not finite at the given"),
    (rates("K*p - abs(omega)"), "system.rates, entry 2: 'K*p - abs(omega)': abs has a kink"),
    (rates("K*p - sqrt(theta*theta)"), "system.rates, entry 2: 'K*p - sqrt(theta*theta)': abs has a kink"),
    (
        rates("K*p", "u(t - 0.1) - p"),
        "system.rates, entry 3: a dead time is not part of the design; actuator.delay",
    ),
    (
        {**TRANSFER, "system": {"transfer_function": {"num": [1], "den": [1, 1], "delay": 0.1}}},
        "system.transfer_function.delay: a dead time is not part of the design; actuator.delay simulates one",
    ),
    (
        {"system.input": ["u1", "u2"]},
        "system.input: is a list, and the design is for one input and one output",
    ),
    ({"system.output": ["theta", "p"]}, "system.output: is a list, and the design is for one input"),
    (
        {**TRANSFER, "system": {"transfer_function": {"num": [[1], [2]], "den": [1, 1]}}},
        "system.transfer_function.num: is a list, and the design is for one input and one output",
    ),
    (
        {**TRANSFER, "system": {"transfer_function": {"num": [1, 0, 1], "den": [1, 1, 1]}}},
        "system.transfer_function.num: the numerator has no lower degree than the denominator",
    ),
    (
        {**TRANSFER, "system": {"transfer_function": {"num": [0, 1], "den": [1, 1, 1]}}},
        "system.transfer_function.num: the leading coefficient is 0; leave it out",
    ),
    (
        {"system.transfer_function": {"num": [1], "den": [1, 1]}},
        "system.states: stands beside a transfer function",
    ),
    ({"system.output": None}, "system.output: is missing; allowed: states, rates and output together"),
    ({"system.rates": ["omega", "u"]}, "system.rates: has 2 entries; allowed: 3, one a state"),
    ({"system.disturbance": ["0"]}, "system.disturbance: has 1 entry; allowed: 3, one a state"),
    ({"system.states": ["theta", "v", "p"]}, "system.states, entry 2: 'v' already names a signal"),
    ({"system.states": ["theta", "x2", "p"]}, "system.states, entry 2: 'x2' already names a signal"),
    ({"system.states": ["theta", "e", "p"]}, "system.states, entry 2: 'e' already names a column"),
    ({"system.states": ["theta", "K", "p"]}, "system.states, entry 2: 'K' is a parameter too"),
    ({"system.states": ["theta", "theta", "p"]}, "system.states, entry 2: 'theta' is there twice"),
    ({"system.states": ["q", "theta_dot", "p"]}, "system.states, entry 2: 'theta_dot' names the rate"),
    ({"system.input": "K"}, "system.input: 'K' is a parameter too; choose another name"),
    ({"system.units": ["rad", "rad/s", "degC"]}, "system.units, entry 3: 'degC' has an offset"),
    ({"system.units": ["rad", "apples", "Pa"]}, "system.units, entry 2: 'apples' is not a known unit"),
    ({"units.y": "degF"}, "units.y: 'degF' has an offset"),
    (
        {
            "units.y": "deg",
            "parameters.q": {"value": 1.0, "unit": "deg"},
            "sensor": {"noise": "q", "seed": 1},
            "actuator.rate": "q",
        },
        "parameters.q: stands for a quantity of y and for one of u",
    ),
    ({"parameters.u_max": {"value": 1.0, "unit": "V"}}, "parameters.u_max.unit: 'V' does not convert to Pa"),
    ({"system.range": [1.0, -1.0]}, "system.range: is [1.0, -1.0]; allowed: [least y, greatest y]"),
    ({"simulation.x0": [0.0, 0.0]}, "simulation.x0: has 2 entries; allowed: 3 (order of the plant)"),
    (
        {"design.c": [1.0, 1.0]},
        "design.c: has 2 entries; allowed: 3 (relative degree of the system)",
    ),
    ({"design.saturation": "braking"}, "design.saturation: braking is derived for relative degree 2 only"),
    (
        {**rates("(K*p + sin(theta))/J", "(theta*u - p)/tau"), "system.range": [-1.0, 1.0]},
        "system.rates, factor of u: sigma vanishes, or is not finite, near y = 0",
    ),
    (
        {"plant": {"order": 1, "b": ["K"]}},
        "plant: plant and system are given; allowed: one of [plant], [joint] and [system]",
    ),
]


@pytest.mark.parametrize(("changes", "line"), MISTAKES, ids=[line[:50] for _, line in MISTAKES])
def test_a_mistake_is_one_clear_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(changes)
    said = str(caught.value)
    assert said.startswith(f"m.toml: {line}")
    assert said.isprintable()
    assert "; " in said  # with a remedy


@pytest.mark.parametrize("name", ["y", "u", "t", "lambda", "c1", "rate_of_p", "theta_plant", "p-1"])
def test_a_state_has_no_name_that_means_something_else(name: str) -> None:
    with pytest.raises(ModelError, match=r"system\.states, entry 1"):
        read({"system.states": [name, "omega", "p"]})
