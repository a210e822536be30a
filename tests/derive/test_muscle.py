"""Torque of the muscles on the joint, against (2), (3) typed once more in numbers."""

from __future__ import annotations

import pytest

from pmjoint_derive import real_symbol
from pmjoint_derive.muscle import paper_pair

NUMBERS = {"l0": 0.185, "eps0": 0.15, "C1": 8.032e-3, "C2": -1.285e-2, "C3": 3.2e-3, "C4": 7.0}


@pytest.mark.parametrize("theta", [-0.4, 0.0, 0.7])
def test_the_paper_pair_pulls_both_ways(theta: float) -> None:
    """Muscle 1 shortens and pulls up as theta grows; muscle 2 the other way."""
    values = {real_symbol(name): value for name, value in NUMBERS.items()}
    values |= {real_symbol("theta"): theta, real_symbol("r"): 0.015}
    for pull, side, pressure in zip(paper_pair(), (1, -1), (2e5, 3e5), strict=True):
        eps = 0.15 + side * 0.015 * theta / 0.185
        force = pressure * (8.032e-3 * eps**2 - 1.285e-2 * eps + 3.2e-3) + 7.0
        assert float(pull.torque(pressure).subs(values)) == pytest.approx(side * 0.015 * force, rel=1e-12)
