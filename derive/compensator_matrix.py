"""The matrix whose exact hold the sampled compensator takes its steps with."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.signals import Signals


def compensator_matrix(signals: Signals) -> sp.ImmutableMatrix:
    """The matrix of (23), rho x rho: ``-ck_i`` on the diagonal, 1 above it; with braking, its hold's.

    Of an adaptive design it has a first row and column of zeros: the integral of its hold there is the sample
    time, with which the estimates advance. An extended-state observer needs that alone.
    """
    if signals.observer:
        return sp.ImmutableMatrix([[0]])
    if signals.braking:
        return braking_matrix(signals)
    rho = len(signals.r)
    found = sp.ImmutableMatrix(rho, rho, lambda i, j: -signals.ck[i] if i == j else int(j == i + 1))
    return sp.ImmutableMatrix(sp.diag(0, found)) if signals.estimates else found


def braking_matrix(signals: Signals) -> sp.ImmutableMatrix:
    """``diag(0, -ck_2/2, -ck_2)``, 3 x 3: its hold gives T, and the hold of r_2 over half of T and over T."""
    return sp.ImmutableMatrix(sp.diag(0, -signals.ck[1] / 2, -signals.ck[1]))
