"""`force`, `muscle1`, `muscle2`, `r1`, `r2` of `[joint]`: what they come to, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.force_laws import FORCE_LAWS
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_derive import Model
from pmjoint_derive import real_symbol as symbol

Edit = Callable[..., dict[str, Any]]
MODEL = Path(__file__).resolve().parents[2] / "models" / "joint-exact.toml"
WITHOUT_LAW = {f"joint.C{i}": None for i in range(1, 5)}
HUNT = {**WITHOUT_LAW, "joint.force": "hunt-20", "parameters.eps_max": {"value": 17.0, "unit": "%"}}


@pytest.fixture
def edited() -> Edit:
    """Make a copy of joint-exact with some keys set, or taken away by None."""
    document = read_document(MODEL)

    def edit(changes: dict[str, Any]) -> dict[str, Any]:
        copy = deepcopy(document)
        for path, value in changes.items():
            *tables, key = path.split(".")
            table = copy
            for name in tables:
                table = table.setdefault(name, {})
            table[key] = value
            if value is None:
                del table[key]
        return copy

    return edit


def values(model: Model) -> dict[str, float]:
    return {item.name: item.value for item in model.parameters}


def gain_at(model: Model, angle: float) -> float:
    """The design's input gain b0 sigma(y) at an angle, rad/(s^2 V)."""
    point: dict[sp.Symbol, float] = {item.symbol: item.value for item in model.parameters}
    point |= {item.symbol: float(item.expression.subs(point)) for item in model.constants}
    return float((model.plant.b[0] * model.plant.sigma).subs({symbol("y"): angle}).subs(point))


def test_a_law_adds_its_constants_as_parameters(edited: Edit) -> None:
    model = model_of(edited(HUNT), "m.toml")
    found = values(model)
    assert found["eps_max"] == 0.17 and found["F_max"] == 1500.0 and found["P_ref"] == 620e3
    assert "C1" not in found
    assert {item.name: item.unit for item in model.parameters}["P_ref"] == "Pa"


def test_a_file_s_line_replaces_a_law_s_value(edited: Edit) -> None:
    changes = {
        **HUNT,
        "parameters.P_ref": {"value": 6.0, "unit": "bar"},
        "parameters.F_max": {"value": 1400.0},
    }
    model = model_of(edited(changes), "m.toml")
    assert (values(model)["P_ref"], values(model)["F_max"]) == (6e5, 1400.0)
    assert {item.name: item.unit for item in model.parameters}["F_max"] == "N"


def test_own_values_are_parameters_of_their_own(edited: Edit) -> None:
    changes = {
        "joint.muscle1": {"C1": 0.009, "l0": {"value": 190.0, "unit": "mm"}},
        "joint.r2": {"value": 14.0, "unit": "mm"},
        "joint.r1": "0.015 + 0.002*sin(theta)",
        "joint.r": None,
    }
    model = model_of(edited(changes), "m.toml")
    found = values(model)
    assert found["C1_muscle1"] == 0.009 and found["l0_muscle1"] == 0.19 and found["r_muscle2"] == 0.014
    assert "r" not in found and "r_muscle1" not in found


def test_a_value_of_each_muscle_needs_none_of_both(edited: Edit) -> None:
    own = {"C1": 8.032e-3}
    model = model_of(edited({"joint.C1": None, "joint.muscle1": own, "joint.muscle2": own}), "m.toml")
    assert "C1" not in values(model)
    assert gain_at(model, 0.4) == pytest.approx(gain_at(model_of(edited({}), "m.toml"), 0.4), rel=1e-12)


def test_unequal_muscles_in_numbers(edited: Edit) -> None:
    """The gain of an unequal pair, typed by hand."""
    changes = {"joint.muscle2": {"C1": 0.01, "eps0": 0.13, "l0": 0.2}, "joint.r2": 0.013}
    n = values(model_of(edited(changes), "m.toml"))

    def gain(theta: float) -> float:
        first = n["eps0"] + n["r"] * theta / n["l0"]
        second = 0.13 - 0.013 * theta / 0.2
        of_first = n["r"] * (n["C1"] * first**2 + n["C2"] * first + n["C3"])
        return float(n["k_u"] / n["J"] * (of_first + 0.013 * (0.01 * second**2 + n["C2"] * second + n["C3"])))

    model = model_of(edited({**changes, "joint.keep": ["damping", "gain"]}), "m.toml")
    for theta in (-0.7, 0.0, 0.9):
        assert gain_at(model, theta) == pytest.approx(gain(theta), rel=1e-12)


