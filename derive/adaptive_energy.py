"""V of the adaptive design, as named equations that a run reports."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.adaptation import RHO_GAMMA, RHO_HAT, Adaptation, Entry
from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.lyapunov import error_function, error_weight
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix, symmetric_matrix
from pmjoint_derive.signals import Signals

SECTION = "Certificate"
LARGEST = 4  # order up to which P is written in the gains: its entries grow threefold with each order
V = real_symbol("V")


def lyapunov_equations(design: Design) -> list[Equation]:
    """``V = V_z + V_Theta + V_epsilon`` and its parts, in the true values of what is estimated.

    None for least squares, whose estimates have no part in a V that decreases, nor beyond order 4.
    """
    adaptation, s, n = design.adaptation, design.signals, design.plant.order
    assert adaptation is not None
    if adaptation.least_squares is not None or n > LARGEST:
        return []
    P, solved = symmetric_matrix(n), lyapunov_matrix(s)
    unit = design.units.of(s.y) ** 2
    rows = [
        (P[i, j], solved[i, j], "entry of P of P A0 + A0' P = -2 I") for i in range(n) for j in range(i, n)
    ]
    found = [Equation(symbol, value, SECTION, "(18)", about, None) for symbol, value, about in rows]
    parts = {
        real_symbol("V_z"): (error_energy(s), "share of the errors in V"),
        real_symbol("V_Theta"): (estimate_energy(design, adaptation), "share of the estimates in V"),
        real_symbol("V_epsilon"): (
            error_weight(s) * error_function(s, P),
            "share of the estimation error in V",
        ),
    }
    found += [Equation(name, value, SECTION, "", about, unit) for name, (value, about) in parts.items()]
    return [*found, Equation(V, sum(parts), SECTION, "", "Lyapunov function", unit)]


def error_energy(s: Signals) -> sp.Expr:
    """``V_z = sum w_i z_i^2/2``."""
    return sum((w * z**2 / 2 for w, z in zip(s.weights, s.z, strict=True)), sp.Integer(0))


def estimate_energy(design: Design, adaptation: Adaptation) -> sp.Expr:
    """``V_Theta``: the distance of the estimates from the truth, weighted with the inverse of their gains.

    With a range it is the distance that belongs to a gain that vanishes at the ends,

        (h - l)/(4 gamma) ((Theta - l) ln((Theta - l)/(Theta_hat - l))
                           + (h - Theta) ln((h - Theta)/(h - Theta_hat))),

    written in the logit of the estimate, which tells how near to an end it is where the estimate itself does
    not. An estimate whose gain is 0 has no part in it.
    """
    own = (*design.truth.b, *design.truth.theta)
    total = sum((_energy(entry, own[entry.place]) for entry in adaptation.unknown), sp.Integer(0))
    if adaptation.inverse is None:
        return total
    b_m = adaptation.sign * own[0]
    return total + b_m * (1 / own[0] - RHO_HAT) ** 2 / 2 * over(RHO_GAMMA)


def _energy(entry: Entry, true: sp.Expr) -> sp.Expr:
    hat = entry.estimate
    if entry.range is None:
        return (true - hat) ** 2 / 2 * over(entry.gamma)
    low, high = entry.ends
    below, above, whole = true - low, high - true, high - low
    entropy = below * sp.log(below / whole) + above * sp.log(above / whole)
    logit = entry.state + sp.log((entry.guess_symbol - low) / (high - entry.guess_symbol))
    away = whole * sp.log(2 * sp.cosh(logit / 2)) - (below - above) / 2 * logit
    return whole / 4 * (entropy + away) * over(entry.gamma)


def over(gain: sp.Expr) -> sp.Expr:
    """``1/gain``, and 0 for a gain of 0."""
    moves = sp.sign(gain)
    return moves / (gain + 1 - moves)
