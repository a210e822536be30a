"""What is outside the class is refused with key, reason and remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import sympy as sp

from pmjoint_derive import Model, OutsideClassError, real_symbol

S = real_symbol


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"b": (sp.Integer(0),)}, "plant.b"),
        ({"b": (S("d1") - S("d1"), sp.Integer(1))}, "plant.b"),
        ({"b": ()}, "plant.b"),
        ({"b": (sp.Integer(1),) * 3}, "plant.b"),
        ({"sigma": sp.Integer(0)}, "plant.sigma"),
        ({"sigma": S("x2")}, "plant.sigma"),
        ({"phi": (S("x2"), sp.Integer(0))}, "plant.phi"),
        ({"phi": (S("t"), sp.Integer(0))}, "plant.phi"),
        ({"phi": (sp.Integer(0),)}, "plant.phi"),
        ({"Phi": ((S("x1"),), (S("y"),)), "theta": (S("d1"),)}, "plant.Phi"),
        ({"Phi": ((S("y"), S("y")), (S("y"),)), "theta": (S("d1"),)}, "plant.Phi"),
        ({"theta": (S("y"), S("d1"))}, "plant.theta"),
        ({"b": (S("y"),)}, "plant.b"),
        ({"disturbance": (sp.Integer(0),)}, "plant.disturbance"),
    ],
)
def test_refusals(builder: Callable[..., Model], change: dict[str, Any], key: str) -> None:
    plant = builder(2, 2).plant
    with pytest.raises(OutsideClassError) as caught:
        replace(plant, **change)
    assert caught.value.key == key
    assert caught.value.what and caught.value.remedy


def test_relative_degree_and_input_vector(builder: Callable[..., Model]) -> None:
    plant = builder(4, 3).plant
    assert (plant.rho, plant.m, plant.p) == (3, 1, 2)
    assert plant.b_vector == (0, 0, S("b0"), 2)
