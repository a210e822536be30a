"""The matrices of an exact zero-order hold as symbols, and what they make of a linear system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.equation import Equations, real_symbol
from pmjoint_derive.signals import Signals, derivative_name


@dataclass(frozen=True)
class Hold:
    """Symbols of the held dynamics.

    Attributes:
        F0: ``expm(A0 T)``, n x n.
        G0: ``int_0^T expm(A0 tau) dtau``, n x n.
        Fr: ``expm(Ar T)`` of the compensator's matrix, rho x rho; one more where a design needs T itself.
        Gr: ``int_0^T expm(Ar tau) dtau``, of the same size.
    """

    F0: sp.ImmutableMatrix
    G0: sp.ImmutableMatrix
    Fr: sp.ImmutableMatrix
    Gr: sp.ImmutableMatrix

    @classmethod
    def of(cls, signals: Signals) -> Hold:
        """The symbols for one design."""
        n, size = len(signals.filter_gains), compensator_matrix(signals).rows
        return cls(_matrix("F0", n), _matrix("G0", n), _matrix("Fr", size), _matrix("Gr", size))

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """All symbols, each matrix row by row, in the order F0, G0, Fr, Gr."""
        return tuple(entry for matrix in (self.F0, self.G0, self.Fr, self.Gr) for entry in matrix)


def _matrix(stem: str, size: int) -> sp.ImmutableMatrix:
    return sp.ImmutableMatrix(size, size, lambda i, j: real_symbol(f"{stem}_{i + 1}{j + 1}"))


def held_update(
    equations: Equations, states: Sequence[sp.Symbol], F: sp.ImmutableMatrix, G: sp.ImmutableMatrix
) -> list[sp.Expr]:
    """``F s + G drive`` for one linear system, its drive read off the continuous rates at s = 0."""
    at_rest = dict.fromkeys(states, sp.Integer(0))
    drive = sp.Matrix([equations[derivative_name(state)].expression.xreplace(at_rest) for state in states])
    return list(F * sp.Matrix(states) + G * drive)
