"""Names for composite constants, so that long physical coefficients are computed and printed once.

``b = ["2*k_u*r*(C1*eps0**2 + C2*eps0 + C3)/J"]`` becomes the named constant ``b_0`` of the design; a
coefficient that already is a parameter or a number keeps its own name.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.units import SECOND, Unit

SECTION = "Plant"


def name_constants(design: Design) -> tuple[Design, list[Equation]]:
    """Give names ``b_m ... b_0``, ``theta_1 ... theta_p`` to coefficients that are more than a parameter.

    They have no number: (8) is the paper's own pair. The unit of ``b_j`` follows from its place, the rate
    of ``x_{n-j}``; that of a theta depends on its functions of y and is left open.

    Returns:
        the design with symbols in place of composite ``b`` and ``theta`` of its plant, and what they stand
        for.
    """
    truth, signals, units = design.truth, design.signals, design.units
    equations: list[Equation] = []
    named: dict[sp.Expr, sp.Expr] = {}

    def name(value: sp.Expr, stem: str, meaning: str, unit: Unit | None) -> sp.Expr:
        if value.is_Symbol or value.is_number:
            return value
        symbol = named[value] = real_symbol(stem)
        equations.append(Equation(symbol, value, SECTION, "", meaning, unit))
        return symbol

    driven = signals.x[truth.rho - 1 :]
    b = tuple(
        name(value, f"b_{truth.m - i}", "input coefficient", units.of(state) / SECOND / units.of(signals.u))
        for i, (value, state) in enumerate(zip(truth.b, driven, strict=True))
    )
    theta = tuple(
        name(value, f"theta_{i}", "known coefficient", None) for i, value in enumerate(truth.theta, start=1)
    )
    believed = replace(
        design.plant,
        b=tuple(named.get(value, value) for value in design.plant.b),
        theta=tuple(named.get(value, value) for value in design.plant.theta),
    )
    return replace(design, plant=believed, truth=replace(truth, b=b, theta=theta)), equations
