"""Units label signals; their algebra must not mislabel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from pmjoint_derive import Derivation, Model, derive, real_symbol
from pmjoint_derive.units import SECOND, Unit, parse_unit


@pytest.mark.parametrize(
    ("text", "powers"),
    [
        ("rad/(s^2 V)", {"rad": 1, "s": -2, "V": -1}),
        ("1/s", {"s": -1}),
        ("", {}),
        ("1", {}),
        ("N m s/rad", {"N": 1, "m": 1, "s": 1, "rad": -1}),
        ("kg m^2", {"kg": 1, "m": 2}),
        ("1/(s/V)", {"s": -1, "V": 1}),
        ("m/s/s", {"m": 1, "s": -2}),
    ],
)
def test_reading(text: str, powers: dict[str, int]) -> None:
    assert dict(parse_unit(text).powers) == powers


@pytest.mark.parametrize("text", ["50 % of full scale", "(s", "s)", "^2", "V?"])
def test_what_is_not_understood_is_kept_whole(text: str) -> None:
    assert str(parse_unit(text)) == text


@pytest.mark.parametrize("text", ["rad/(s^2 V)", "1/s", "1", "N m s/rad", "V s"])
def test_writing_is_the_inverse_of_reading(text: str) -> None:
    assert str(parse_unit(text)) == text


def test_algebra() -> None:
    volt = Unit({"V": 1})
    assert str(volt * SECOND / volt) == "s"
    assert parse_unit("V/V") == Unit({})


def test_the_paper_s_signals(paper: Derivation) -> None:
    units = {
        name: str(paper.units.of(real_symbol(name)))
        for name in ("xi2", "Xi21", "lambda2", "z2", "c1", "e2", "k2", "r2")
    }
    assert units == {
        "xi2": "rad/s",
        "Xi21": "rad s",
        "lambda2": "V s",
        "z2": "V s",
        "c1": "1/s",
        "e2": "rad^2/(V^2 s^3)",
        "k2": "1/s^2",
        "r2": "rad/s",
    }
    assert str(paper.equations["v"].unit) == "V"
    assert str(paper.equations["dalpha1_dy"].unit) == "V s/rad"


def test_a_composite_input_coefficient_has_the_unit_of_its_place(builder: Callable[..., Model]) -> None:
    """``b_j u`` is a part of the rate of ``x_{n-j}``, whatever b_j is made of."""
    model, b0, d1 = builder(3, 2), real_symbol("b0"), real_symbol("d1")
    plant = replace(model.plant, b=(2 * b0, 3 * b0), theta=(d1, 2 * d1))
    found = derive(replace(model, plant=plant))
    u = found.units.of(found.signals.u)
    for name, state in (
        ("b_1", "x2_dot"),
        ("b_0", "x3_dot"),
        ("b_1_plant", "x2_dot"),
        ("b_0_plant", "x3_dot"),
    ):
        unit, rate = (found.equations[key].unit for key in (name, state))
        assert unit is not None
        assert rate is not None
        assert (unit * u).powers == rate.powers
    assert str(found.equations["b_0"].unit) == "rad/(s^3 V)"
    assert found.equations["theta_2"].unit is None  # nobody knows the unit of its function of y
    assert {found.equations[name].number for name in ("b_1", "b_0", "theta_2")} == {""}  # not (8)
