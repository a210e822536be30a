"""Integrals of moment arms: against quadrature, and the refusal of what has no closed form."""

from __future__ import annotations

import mpmath
import pytest
import sympy as sp

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive import arm as arm_module
from pmjoint_derive.arm import travel
from pmjoint_derive.muscle import ANGLE

a, b, alpha = (real_symbol(name) for name in ("a1", "b1", "alpha0"))
TRIANGLE = a * b * sp.sin(ANGLE + alpha) / sp.sqrt(a**2 + b**2 - 2 * a * b * sp.cos(ANGLE + alpha))
ARMS = [
    a,
    a + b * ANGLE - ANGLE**3,
    a * sp.cos(b * ANGLE),
    a * sp.exp(-b * ANGLE),
    a / (1 + ANGLE**2),
    a * sp.tanh(ANGLE) + b,
    a * sp.cos(ANGLE) ** 3,
    a * sp.atan(b * ANGLE),
    a / (b**2 + ANGLE**2),
    TRIANGLE,
]


@pytest.mark.parametrize("values", [(0.7, 1.3), (0.7, -1.3), (-1.9, 0.4)])
@pytest.mark.parametrize("arm", ARMS, ids=str)
def test_travel_is_the_integral(arm: sp.Expr, values: tuple[float, float]) -> None:
    """For parameters of either sign."""
    point = {a: values[0], b: values[1], alpha: 1.1}
    of_angle = sp.lambdify(ANGLE, arm.subs(point), "mpmath")
    found = travel(arm, "joint.r1").subs(point)
    for angle in (-0.8, 0.3, 1.0):
        assert float(found.subs({ANGLE: angle})) == pytest.approx(
            float(mpmath.quad(of_angle, [0, angle])), rel=1e-12, abs=1e-14
        )


@pytest.mark.parametrize(
    "arm", [sp.sin(ANGLE) / (1 + ANGLE**2), a * sp.exp(-(ANGLE**2)), sp.sqrt(2 - ANGLE**2), ANGLE**a]
)
def test_an_arm_without_a_closed_integral_is_refused(arm: sp.Expr) -> None:
    with pytest.raises(OutsideClassError, match=r"joint\.r2: the integral of .* is not known in closed form"):
        travel(arm, "joint.r2")


def test_a_wrong_integral_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """SymPy's rules are trusted as far as they pass the test of differentiation."""
    monkeypatch.setattr(arm_module, "manualintegrate", lambda arm, angle: arm * angle)
    with pytest.raises(OutsideClassError, match="closed form"):
        travel(a * sp.cos(ANGLE), "joint.r1")
