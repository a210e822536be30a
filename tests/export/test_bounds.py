"""Bounds on rounding errors of single operations, against many digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from pmjoint_codegen.export.bounds import ULPS, Bounded, bounded_operations
from pmjoint_codegen.export.tree import DOUBLE, FLOAT, Precision


@pytest.mark.parametrize("precision", [DOUBLE, FLOAT], ids=["double", "float"])
@pytest.mark.parametrize("value", [0.0, 0.3, -1.5, 8.0, -30.0, 700.0, 1e6])
@pytest.mark.parametrize("error", [0.0, 1e-9, 0.2, 5.0, 1e5])
def test_tanh_of_a_rounded_number_is_within_its_bound_and_flat_far_out(
    precision: Precision, value: float, error: float
) -> None:
    """What an estimate is made of: a logit far out has an error of its own, and hardly passes it on."""
    found = bounded_operations(precision)["tanh"](Bounded(value, error))
    with mpmath.workdps(60):
        exact = [mpmath.tanh(mpmath.mpf(value) + share * mpmath.mpf(error)) for share in (-1, -0.5, 0.5, 1)]
        worst = max(abs(mpmath.mpf(float(found.value)) - item) for item in exact)
    assert worst <= found.error
    own = 2.0 * ULPS * precision.roundoff * (1.0 + 2.0 * worst) + precision.smallest
    assert found.error <= 2.001  # the distance of its ends
    if abs(value) > 40.0 + error:
        assert found.error <= 1.001 * own


def test_it_is_so_of_arrays_too() -> None:
    tanh = bounded_operations(FLOAT)["tanh"]
    found = tanh(Bounded(np.array([0.1, 50.0]), np.array([0.01, 1.0])))
    assert found.error[0] > 0.009 and found.error[1] < 1e-6
