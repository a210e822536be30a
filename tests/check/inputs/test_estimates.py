"""Drawn parameters of a model with estimates: guesses and priors are inside ranges that are ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmjoint_codegen.check.inputs.points import parameter_values
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.manifest import Manifest


def ranged(manifest: Manifest, low: float, high: float, guess: float) -> Manifest:
    """Give b0 another range and guess."""
    own = {"b0_low": low, "b0_high": high, "b0_guess": guess, "b0_prior": guess}
    parameters = tuple(replace(item, value=own.get(item.name, item.value)) for item in manifest.parameters)
    return replace(manifest, parameters=parameters)


@pytest.mark.parametrize(
    ("low", "high", "guess"),
    [(83.0, 87.0, 85.0), (0.3, 1e6, 0.5), (-87.0, -83.0, -83.5), (0.3, 6.0, 1.2)],
    ids=["narrow", "wide", "negative", "the paper's"],
)
def test_drawn_guesses_are_inside_their_drawn_ranges(
    adaptive: Subject, low: float, high: float, guess: float
) -> None:
    manifest = ranged(adaptive.manifest, low, high, guess)
    values = parameter_values(manifest, 200, np.random.default_rng(1))
    p = {item.name: values[:, i] for i, item in enumerate(manifest.parameters)}
    for name in ("b0", "d1"):
        for inner in ("guess", "prior"):
            assert np.all(p[f"{name}_low"] < p[f"{name}_{inner}"])
            assert np.all(p[f"{name}_{inner}"] < p[f"{name}_high"])
    assert (p["b0_low"][0], p["b0_guess"][0], p["b0_high"][0]) == (low, guess, high)
    assert np.ptp(p["b0_guess"]) > 0.1 * abs(guess)
