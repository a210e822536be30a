"""The plant of the exported example: the design's, or, where that has guesses and estimates, the true one."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive import Derivation
from pmjoint_derive.model import Plant


def example_plant(derivation: Derivation) -> Plant:
    """The plant that the controller was designed for; with true values in place of guesses and estimates."""
    design = derivation.design
    return design.plant if design.adaptation is None else design.truth


def in_numbers(derivation: Derivation, value: sp.Expr) -> sp.Expr:
    """An expression of y, u, t and x with the model's numbers in place of its parameters.

    Args:
        derivation: of the model.
        value: of the plant or the reference.
    """
    d, s = derivation, derivation.signals
    numbers = {item.symbol: sp.Float(item.value) for item in d.model.parameters}
    numbers |= {own: numbers[symbol] for symbol, own in d.own_parameters.items()}
    whole = d.equations.expand(value, keep=frozenset({s.y, s.u, s.t, *s.x}))
    return whole.xreplace(numbers)
