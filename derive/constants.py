"""Names for composite constants, so that long physical coefficients are computed and printed once.

``b = ["2*k_u*r*(C1*eps0**2 + C2*eps0 + C3)/J"]`` becomes the named constant ``b_0`` of the design; a
coefficient that already is a parameter or a number keeps its own name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Plant, parameter_symbol
from pmjoint_derive.signals import Signals, Units
from pmjoint_derive.units import SECOND, Unit

SECTION = "Plant"


@dataclass(frozen=True)
class NamedPlant:
    """A plant whose composite coefficients have names.

    Attributes:
        plant: the plant, with symbols in place of composite ``b`` and ``theta``.
        equations: what the names stand for.
    """

    plant: Plant
    equations: tuple[Equation, ...]


def name_constants(plant: Plant, signals: Signals, units: Units) -> NamedPlant:
    """Give names ``b_m ... b_0``, ``theta_1 ... theta_p`` to coefficients that are more than a parameter.

    They have no number: (8) is the paper's own pair. The unit of ``b_j`` follows from its place, the rate
    of ``x_{n-j}``; that of a theta depends on its functions of y and is left open.
    """
    equations: list[Equation] = []

    def name(value: sp.Expr, stem: str, meaning: str, unit: Unit | None) -> sp.Expr:
        if value.is_Symbol or value.is_number:
            return value
        symbol = parameter_symbol(stem)
        equations.append(Equation(symbol, value, SECTION, "", meaning, unit))
        return symbol

    driven = signals.x[plant.rho - 1 :]
    b = tuple(
        name(value, f"b_{plant.m - i}", "input coefficient", units.of(state) / SECOND / units.of(signals.u))
        for i, (value, state) in enumerate(zip(plant.b, driven, strict=True))
    )
    theta = tuple(
        name(value, f"theta_{i}", "known coefficient", None) for i, value in enumerate(plant.theta, start=1)
    )
    return NamedPlant(replace(plant, b=b, theta=theta), tuple(equations))
