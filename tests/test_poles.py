"""Poles as text: rounding does not show, and nothing distinct is merged."""

from __future__ import annotations

import numpy as np
import pytest

from pmjoint_codegen.poles import poles_text
from pmjoint_codegen.values import roots_text


@pytest.mark.parametrize(
    ("poles", "shown"),
    [
        ([-20, -20], "-20 (twice)"),
        ([-250, -250, -250], "-250 (3 times)"),
        ([-40] * 7, "-40 (7 times)"),
        ([-5, 0, 0], "-5, 0 (twice)"),
        ([-3 - 1j, -3 - 1j, -3 + 1j, -3 + 1j], "-3-1j (twice), -3+1j (twice)"),
        ([-20.001, -20], "-20.001, -20"),
        ([-1000, -0.002, -0.001], "-1000, -0.002, -0.001"),
    ],
)
def test_rounding_does_not_split_a_multiple_root(poles: list[complex], shown: str) -> None:
    assert roots_text(np.poly(poles).real.tolist()) == shown


def test_poles_that_overflow_are_shown() -> None:
    assert poles_text([np.inf, -1.0]) == "inf, -1"
