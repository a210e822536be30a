"""Units of `[joint]`: what converts does, once and exactly; what does not is refused by one line."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.emit.pipeline import generate
from pmjoint_codegen.errors import MissingToolError, ModelError, UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.units import ANY, Scales, Wanted
from pmjoint_codegen.report.text import text_report
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.values import SI, all_to_si, from_si, to_si
from pmjoint_derive import derive

CONVERTED = [  # key, value and unit in the file, value in SI units
    ("J", 500.0, "kg cm^2", 0.05),
    ("J", 6000.0, "g*m**2", 6.0),
    ("J", 1.0, "lb in^2", 0.45359237 * 0.0254**2),
    ("b_v", 109.0, "N mm s/rad", 0.109),
    ("b_v", 0.109, "N m s", 0.109),
    ("b_v", 0.109, "J s", 0.109),
    ("r", 15.0, "mm", 0.015),
    ("r", 14.7, "mm", 0.0147),
    ("l0", 12.0, "inch", 0.3048),
    ("eps0", 15.0, "%", 0.15),
    ("C1", 366.46, "cm^2", 0.036646),
    ("C4", -0.2084, "kN", -208.4),
    ("k0", 0.5, "bar/V", 5e4),
    ("k_u", 50.0, "Pa/mV", 5e4),
    ("u0", 5000.0, "mV", 5.0),
    ("P_max", 0.5, "MPa", 5e5),
    ("tau", 100.0, "ms", 0.1),
    ("tau", 1.0, "µs", 1e-6),
    ("u_max", 4500.0, "mV", 4.5),
    ("bias", 3.0, "deg", math.pi / 60),
    ("bias", 2.0, "1/min", 2 / 60),
]
REFUSED = [  # key, unit, what the message says
    (
        "J",
        "bananas",
        "joint.J.unit: 'bananas' is not a known unit; allowed: a unit of the dimension of kg m^2",
    ),
    ("J", "kg m", "joint.J.unit: 'kg m' does not convert to kg m^2"),
    ("r", "kg", "joint.r.unit: 'kg' does not convert to m; allowed: a unit of the dimension of m"),
    ("r", "15 mm", "joint.r.unit: '15 mm' is not a known unit"),
    ("r", "1", "joint.r.unit: '1' does not convert to m"),
    ("eps0", "mm", "joint.eps0.unit: 'mm' does not convert to 1; allowed: a dimensionless unit"),
    ("k0", "bar", "joint.k0.unit: 'bar' does not convert to Pa/V"),
    ("tau", "Hz", "joint.tau.unit: 'Hz' does not convert to s"),
    ("P_max", "m^9^9^9^9", "joint.P_max.unit: 'm^9^9^9^9' is not a known unit"),
    ("u_max", "A", "parameters.u_max.unit: 'A' does not convert to V"),
    ("bias", "degC", "parameters.bias.unit: 'degC' has an offset"),
    ("bias", "widgets", "parameters.bias.unit: 'widgets' is not a known unit"),
]


@pytest.fixture(scope="module")
def lagged(root: Path) -> Mapping[str, Any]:
    """Give a joint with every key of `[joint]`, and a parameter of its reference."""
    document = tomllib.loads((root / "models" / "joint-lag.toml").read_text(encoding="utf-8"))
    document["parameters"]["bias"] = {"value": 0.0, "unit": "rad"}
    document["simulation"]["reference"] = "bias*(1 - cos(t))"
    return document


def stated(document: Mapping[str, Any], lines: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Give the model with other lines in `[joint]` or `[parameters]`."""
    tables = {
        table: {key: lines.get(key, value) for key, value in document[table].items()}
        for table in ("joint", "parameters")
    }
    return {**document, **tables}


def value_of(document: Mapping[str, Any], name: str) -> float:
    (found,) = (item.value for item in model_of(document, "m.toml").parameters if item.name == name)
    return found


@pytest.mark.parametrize(("name", "value", "unit", "si"), CONVERTED)
def test_numbers_reach_the_derivation_in_si_units(
    lagged: Mapping[str, Any], name: str, value: float, unit: str, si: float
) -> None:
    found = value_of(stated(lagged, {name: {"value": value, "unit": unit}}), name)
    assert found == pytest.approx(si, rel=4 * sys.float_info.epsilon)


