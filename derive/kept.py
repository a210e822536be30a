"""What a design keeps of a joint's balance, and what it leaves out: the disturbance D of (12).

What is kept never enters D, in place of being subtracted there. So a design that keeps everything has a D of
rounding errors, whatever the muscles' law of force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.balance import B_V, K_U, OMEGA, THETA, Balance, J, U, coefficients, varies
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.model import OutsideClassError
from pmjoint_derive.shield import multiplied_out, shielded

GAIN = ("gain", "quadratic_gain")  # two names of one thing: that of the paper's pair is quadratic
KEEP = ("damping", "torque", *GAIN, "pressure_lag")
LAG = "tau"
A, B0, D1, KAPPA, TAU = (real_symbol(name) for name in ("a", "b0", "d1", "kappa", LAG))
# distances of the pressures from P_0, and their commands
Q1, Q2, P1, P2 = (real_symbol(name) for name in ("q1", "q2", "p1", "p2"))
MOVING = (real_symbol("t"),)  # what is said of theta must be multiplied out to cancel
_ZERO, _ONE = sp.Integer(0), sp.Integer(1)


@dataclass(frozen=True)
class Kept:
    """The design's part: ``theta'' = linear theta + rest(theta) - a theta' + b0 sigma(theta) u``.

    Attributes:
        balance: the full physics.
        named: the coefficients by name.
        a: damping, the symbol or 0.
        linear: the paper's d1; 0 for muscles of any other form.
        rest: stiffness of such muscles and a kept torque, rad/s^2.
        sigma: the kept gain over b0; 1 where the gain is not kept, or constant.
        torque: whether the torque is kept.
        lag: whether the lag is kept.
    """

    balance: Balance
    named: Mapping[str, sp.Expr]
    a: sp.Expr
    linear: sp.Expr
    rest: sp.Expr
    sigma: sp.Expr
    torque: bool
    lag: bool

    @property
    def is_paper(self) -> bool:
        """Whether the muscles have the paper's form."""
        return D1.name in self.named

    @property
    def order(self) -> int:
        """Order of the design's plant."""
        return 3 if self.lag else 2


def check_keep(keep: tuple[str, ...], *, lagged: bool, torque: bool = True) -> None:
    """Refuse what no design can keep.

    Args:
        keep: the physics that the design keeps.
        lagged: whether the pressures have a time constant.
        torque: whether the joint has a torque of its position.

    Raises:
        OutsideClassError: naming the key and the reason.
    """
    for item in keep:
        if item not in KEEP:
            raise OutsideClassError(
                "joint.keep", f"{item!r} is nothing that a design can keep", f"allowed: {', '.join(KEEP)}"
            )
    if "pressure_lag" in keep and not lagged:
        raise OutsideClassError(
            "joint.tau", "a pressure lag is kept but has no time constant", "give tau in [joint], in s"
        )
    if "torque" in keep and not torque:
        raise OutsideClassError(
            "joint.torque",
            "a torque is kept but not given",
            'give torque in [joint], such as "-m*g*l*sin(theta)"',
        )


def keep_of(keep: tuple[str, ...], balance: Balance) -> Kept:
    """What the design keeps.

    Raises:
        OutsideClassError: for a lag kept together with a gain that varies.
    """
    named = coefficients(balance.muscles)
    lag, gain = "pressure_lag" in keep, any(name in keep for name in GAIN) and varies(balance)
    if lag and gain:
        raise OutsideClassError(
            "joint.keep",
            "a lag together with sigma(y) != 1 multiplies y by the pressure, which is not measured",
            "keep one of pressure_lag and gain (quadratic_gain); the other is simulated as a disturbance",
        )
    paper = D1.name in named
    torque = balance.torque / J if "torque" in keep else _ZERO
    varying = _ONE + KAPPA * THETA**2 if paper else _relative_gain(balance)
    return Kept(
        balance,
        named,
        a=A if "damping" in keep else _ZERO,
        linear=D1 if paper else _ZERO,
        rest=torque if paper else balance.stiffness + torque,
        sigma=varying if gain else _ONE,
        torque="torque" in keep,
        lag=lag,
    )


def _relative_gain(balance: Balance) -> sp.Expr:
    """``gain/b0`` as the sum of both muscles' parts: proofs let a sum stand for itself, and are quick."""
    pull1, pull2 = balance.muscles
    return K_U * pull1.gain / (J * B0) - K_U * pull2.gain / (J * B0)


def effective_input(first: sp.Expr, second: sp.Expr) -> sp.Expr:
    """The input equivalent to two pressures' distances from P_0."""
    return (first + second) / (2 * K_U)


def left_out(kept: Kept, *, lagged: bool) -> tuple[sp.Expr, ...]:
    """``D`` of (12): rates of the full physics less those of the design, in physical states and u.

    With ``surplus`` the part of theta'' beyond the design's, ``D = (0, surplus)``. With a kept lag it is
    ``(0, surplus, surplus/tau + b0 (w - u)/tau)``, where w is the input equivalent to the pressures'
    commands.

    Args:
        kept: what the design keeps.
        lagged: whether the pressures follow their commands with the time constant tau.
    """
    pressures = (Q1, Q2) if lagged else (P1, P2)
    drive = effective_input(Q1, Q2) if kept.lag else U
    surplus, further = _driven(kept, pressures, drive), _further(kept)
    if kept.a == 0:
        surplus -= B_V * OMEGA / J
    found = [_ZERO, _tidied(kept, surplus) + further]
    if kept.lag:
        lagging = B0 * effective_input(P1, P2) / TAU - B0 / TAU * U
        found.append(_tidied(kept, surplus / TAU + lagging) + further / TAU)
    return tuple(found)


def _driven(kept: Kept, pressures: tuple[sp.Expr, sp.Expr], drive: sp.Expr) -> sp.Expr:
    """Acceleration by the pressures beyond that by the design's input `drive`.

    For muscles in general it is written such that the kept gain is no part of it, and exactly 0 without
    clipping.
    """
    balance = kept.balance
    if kept.is_paper:
        return balance.pressed(*pressures) - B0 * kept.sigma * drive
    excess = balance.gain - B0 if kept.sigma == 1 and varies(balance) else _ZERO
    first, second = (sp.expand(pressure - K_U * drive) for pressure in pressures)
    return balance.pressed(first, second) + excess * drive


def _further(kept: Kept) -> sp.Expr:
    """Friction, disturbance and a torque that is not kept, over J, as they are written."""
    balance = kept.balance
    torque = _ZERO if kept.torque else balance.torque
    return (torque + balance.friction + balance.disturbance) / J


def _tidied(kept: Kept, value: sp.Expr) -> sp.Expr:
    """For the paper's form: terms by pressure and speed, each coefficient factored; what holds u as it is."""
    if not kept.is_paper:
        return value
    direct = [term for term in sp.Add.make_args(value) if term.has(U)]
    rest = multiplied_out((value - sum(direct, _ZERO)).xreplace(_values(kept)), MOVING)
    collected = shielded(lambda whole: sp.collect(whole, (Q1, Q2, P1, P2, OMEGA), sp.factor), rest, MOVING)
    return collected + sum(direct, _ZERO)


def _values(kept: Kept) -> dict[sp.Expr, sp.Expr]:
    return {real_symbol(name): value for name, value in kept.named.items()}
