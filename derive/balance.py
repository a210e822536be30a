"""The balance of torques on the joint, (1) with further terms, and what is read off it.

Held symbolically: ``J theta'' = -b_v theta' + pull_1(P_1) + pull_2(P_2) + torque(theta) + friction(theta') +
vartheta(theta, theta', t)``, each pull affine in its pressure. At ``P_{1,2} = P_0 +- k_u u`` the pulls are
``J (S(theta) + gain(theta) u)``: stiffness and input gain of the joint.

For the paper's pair S = d1 theta and gain = b0 (1 + kappa theta^2). The coefficients are (5)-(8), corrected:
no second k0 in the input gain, the term in theta^2 u kept, vartheta divided by J.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import sympy as sp

from pmjoint_derive.equation import real_symbol
from pmjoint_derive.muscle import ANGLE, Pair, paper_pair

THETA = ANGLE
OMEGA, U = (real_symbol(name) for name in ("theta_dot", "u"))
J, B_V, K_U = (real_symbol(name) for name in ("J", "b_v", "k_u"))
_ZERO = sp.Integer(0)
_PAPER = ((1, 0), (0, 1), (2, 1))  # exponents of theta and u in the paper's S + gain u: d1, b0, b0 kappa


def base_pressure() -> sp.Expr:
    """``P_0 = k_0 u_0`` of (4)."""
    return real_symbol("k0") * real_symbol("u0")


@dataclass(frozen=True)
class Balance:
    """What turns the joint, in N m, beside its damping.

    Attributes:
        muscles: the pulls of muscle 1, which opens theta, and muscle 2.
        torque: of the position, a smooth function of theta and parameters: gravity, springs.
        friction: a function of theta_dot and parameters, beside b_v.
        disturbance: vartheta, a function of theta, theta_dot, t and parameters.
    """

    muscles: Pair = field(default_factory=paper_pair)
    torque: sp.Expr = _ZERO
    friction: sp.Expr = _ZERO
    disturbance: sp.Expr = _ZERO

    @property
    def stiffness(self) -> sp.Expr:
        """``S(theta)`` of the muscles at P_0, without `torque`, rad/s^2."""
        return sum((pull.torque(base_pressure()) for pull in self.muscles), _ZERO) / J

    @property
    def gain(self) -> sp.Expr:
        """Input gain at theta, rad/(s^2 V)."""
        return K_U * self.pressed(sp.Integer(1), sp.Integer(1))

    def pressed(self, first: sp.Expr, second: sp.Expr) -> sp.Expr:
        """Acceleration by the pressures' distances ``P_1 - P_0`` and ``P_0 - P_2``, linear in both."""
        pull1, pull2 = self.muscles
        return (pull1.gain * first - pull2.gain * second) / J

    def acceleration(self, first: sp.Expr, second: sp.Expr) -> sp.Expr:
        """``theta''`` for given muscle pressures."""
        pull1, pull2 = self.muscles
        further = self.torque + self.friction + self.disturbance
        return (-B_V * OMEGA + pull1.torque(first) + pull2.torque(second) + further) / J


def coefficients(muscles: Pair) -> Mapping[str, sp.Expr]:
    """Constants that name parts of a balance: the damping ``a``, ``b0`` and, of the paper's form, more.

    The paper's form has the stiffness ``d1`` and the quadratic gain ``kappa``. Of any other pair ``b0`` is
    the gain at theta = 0.
    """
    balance = Balance(muscles)
    found = _paper_form(balance) or {"b0": balance.gain.xreplace({THETA: _ZERO})}
    return {**found, "a": B_V / J}


def varies(balance: Balance) -> bool:
    """Whether the input gain depends on theta."""
    return bool(sp.expand(sp.diff(balance.gain, THETA)) != 0)


def _paper_form(balance: Balance) -> dict[str, sp.Expr] | None:
    """``d1``, ``b0`` and ``kappa``, if ``S = d1 theta`` and ``gain = b0 (1 + kappa theta^2)``; else None."""
    whole = balance.stiffness + balance.gain * U
    if not whole.is_polynomial(THETA):
        return None
    terms = {monomial: sp.factor(value) for monomial, value in sp.Poly(whole, THETA, U).terms()}
    if terms.keys() != set(_PAPER):
        return None
    stiffness, gain, quadratic = (terms[monomial] for monomial in _PAPER)
    return {"d1": stiffness, "b0": gain, "kappa": sp.factor(quadratic / gain)}
