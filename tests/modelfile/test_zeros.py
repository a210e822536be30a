"""Zeros in a range: found where they are, excluded where they are not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import pytest
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile import model_of, zeros
from pmjoint_codegen.modelfile.zeros import find_zero
from pmjoint_codegen.operations import functions
from pmjoint_derive import real_symbol

Edit = Callable[..., dict[str, Any]]
Y, A = real_symbol("y"), real_symbol("a")


@pytest.mark.parametrize(
    ("expression", "place"),
    [
        (1 - Y, 1.0),
        (Y**2, 0.0),
        (sp.cos(Y), 1.5707963),
        ((Y - sp.Rational(1, 3)) ** 2, 1 / 3),  # touches 0 without a change of sign
        (A * Y**2 + 1, 0.70710678),
        (sp.exp(-(Y**2)) - sp.Rational(1, 2), 0.83255461),
        (sp.tanh(Y) - sp.Rational(1, 2), 0.54930614),
        (sp.atan(Y) - sp.Rational(1, 2), 0.54630249),
        (sp.sinh(Y) + sp.Rational(1, 2), -0.48121183),
        (sp.cosh(Y) - sp.Rational(3, 2), 0.96242365),
        (sp.sqrt(Y + 3) - 2, 1.0),
        (sp.log(Y + 3), -2.0),
        (1 / Y, 0.0),  # not finite
    ],
    ids=str,
)
def test_zeros_are_found(expression: sp.Expr, place: float) -> None:
    found = find_zero(expression, Y, {A: -2.0}, -2.0, 2.0)
    assert found is not None
    assert min(abs(found - place), abs(found + place)) < 1e-6


@pytest.mark.parametrize(
    "expression",
    [
        sp.Integer(1),
        1 + Y**2 / 10,
        sp.Rational(21, 10) - Y,
        sp.cos(Y / 2),
        1 + sp.sin(3 * Y) / 2,
        sp.exp(Y) - sp.Rational(1, 8),
        sp.sqrt(Y + 3),
        sp.tanh(Y) + 2,
        sp.atan(Y) + 2,
        sp.cosh(Y) - sp.Rational(9, 10),
        sp.sinh(Y) + 4,
        (Y + 3) ** sp.Rational(5, 2),
        1 - A * Y**2,
        1 / (1 + Y**2),
        Y**2 + sp.Rational(1, 10**6),  # nearly touches 0
        sp.pi - Y,
    ],
    ids=str,
)
def test_no_zero_is_proved(expression: sp.Expr) -> None:
    assert find_zero(expression, Y, {A: -2.0}, -2.0, 2.0) is None


def test_a_model_whose_sigma_vanishes_in_its_range_is_refused(edited: Edit) -> None:
    changes = {"plant.sigma": "1 - y**2/4", "simulation.x0": [0.5, 0.0]}
    assert model_of(edited({**changes, "plant.range": [-1.9, 1.9]}), "m").y_range == (-1.9, 1.9)
    with pytest.raises(
        ModelError, match=r"m: plant\.sigma: sigma vanishes.* y = -2, within the range -2\.1 to"
    ):
        model_of(edited({**changes, "plant.range": [-2.1, 1.9]}), "m")


@pytest.mark.parametrize("bad", [[1, -1], [1, 1], [1], "all"])
def test_a_range_is_two_numbers_in_order(edited: Edit, bad: object) -> None:
    with pytest.raises(ModelError, match=r"m: plant\.range"):
        model_of(edited({"plant.range": bad}), "m")


@pytest.mark.parametrize("name", functions())
@pytest.mark.parametrize(("low", "high"), [(0.25, 0.75), (0.5, 1.25), (1.0, 1.0)])
def test_the_image_of_an_interval_holds_the_values_in_it_and_little_more(
    name: str, low: float, high: float
) -> None:
    context = mpmath.ctx_iv.MPIntervalContext()
    context.dps = 30
    image = zeros._image(getattr(sp, name)(Y), {Y: (low, high)}, context)
    places = [low + (high - low) * i / 50 for i in range(51)]
    with mpmath.workdps(40):
        values = [getattr(mpmath, name)(place) for place in places]
        ends = [mpmath.mpf(end.mid) for end in (image.a, image.b)]
        assert ends[0] <= min(values) and max(values) <= ends[1]
        assert ends[1] - ends[0] <= 3 * (max(values) - min(values)) + mpmath.mpf(10) ** -25
