"""Exact zero-order-hold discretisation of the filters (14) and the compensator (23).

Both are linear with inputs that a sampled controller holds over one period T: y, u and du. So for either,
``s(t + T) = F s(t) + G drive`` with ``F = expm(A T)`` and ``G = int_0^T expm(A tau) dtau``, without any
discretisation error. F and G depend on the gains and T alone; they are computed once per run and enter the
equations as symbols. A braking compensator is not linear in r_1: see `braking`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.braking import braking_update
from pmjoint_derive.compensator import compensator_matrix
from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.signals import Signals, derivative_name

SECTION = "Sampled"


@dataclass(frozen=True)
class Hold:
    """Symbols of the held dynamics.

    Attributes:
        F0: ``expm(A0 T)``, n x n.
        G0: ``int_0^T expm(A0 tau) dtau``, n x n.
        Fr: ``expm(Ar T)`` of the compensator's matrix, rho x rho; 3 x 3 with braking.
        Gr: ``int_0^T expm(Ar tau) dtau``, of the same size.
    """

    F0: sp.ImmutableMatrix
    G0: sp.ImmutableMatrix
    Fr: sp.ImmutableMatrix
    Gr: sp.ImmutableMatrix

    @classmethod
    def of(cls, signals: Signals) -> Hold:
        """The symbols for one design."""
        n, size = len(signals.k), compensator_matrix(signals).rows
        return cls(_matrix("F0", n), _matrix("G0", n), _matrix("Fr", size), _matrix("Gr", size))

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """All symbols, each matrix row by row, in the order F0, G0, Fr, Gr."""
        return tuple(entry for matrix in (self.F0, self.G0, self.Fr, self.Gr) for entry in matrix)


def _number(signals: Signals, state: sp.Symbol) -> str:
    if state not in signals.r:
        return "(14)"
    return "" if signals.braking and state == signals.r[0] else "(23)"


def _matrix(stem: str, size: int) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix(size, size, lambda i, j: real_symbol(f"{stem}_{i + 1}{j + 1}"))


def held_update(
    equations: Equations, states: Sequence[sp.Symbol], F: sp.ImmutableMatrix, G: sp.ImmutableMatrix
) -> list[sp.Expr]:
    """``F s + G drive`` for one linear system, its drive read off the continuous rates at s = 0."""
    at_rest = dict.fromkeys(states, sp.Integer(0))
    drive = sp.Matrix([equations[derivative_name(state)].expression.xreplace(at_rest) for state in states])
    return list(F * sp.Matrix(states) + G * drive)


def sampling_equations(design: Design, equations: Equations) -> list[Equation]:
    """The controller's state one sample later, as named equations ``xi1_next`` and so on."""
    signals = design.signals
    hold = Hold.of(signals)
    columns = [[row[j] for row in signals.Xi] for j in range(len(signals.Xi[0]))] if signals.Xi[0] else []
    update: dict[sp.Symbol, sp.Expr] = {}
    for states in ([*signals.xi], *columns, [*signals.lambda_]):
        update |= dict(zip(states, held_update(equations, states, hold.F0, hold.G0), strict=True))
    steps: list[Equation] = []
    if signals.braking:
        steps, found = braking_update(design, equations, hold.Fr, hold.Gr)
        update |= found
    else:
        update |= dict(zip(signals.r, held_update(equations, signals.r, hold.Fr, hold.Gr), strict=True))
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
