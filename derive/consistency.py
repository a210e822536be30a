"""Derived equations that must agree with each other, as identities that expand to exactly zero.

The certificate does not see them: the reference's derivatives, and the sampled controller. With ``F = I + A
T``, ``G = T I`` in place of the exact matrices, the held update must be one step of Euler's method, ``s + T
s'``; so it is the filters (14) and the compensator (23) that are being held, term by term.
"""

from __future__ import annotations

import sympy as sp

from derive.closed_loop import disturbance_symbols
from derive.compensator import compensator_matrix
from derive.derivation import Derivation
from derive.filters import filter_matrix
from derive.lyapunov import Identity
from derive.model import parameter_symbol
from derive.sampling import Hold
from derive.signals import derivative_name


def reference_identities(derivation: Derivation) -> list[Identity]:
    """Each named derivative of the reference is the time derivative of the one before it; the first is the model's."""
    s, model = derivation.signals, derivation.model
    values = [derivation.equations[symbol.name].expression for symbol in s.y_r]
    wanted = [model.reference, *(sp.diff(value, s.t) for value in values[:-1])]
    return [
        Identity(str(symbol), f"{symbol} follows from the reference", sp.expand(value - expected))
        for symbol, value, expected in zip(s.y_r, values, wanted, strict=True)
    ]


def disturbance_identities(derivation: Derivation) -> list[Identity]:
    """Each named disturbance is the model's."""
    symbols = disturbance_symbols(derivation.plant)
    return [
        Identity(
            str(symbol),
            f"{symbol} is the model's disturbance",
            sp.expand(derivation.equations[symbol.name].expression - expected),
        )
        for symbol, expected in zip(symbols, derivation.plant.disturbance, strict=True)
    ]


def sampling_identities(derivation: Derivation) -> list[Identity]:
    """The held update with matrices to first order in T is ``s + T s'``, exactly."""
    s, hold, T = derivation.signals, Hold.of(derivation.signals), parameter_symbol("T_sample")
    A0, Ar = filter_matrix(s), compensator_matrix(s)
    first_order = {
        **_entries(hold.F0, sp.eye(A0.rows) + T * A0),
        **_entries(hold.G0, T * sp.eye(A0.rows)),
        **_entries(hold.Fr, sp.eye(Ar.rows) + T * Ar),
        **_entries(hold.Gr, T * sp.eye(Ar.rows)),
    }
    keep = frozenset({s.y, s.u, s.v})
    identities = []
    for state in s.controller_state:
        rate = derivation.equations.expand(derivation.equations[derivative_name(state)].expression, keep)
        update = derivation.equations.expand(derivation.equations[f"{state.name}_next"].expression, keep)
        rest = sp.expand(update.xreplace(first_order) - state - T * rate)
        identities.append(Identity(f"{state}_next", f"{state} one sample later is held {state}'", rest))
    return identities


def _entries(symbols: sp.MatrixBase, values: sp.MatrixBase) -> dict[sp.Symbol, sp.Expr]:
    return dict(zip(symbols, values, strict=True))


def consistency_identities(derivation: Derivation) -> tuple[Identity, ...]:
    """Every identity of this module."""
    return (
        *reference_identities(derivation),
        *disturbance_identities(derivation),
        *sampling_identities(derivation),
    )
