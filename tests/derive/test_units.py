"""Units label signals; their algebra must not mislabel."""

from __future__ import annotations

import pytest

from derive import Derivation, parameter_symbol
from derive.units import SECOND, Unit, parse_unit


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
        name: str(paper.units.of(parameter_symbol(name)))
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
