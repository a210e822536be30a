"""The auxiliary system (23) that carries the clipped part of the input, ``du = u - v``.

``r_i' = r_{i+1} - ck_i r_i`` for i < rho and ``r_rho' = -ck_rho r_rho + b_m sigma(y) du``. It needs the
*applied* input: measured on a rig, sat(v) in simulation. Without it (r = 0 for all time) the same law is
plainly clipped. `braking` has another r_1, for two states.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from pmjoint_derive.braking import RATE
from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND

SECTION = "Compensator"


def compensator_rates(design: Design) -> dict[sp.Symbol, sp.Expr]:
    """Right-hand sides of (23) with the compensator at work, keyed by state."""
    plant, signals = design.plant, design.signals
    drive = sp.Matrix([0] * (plant.rho - 1) + [plant.b[0] * plant.sigma * signals.du])
    if signals.braking:
        r1, r2 = signals.r
        return {r1: r2 - RATE, r2: drive[1] - signals.ck[1] * r2}
    rates = compensator_matrix(signals) * sp.Matrix(signals.r) + drive
    return dict(zip(signals.r, rates, strict=True))


def compensator_equations(design: Design) -> list[Equation]:
    """(23) as named equations."""
    return switched(design, compensator_rates(design))


def switched(design: Design, found: Mapping[sp.Symbol, sp.Expr]) -> list[Equation]:
    """A compensator's rates as named equations, with the switch ``compensator`` (1 or 0) on its drive.

    Args:
        design: the design.
        found: rate of each of its states.
    """
    signals, units = design.signals, design.units
    lost = Equation(
        symbol=signals.du,
        expression=signals.u - signals.v,
        section=SECTION,
        number="(23)",
        meaning="the clipped part of the input",
        unit=units.of(signals.u),
    )
    rates = [
        Equation(
            symbol=real_symbol(derivative_name(state)),
            expression=rate.xreplace({signals.du: signals.compensator * signals.du}),
            section=SECTION,
            number="" if signals.braking and i == 1 else "(23)",
            meaning="compensator state" if i < design.plant.rho else "compensator state, driven by du",
            unit=units.of(state) / SECOND,
        )
        for i, (state, rate) in enumerate(found.items(), start=1)
    ]
    return [lost, *rates]
