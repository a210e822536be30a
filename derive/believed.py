"""The plant as the controller takes it: guesses and estimates in the places of what it does not know."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.model import Plant


def believed_plant(plant: Plant, adaptation: Adaptation | None) -> Plant:
    """The plant with ``b0_hat`` where b_0 is estimated and ``b0_guess`` where it is guessed for good.

    Args:
        plant: the true one.
        adaptation: None: all is known.
    """
    if adaptation is None:
        return plant
    Theta: list[sp.Expr] = [*plant.b, *plant.theta]
    for entry in adaptation.entries:
        Theta[entry.place] = entry.estimate if entry.unknown else entry.guess_symbol
    count = len(plant.b)
    return replace(plant, b=tuple(Theta[:count]), theta=tuple(Theta[count:]))
