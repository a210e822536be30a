"""Exact zero-order-hold discretisation of the filters (14) and the compensator (23).

Both are linear with inputs that a sampled controller holds over one period T: y, u and du. So for either,
``s(t + T) = F s(t) + G drive`` with ``F = expm(A T)`` and ``G = int_0^T expm(A tau) dtau``, without any
discretisation error. F and G depend on the gains and T alone; they are computed once per run and enter the
equations as symbols. A braking compensator is not linear in r_1: see `braking`.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.hold import Hold
from pmjoint_derive.signals import Signals

SECTION = "Sampled"


def _number(signals: Signals, state: sp.Symbol) -> str:
    if state in signals.r:
        known = not signals.estimates and not (signals.braking and state == signals.r[0])
        return "(23)" if known else ""
    if signals.observer:
        return ""
    return "" if state in (*signals.learnt, *signals.inverse, *signals.covariance) else "(14)"


def sampling_equations(design: Design, equations: Equations) -> list[Equation]:
    """The controller's state one sample later, as named equations ``xi1_next`` and so on."""
    signals = design.signals
    hold = Hold.of(signals)
    steps, found = design.sampled(equations, hold)
    update = design.sampled_filters(equations, hold) | found
    return steps + [
        Equation(
            real_symbol(f"{state.name}_next"),
            update[state],
            SECTION,
            _number(signals, state),
            f"{state} one sample later",
            design.units.of(state),
        )
        for state in signals.controller_state
    ]