def test_forces_are_reported_unless_the_muscles_are_the_paper_s(edited: Edit) -> None:
    assert not {"F1", "F2"} & {item.name for item in model_of(edited({}), "m.toml").reported}
    assert not {"F1", "F2"} & {
        item.name for item in model_of(edited({"joint.force": "paper"}), "m.toml").reported
    }
    assert {"F1", "F2"} <= {item.name for item in model_of(edited(HUNT), "m.toml").reported}


def test_the_paper_s_law_by_name_is_the_same_model(edited: Edit) -> None:
    assert model_of(edited({"joint.force": "paper"}), "m.toml") == model_of(edited({}), "m.toml")


def test_lengths_of_each_muscle_are_demanded_positive(edited: Edit) -> None:
    model = model_of(edited({"joint.muscle1": {"l0": 0.2}, "joint.r1": 0.014}), "m.toml")
    names = {str(item.parameter) for item in model.demands}
    assert {"r", "l0", "l0_muscle1", "r_muscle1"} <= names
    model = model_of(edited({"joint.r": None, "joint.r1": "0.015", "joint.r2": 0.014}), "m.toml")
    assert {str(item.parameter) for item in model.demands} & {"r", "r_muscle1", "r_muscle2"} == {"r_muscle2"}


MISTAKES = [
    ({"joint.C1": None}, "joint.C1: is missing; allowed: a number, or a line"),
    ({"joint.r": None}, "joint.r: is missing; allowed: a number"),
    ({"joint.r": None, "joint.r1": 0.01}, "joint.r: is missing"),
    (
        {"joint.force": "hunt-30"},
        "joint.force: 'hunt-30' is no law of force, nor an expression of the pressure P",
    ),
    ({"joint.force": "hunt20"}, "did you mean 'hunt-20'? allowed: paper, chou-hannaford"),
    (HUNT, "joint.C1: is used by neither muscle: force does not contain it; drop it", {"joint.C1": 0.1}),
    (
        {**WITHOUT_LAW, "joint.force": "hunt-20"},
        "parameters.eps_max: is missing: force = 'hunt-20' needs it, contraction without load at P_ref; "
        'write eps_max = { value = ..., unit = "1" }',
    ),
    (
        {"joint.force": "C3*P + C1*P**2*eps + C2 + C4"},
        "joint.force: is not affine in P: the term C1*P**2*eps is not; linearise it about the base pressure",
    ),
    (
        {"joint.force": "C3*P + C1 + C2 + C4 + q*eps"},
        "joint.force: 'C3*P + C1 + C2 + C4 + q*eps': unknown symbol 'q'",
    ),
    ({"joint.force": "abs(P)*C1*C2*C3*C4"}, "joint.force: 'abs(P)*C1*C2*C3*C4': abs has a kink"),
    (
        {"joint.muscle1": {"C5": 1.0}},
        "joint.muscle1.C5: is no quantity of this muscle; allowed: C1, C2, C3, C4, eps0, l0",
    ),
    ({"joint.muscle1": {"r": 1.0}}, "joint.muscle1.r: is no quantity of this muscle; give r1 in [joint]"),
    ({"joint.muscle2": {"J": 1.0}}, "joint.muscle2.J: is no quantity of this muscle"),
    (
        {"joint.muscle1": {"l0": {"value": 1.0, "unit": "kg"}}},
        "joint.muscle1.l0.unit: 'kg' does not convert to m",
    ),
    ({"joint.muscle1": {"l0": -0.1}}, "joint.muscle1.l0: is -0.1; allowed: a number greater than 0"),
    ({"joint.r1": -0.1}, "joint.r1: is -0.1; allowed: a number greater than 0"),
    ({"joint.muscle1": {"l0": "long"}}, "joint.muscle1.l0: is the text 'long'; allowed: a table of"),
    (
        {"joint.r1": {"value": 1.0, "units": "m"}},
        "joint.r1.units: unknown key; did you mean 'unit'? allowed: value, unit, about",
    ),
    (
        {"joint.l0": {"value": 185.0, "unit": "mm"}, "joint.muscle1": {"l0": 190.0}},
        "joint.muscle1.l0: has no unit, and l0 of both muscles is in mm; "
        'write l0 = { value = 190, unit = "mm" }',
    ),
    (
        {**HUNT, "joint.muscle1": {"eps_max": 0.16}},
        "joint.muscle1.eps_max: has no unit, and eps_max of both muscles is in %",
    ),
    (
        {"joint.C1": None, "joint.muscle1": {"C1": 1.0}},
        "joint.C1: is missing",
    ),
    (
        {
            **WITHOUT_LAW,
            "joint.force": "A*P*(1 - eps)",
            "joint.muscle1": {"A": 1.0},
        },
        "joint.muscle1.A: is given, but muscle 2 has no A; give it in muscle2 too, or A of both",
    ),
    (
        {"joint.muscle1": {"C1": 1.0}, "joint.muscle2": {"C1": 1.0}},
        "joint.C1: is used by neither muscle: each has its own; drop it",
    ),
    ({"joint.r1": 0.01, "joint.r2": 0.02}, "joint.r: is used by neither muscle: each has its own; drop it"),
    (
        {"joint.r1": "sin(theta)/(1 + theta**2)/100"},
        "joint.r1: the integral of sin(theta)/(100*(theta**2 + 1)) over theta, which the contraction ",
    ),
    ({"joint.r1": "0.01*abs(theta)"}, "joint.r1: '0.01*abs(theta)': abs has a kink"),
    ({"joint.r1": "0.01*sqrt(theta*theta)"}, "abs has a kink"),
    ({"joint.r1": "0.01*y"}, "joint.r1: '0.01*y': unknown symbol 'y'"),
    ({**HUNT, "parameters.P": {"value": 1.0}}, "parameters.P: already names a quantity of the muscles"),
    ({**HUNT, "parameters.F1": {"value": 1.0}}, "parameters.F1: already names a quantity of the muscles"),
    (
        {"joint.muscle1": {"l0": 0.2}, "parameters.l0_muscle1": {"value": 1.0}},
        "joint.muscle1.l0: its parameter l0_muscle1 is in [parameters] too; choose another name",
    ),
    (
        {**HUNT, "parameters.P_ref": {"value": 1.0, "unit": "m"}},
        "parameters.P_ref.unit: 'm' does not convert to Pa",
    ),
    (
        {"joint.muscle2": {"C1": -0.1}, "joint.keep": ["gain"], "joint.range": [-1.0, 1.0]},
        "plant.sigma: sigma vanishes, or is not finite, near y = ",
    ),
]


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: str(mistake[1])[:60])
def test_mistakes_are_one_line(edited: Edit, mistake: tuple[Any, ...]) -> None:
    changes, message, *more = mistake
    with pytest.raises(ModelError) as caught:
        model_of(edited({**changes, **(more[0] if more else {})}), "m.toml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [name for name in FORCE_LAWS if name != "paper"])
def test_each_law_makes_a_joint(edited: Edit, name: str) -> None:
    usual = {"F_max": 500.0, "eps_max": 0.2, "D0": 0.02, "alpha0": 0.4, "k_end": 1.1}
    if name == "hunt":
        usual |= {"a0": 0.26, "a1": 6.5, "a3": 1.3}
    if name == "sarosi":
        usual |= {"a1": -4e-5, "a2": 290.0, "a3": -33.0, "a4": -9.3e-3, "a5": 2.9e-3, "a6": -280.0}
    needed = {key for key, item in FORCE_LAWS[name].constants.items() if item.value is None}
    changes: dict[str, Any] = {**WITHOUT_LAW, "joint.force": name}
    changes |= {f"parameters.{key}": {"value": usual[key]} for key in needed}
    assert gain_at(model_of(edited(changes), "m.toml"), 0.1) > 0