@pytest.mark.parametrize(("name", "unit", "message"), REFUSED)
def test_what_does_not_convert_is_refused_with_the_key(
    lagged: Mapping[str, Any], name: str, unit: str, message: str
) -> None:
    with pytest.raises(ModelError) as refused:
        model_of(stated(lagged, {name: {"value": 0.1, "unit": unit}}), "m.toml")
    assert str(refused.value).startswith(f"m.toml: {message}")
    assert "allowed: " in str(refused.value) and 'such as "' in str(refused.value)


def test_a_number_without_a_unit_is_in_si_units(lagged: Mapping[str, Any]) -> None:
    bare = stated(lagged, {"r": {"value": 0.02}, "u_max": {"value": 4.0}})
    assert (value_of(bare, "r"), value_of(bare, "u_max")) == (0.02, 4.0)


@pytest.mark.parametrize(("units", "key"), [({"y": "1"}, "y"), ({"u": "mA"}, "u"), ({"y": "m"}, "y")])
def test_the_columns_of_a_joint_are_an_angle_and_a_voltage(
    lagged: Mapping[str, Any], units: dict[str, str], key: str
) -> None:
    with pytest.raises(ModelError, match=rf"m\.toml: units\.{key}: .*allowed: "):
        model_of({**lagged, "units": units}, "m.toml")


def test_a_broken_rule_is_told_in_the_unit_of_the_file(lagged: Mapping[str, Any]) -> None:
    with pytest.raises(ModelError, match=r"joint\.r: is -15; allowed: a number greater than 0"):
        model_of(stated(lagged, {"r": {"value": -15.0, "unit": "mm"}}), "m.toml")
    with pytest.raises(ModelError, match=r"u_max\.value: is -40; allowed"):
        model_of(stated(lagged, {"u_max": {"value": -40.0, "unit": "mV"}}), "m.toml")


def test_units_of_a_plant_stay_as_written(root: Path) -> None:
    document = tomllib.loads((root / "models" / "paper.toml").read_text(encoding="utf-8"))
    document["parameters"]["d1"] = {"value": 0.2, "unit": "bananas"}
    document["parameters"]["u_max"] = {"value": 10.0, "unit": "mV"}
    assert (value_of(document, "d1"), value_of(document, "u_max")) == (0.2, 10.0)


