"""One muscle's torque on the joint, affine in its pressure; and the paper's pair (2), (3).

The reduction in `pmjoint_derive.joint` reads pairs of this record only, so that another law of force, unequal
muscles or moment arms that vary with the angle change nothing there.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.equation import real_symbol

ANGLE = real_symbol("theta")


@dataclass(frozen=True)
class Pull:
    """Torque of one muscle on the joint, ``gain(theta) P + passive(theta)`` in N m; positive opens theta.

    Attributes:
        gain: torque per pressure, N m/Pa, a function of theta and parameters.
        passive: torque without pressure, N m, a function of theta and parameters.
    """

    gain: sp.Expr
    passive: sp.Expr

    def torque(self, pressure: sp.Expr) -> sp.Expr:
        """The torque at a pressure in Pa, N m."""
        return self.gain * pressure + self.passive


Pair = tuple[Pull, Pull]  # muscle 1 pulls theta up, muscle 2 down


def paper_pair() -> Pair:
    """The two muscles of (2), (3).

    Each pulls with ``F = P (C1 eps^2 + C2 eps + C3) + C4`` at ``eps_{1,2} = eps0 +- r theta / l0``.
    """
    return _paper_muscle(1), _paper_muscle(-1)


def _paper_muscle(side: int) -> Pull:
    C1, C2, C3, C4, l0, eps0 = (real_symbol(name) for name in ("C1", "C2", "C3", "C4", "l0", "eps0"))
    radius = real_symbol("r")
    contraction = eps0 + side * radius * ANGLE / l0
    per_pressure = C1 * contraction**2 + C2 * contraction + C3
    return Pull(side * radius * per_pressure, side * radius * C4)
