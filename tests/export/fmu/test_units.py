"""Units in SI base units."""

from __future__ import annotations

import math

import pytest

from pmjoint_codegen.export.fmu.units import Declared, Units


@pytest.fixture(scope="module")
def known() -> Units:
    """Return the table, loaded once."""
    return Units()


@pytest.mark.parametrize(
    ("label", "exponents", "factor"),
    [
        ("rad/(s^2 V)", {"kg": -1, "m": -2, "s": 1, "A": 1, "rad": 1}, 1.0),
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1.0),
        ("Pa/V", {"m": -3, "s": 1, "A": 1}, 1.0),
        ("mm", {"m": 1}, 1e-3),
        ("deg/s", {"s": -1, "rad": 1}, math.pi / 180),
        ("bar", {"kg": 1, "m": -1, "s": -2}, 1e5),
    ],
)
def test_a_unit_is_a_product_of_base_units(
    known: Units, label: str, exponents: dict[str, int], factor: float
) -> None:
    found = known.of(label)
    assert found is not None and found.exponents is not None
    assert dict(found.exponents) == exponents
    assert found.factor == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize("label", ["", "1"])
def test_a_plain_number_has_none(known: Units, label: str) -> None:
    assert known.of(label) is None


@pytest.mark.parametrize("label", ["furlongs per cat", "blah", "degC"])
def test_a_label_without_a_meaning_stays_a_label(known: Units, label: str) -> None:
    assert known.of(label) == Declared(label)


def test_a_value_in_si_units_is_shown_in_the_files_unit(known: Units) -> None:
    found = known.of("mH", "0.001")
    assert found == Declared(
        "kg.m2.s-2.A-2", (("kg", 1), ("m", 2), ("s", -2), ("A", -2)), 1.0, ("mH", 1000.0)
    )