@pytest.fixture(scope="module")
def joints(root: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Give the generated files of one joint, in SI units and in others."""
    document = tomllib.loads((root / "models" / "joint.toml").read_text(encoding="utf-8"))
    lines = {
        "J": {"value": 500, "unit": "kg cm^2"},
        "r": {"value": 15, "unit": "mm"},
        "k0": {"value": 0.5, "unit": "bar/V"},
        "P_max": {"value": 5, "unit": "bar"},
        "u_max": {"value": 5000, "unit": "mV"},
    }
    other = stated(document, lines)
    one, two = (generate(item, model_of(item, "m.toml")).files for item in (document, other))
    return dict(one), dict(two)


def test_the_unit_shapes_no_kernel(joints: tuple[dict[str, str], dict[str, str]]) -> None:
    in_si, other = joints
    for name in in_si.keys() - {"model.json", "derivation.md"}:
        lines = zip(in_si[name].splitlines(), other[name].splitlines(), strict=True)
        assert [pair for pair in lines if len(set(pair)) == 2 and "hash" not in pair[0]] == []
    one, two = (Manifest.from_json(files["model.json"], "m") for files in joints)
    assert [item.value for item in one.parameters] == [item.value for item in two.parameters]
    assert two.scales == {
        "J": "0.0001",
        "r": "0.001",
        "k0": "1E+5",
        "P_max": "1E+5",
        "u_max": "0.001",
        "J_plant": "0.0001",
        "r_plant": "0.001",
        "k0_plant": "1E+5",
    }
    assert '"scale"' not in in_si["model.json"]  # the shipped models' files are as they were


def test_runs_take_and_show_values_in_the_unit_of_the_file(
    joints: tuple[dict[str, str], dict[str, str]],
) -> None:
    one, two = (Manifest.from_json(files["model.json"], "m") for files in joints)
    here = make_settings(one, parameters={"r": 0.0147, "u_max": 4.2, "J_plant": 0.06})
    there = make_settings(two, parameters={"r": 14.7, "u_max": 4200, "J_plant": 600})
    assert np.array_equal(here.p, there.p)
    shown = two.written(two.stated(there.parameters))
    assert (shown["r"], shown["u_max"], shown["J_plant"], shown["J"]) == (14.7, 4200, 600, 500)
    for name, value in {"r": -3.0, "u_max": -40.0, "J_plant": -5.0}.items():
        with pytest.raises(UsageError, match=f"{name}: is {value:g}; allowed: a number greater than 0"):
            make_settings(two, parameters={name: value})


def test_the_derivation_is_printed_in_the_unit_of_the_file(lagged: Mapping[str, Any]) -> None:
    model = model_of(stated(lagged, {"r": {"value": 15, "unit": "mm"}}), "m.toml")
    text = text_report(model, derive(model).equations.values())
    assert any(line.startswith("r = 15.0 ") and line.endswith("[mm]") for line in text.splitlines())


SCALES = ("0.001", "0.0001", "1E+5", "6894.757293168361336722673443", "0.01745329251994329576923690768")


@given(value=st.floats(min_value=1e-200, max_value=1e200), scale=st.sampled_from((SI, *SCALES)))
def test_values_come_back_from_si_units_as_the_same_number(value: float, scale: str) -> None:
    si = to_si(value, scale)
    written = Fraction(repr(value)) * Fraction(scale)  # the decimal that stands in the file
    half = Fraction(math.ulp(si)) / 2
    assert abs(Fraction(si) - written) <= half * (1 + Fraction("1e-10"))  # one rounding, of 28 digits
    shown = from_si(si, scale)
    assert shown == pytest.approx(value, rel=1e-15)
    assert to_si(shown, scale) == si
    assert all_to_si(np.array([value, 1.0, value]), scale).tolist() == [si, to_si(1.0, scale), si]


@given(
    digits=st.integers(min_value=1, max_value=999_999),
    power=st.integers(min_value=-9, max_value=9),
    unit=st.sampled_from([("mm", -3), ("km", 3), ("um", -6), ("cm", -2)]),
)
def test_a_decimal_in_one_unit_is_the_decimal_in_the_other(
    digits: int, power: int, unit: tuple[str, int]
) -> None:
    scale = Scales("m").of(unit[0], "r", Wanted("m", "mm")) if not (digits % 50) else f"1e{unit[1]}"
    assert to_si(float(f"{digits}e{power}"), scale) == float(f"{digits}e{power + unit[1]}")


def test_units_of_the_si_need_no_pint(root: Path) -> None:
    """The shipped models, and coherent products in any order; another unit then says what to install."""
    program = """
import json, sys
sys.modules["pint"] = None
from pathlib import Path
from pmjoint_codegen.errors import MissingToolError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import parse_document, read_document
names = [model_of(read_document(p), str(p)).name for p in sorted(Path("models").glob("*.toml"))]
text = Path("models/joint.toml").read_text().replace('0.015,    unit = "m"', '15, unit = "mm"')
try:
    model_of(parse_document(text, "m.toml"), "m.toml")
except MissingToolError as error:
    print(json.dumps([names, str(error), error.exit_code]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, cwd=root
    )
    names, message, code = json.loads(done.stdout)
    assert len(names) == 9 and code == MissingToolError.exit_code
    assert message.startswith("m.toml: joint.r.unit: pint is needed to convert a unit")
    assert "pmjoint-codegen[derive]" in message


def test_labels_of_the_si_are_told_apart_by_their_dimension() -> None:
    scales = Scales("m.toml")
    assert scales.of("s N m", "b_v", Wanted("N m s/rad", "N mm s/rad")) == SI
    assert scales.of("kg m^2/s^2", "torque", ANY) == SI
    assert scales.of("kg m/s^2", "C4", Wanted("N", "kN")) == SI
    with pytest.raises(ModelError):
        scales.of("N m", "b_v", Wanted("N m s/rad", "N mm s/rad"))
