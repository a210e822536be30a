"""With right estimates at rest the adaptive law is the known one.

Gains and leakage are 0, and the compensator's states are r_1 = chi_1, r_i = b_m chi_i.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mpmath
import pytest

from pmjoint_derive import Derivation, Model, derive
from tests.derive.adaptive_models import adaptive, shipped, shipped_files
from tests.derive.adaptive_numbers import Numbers, drawn

DIGITS, CLOSE = 60, "1e-50"


@pytest.mark.parametrize("path", shipped_files(), ids=lambda path: path.stem)
def test_the_law_of_right_estimates_at_rest_is_the_known_one(path: Path) -> None:
    model = replace(shipped(path), adaptation=None, design="backstepping")
    same_law(derive(model), derive(adaptive(model)))


@pytest.mark.parametrize("order", [(1, 1), (2, 1), (3, 2), (3, 3)])
@pytest.mark.parametrize("variant", ["ranged", "inverse", "squares"])
def test_so_it_is_in_every_form(builder: Callable[..., Model], order: tuple[int, int], variant: str) -> None:
    if variant == "squares" and order[1] > 2:
        pytest.skip("least squares has no law beyond relative degree 2")
    model = builder(*order)
    chosen: dict[str, Any] = {variant: True}
    same_law(derive(model), derive(adaptive(model, **chosen)))


def same_law(first: Derivation, second: Derivation) -> None:
    """Compare v of both at random points, to the digits that are computed with."""
    numbers, others = Numbers.of(first), Numbers.of(second)
    with mpmath.workdps(DIGITS):
        for seed in range(2):
            point = in_reach(first, seed)
            expected = numbers.at(point)["v"]
            found = others.at(at_rest(second, point, seed))["v"]
            assert expected != 0
            assert abs(found - expected) < mpmath.mpf(CLOSE) * (1 + abs(expected))


def in_reach(derivation: Derivation, seed: int) -> dict[str, Any]:
    """Draw a point with y near its start, where the model's functions of y have values."""
    draw, s, model = random.Random(seed), derivation.signals, derivation.model
    point = drawn(derivation, seed)
    gains = derivation.gain_values
    point |= {symbol.name: mpmath.mpf(value) for symbol, value in gains.items()}
    point |= {symbol.name: mpmath.mpf(draw.randint(-99, 99)) / 100 for symbol in s.y_r}
    low, high = model.y_range or (-0.5, 0.5)
    point[s.x[0].name] = mpmath.mpf(low + (high - low) * draw.randint(200, 800) / 1000)
    return point


def at_rest(derivation: Derivation, point: dict[str, Any], seed: int) -> dict[str, Any]:
    """Return the same point for the adaptive design, its estimates right and their gains 0."""
    s, truth, adaptation = derivation.signals, derivation.design.truth, derivation.model.adaptation
    assert adaptation is not None
    found = {**drawn(derivation, seed), **point}
    values = Numbers.of(derivation).at(found)
    for entry in adaptation.unknown:
        value = (*truth.b, *truth.theta)[entry.place]
        true = values[value.name] if value.is_Symbol else mpmath.mpf(int(value.p)) / int(value.q)
        found |= {entry.estimate.name: true, entry.gamma.name: mpmath.mpf(0)}
        if entry.place == 0:
            found |= {"rho_hat": 1 / true} if s.inverse else {}
            found |= {chi.name: found[f"r{i}"] / (true if i > 1 else 1) for i, chi in enumerate(s.r, start=1)}
    return found | dict.fromkeys(("leakage", "rho_leakage", "gamma_rho", "ls_kappa"), mpmath.mpf(0))
