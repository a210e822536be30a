"""The force of one muscle, ``F(P, eps)``, split into ``P gain(eps) + passive(eps)``.

The law (4) adds ``k_u u`` to a base pressure, so u enters the balance (1) linearly only if every force is
affine in its pressure. The split is exact: gain is the derivative with respect to P, which must be free of P,
and passive is the force at P = 0. The paper's law (2) is one such force.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.arm import travel
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.model import OutsideClassError
from pmjoint_derive.muscle import Pull
from pmjoint_derive.units import parse_unit

PRESSURE, CONTRACTION = real_symbol("P"), real_symbol("eps")
REMEDY = "linearise it about the base pressure k0*u0, or take a preset: force = P*g(eps) + h(eps)"


@dataclass(frozen=True)
class Force:
    """A force affine in pressure; both parts are functions of eps and parameters.

    Attributes:
        gain: force per pressure, m^2.
        passive: force at zero pressure, N.
    """

    gain: sp.Expr
    passive: sp.Expr

    def stretched(self, contraction: sp.Expr) -> Force:
        """Both parts at a contraction."""
        at = {CONTRACTION: contraction}
        return Force(self.gain.xreplace(at), self.passive.xreplace(at))

    def at(self, pressure: sp.Expr, contraction: sp.Expr) -> sp.Expr:
        """The force in N at a pressure in Pa and a contraction."""
        stretched = self.stretched(contraction)
        return pressure * stretched.gain + stretched.passive


@dataclass(frozen=True)
class Muscle:
    """One muscle on the joint; its expressions are functions of theta and parameters.

    Attributes:
        force: its force.
        contraction: its eps.
        lever: its signed moment arm, m: torque per force.
    """

    force: Force
    contraction: sp.Expr
    lever: sp.Expr

    @property
    def pull(self) -> Pull:
        """Its torque on the joint."""
        stretched = self.force.stretched(self.contraction)
        return Pull(self.lever * stretched.gain, self.lever * stretched.passive)

    def tension(self, pressure: sp.Expr) -> sp.Expr:
        """Its force in N at a pressure in Pa; a muscle only pulls, so a negative one is outside the law."""
        return self.force.at(pressure, self.contraction)


def attached(force: Force, arm: sp.Expr, rest: sp.Expr, length: sp.Expr, side: int, key: str) -> Muscle:
    """A muscle with a moment arm on one side of the joint (3).

    Args:
        force: its force.
        arm: moment arm, a function of theta and parameters, m.
        rest: contraction at theta = 0.
        length: nominal length, m.
        side: 1 for muscle 1, which shortens as theta grows, -1 for muscle 2.
        key: place of the arm in the model file, for a message.

    Raises:
        OutsideClassError: for an arm whose integral is not known in closed form.
    """
    return Muscle(force, rest + side * travel(arm, key) / length, side * arm)


def tensions(muscles: tuple[Muscle, Muscle], source: str = "") -> tuple[Equation, ...]:
    """The two forces as named equations of theta and the pressures P1 and P2.

    Args:
        muscles: muscle 1 and muscle 2.
        source: of the law, where it has a name.
    """
    law = f" by {source}" if source else ""
    return tuple(
        Equation(
            real_symbol(f"F{i}"),
            muscle.tension(real_symbol(f"P{i}")),
            "Plant",
            "",
            f"force of muscle {i}{law}; below 0 the muscle is slack, and the law does not hold",
            parse_unit("N"),
        )
        for i, muscle in enumerate(muscles, start=1)
    )


def split(force: sp.Expr, key: str = "joint.force") -> Force:
    """Split a force into its two parts.

    Args:
        force: in N, a function of P, eps and parameters.
        key: its place in the model file, for the message.

    Raises:
        OutsideClassError: for a force that is not affine in P, or on which pressure does not act.
    """
    gain = sp.diff(force, PRESSURE)
    if PRESSURE in gain.free_symbols:
        gain = sp.expand(gain)  # (P + 1)**2 - P**2 is affine, too
    if PRESSURE in gain.free_symbols:
        raise OutsideClassError(key, f"is not affine in P: the term {_bent_term(force)} is not", REMEDY)
    if gain == 0:
        raise OutsideClassError(key, "does not depend on P, so no pressure acts", "give a force of P and eps")
    passive = force.xreplace({PRESSURE: sp.Integer(0)})
    if passive.has(sp.nan, sp.zoo):  # P/P in disguise, such as (P**2 + P)/P
        passive = sp.expand(force - PRESSURE * gain)
    return Force(gain, passive)


def _bent_term(force: sp.Expr) -> sp.Expr:
    """The first term that keeps a second derivative with respect to P."""
    terms = sp.Add.make_args(sp.expand(force))
    return next((term for term in terms if sp.diff(term, PRESSURE, 2) != 0), force)
