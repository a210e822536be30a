"""The rate of V of the adaptive design as named equations, for a reader: what `adaptive_proof` proves.

With a constant gain and leakage ``V' <= Y - f V``: each term of V decays at least at f, by

    -c w z^2 <= -f w z^2/2,    -|epsilon|^2/(4 e) <= -f epsilon' P epsilon/(2 e),
    -leakage Theta~^2/2 <= -f Theta~^2/(2 gamma),

and Y is what D and the priors add. A gain that vanishes at the ends of a range has no such f: there V' <= 0
is known only of D = 0 without leakage.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.adaptation import LEAKAGE, RHO_GAMMA, RHO_LEAKAGE, RHO_PRIOR, Adaptation
from pmjoint_derive.adaptive_energy import error_energy
from pmjoint_derive.adaptive_proof import (
    energies,
    energy_claim,
    leakage_squares,
    leaked,
    true_value,
)
from pmjoint_derive.certificate import Row, largest_eigenvalue, matrix_at_gains, named_rows, residual
from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.design import Derivation
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.lyapunov import certified_rate, given_away, projected_symbols
from pmjoint_derive.lyapunov_matrix import symmetric_matrix


def certificate_equations(derivation: Derivation) -> tuple[Equation, ...]:
    """V, its rate, what that gives away, and f and Y where there are any, as named equations.

    Least squares has ``V_z`` and its rate alone, in which the errors of the estimates stay. Nothing is stated
    of a model that estimates an entry with a gain of 0, which only a right guess would allow.
    """
    adaptation = derivation.design.adaptation
    assert adaptation is not None  # of a derivation of this design
    if adaptation.least_squares is not None:
        rows: list[Row] = [
            ("V_z", error_energy(derivation.signals), "", "share of the errors in V"),
            ("V_z_dot", energy_claim(derivation), "", "its rate under the law, whatever u is"),
        ]
    elif not all(gain > 0 for gain in _gains(adaptation)):
        return ()
    else:
        rows = [*_function(derivation), *_rate(derivation), *_decay(derivation, adaptation)]
    parameters = {item.name for item in derivation.model.parameters}
    return named_rows(rows, parameters | (set(derivation.equations) - {"V"}))


def _gains(adaptation: Adaptation) -> list[float]:
    gains = [entry.gain for entry in adaptation.unknown]
    return gains if adaptation.inverse is None else [*gains, adaptation.inverse.gain]


def _function(derivation: Derivation) -> list[Row]:
    """V where no run reports it: P in numbers, as its entries would fill pages."""
    if "V" in derivation.equations:
        return []
    n, solved = derivation.plant.order, matrix_at_gains(derivation)
    P = symmetric_matrix(n)
    about = "entry of P of P A0 + A0' P = -2 I, at the gains of the model"
    rows = [(P[i, j].name, solved[i, j], "", about) for i in range(n) for j in range(i, n)]
    names = ("V_z", "V_Theta", "V_epsilon")
    shares = ("errors", "estimates", "estimation error")
    for name, value, share in zip(names, energies(derivation), shares, strict=True):
        rows.append((name, value, "", f"share of the {share} in V"))
    return [*rows, ("V", sum(map(real_symbol, names)), "", "Lyapunov function")]


def _rate(derivation: Derivation) -> list[Row]:
    plant, L, V_lost = derivation.plant, real_symbol("L"), real_symbol("V_lost")
    PD, symbols = projected_symbols(plant.order), disturbance_symbols(plant)
    acting = [symbol if rate != 0 else rate for symbol, rate in zip(symbols, plant.disturbance, strict=True)]
    values = symmetric_matrix(plant.order) * sp.Matrix(acting)
    lost = sum((*given_away(derivation), *leakage_squares(derivation)), sp.Integer(0))
    return [
        *((name.name, value, "", "entry of P D") for name, value in zip(PD, values, strict=True)),
        ("L", leaked(derivation), "", "what leakage adds to the rate of V at most"),
        ("V_lost", lost, "", "what the rate of V gives away: squares with positive factors"),
        ("V_dot", certified_rate(derivation, PD) + L - V_lost, "", "rate of V under the law, whatever u is"),
    ]


def _decay(derivation: Derivation, adaptation: Adaptation) -> list[Row]:
    """f, and Y for a disturbance with a bound."""
    pulls = [adaptation.leakage] + ([] if adaptation.inverse is None else [adaptation.inverse.leakage])
    if any(entry.range is not None for entry in adaptation.unknown) or not all(pull > 0 for pull in pulls):
        return []
    largest, bound = real_symbol("lambda_P"), derivation.model.disturbance_bound
    rates = [*(2 * c for c in derivation.signals.c), 1 / (2 * largest)]
    rates += [LEAKAGE * entry.gamma for entry in adaptation.unknown]
    rates += [] if adaptation.inverse is None else [RHO_LEAKAGE * RHO_GAMMA]
    eigenvalue = largest_eigenvalue(matrix_at_gains(derivation))
    rows: list[Row] = [
        ("lambda_P", eigenvalue, "", "largest eigenvalue of P, at the gains of the model"),
        ("f", sp.Min(*rates), "", "rate at which V decays at least"),
    ]
    if bound is None:
        return rows
    V, Y, f, D_max = (real_symbol(name) for name in ("V", "Y", "f", "D_max"))
    return [
        *rows,
        ("D_max", sp.Rational(repr(bound)), "(9)", "bound of the disturbance"),
        (
            "Y",
            residual(derivation, largest, D_max) + _apart(derivation, adaptation),
            "",
            "what the disturbance and wrong priors add at most",
        ),
        ("V_dot_max", Y - f * V, "", "V_dot is at most this"),
    ]


def _apart(derivation: Derivation, adaptation: Adaptation) -> sp.Expr:
    """``leakage/2 sum (Theta - prior)^2`` and the same of 1/b_m."""
    total = sp.Integer(0)
    for entry in adaptation.unknown:
        total += LEAKAGE / 2 * (true_value(derivation, entry) - entry.prior_symbol) ** 2
    if adaptation.inverse is not None:
        b_m = derivation.design.truth.b[0]
        total += adaptation.sign * b_m * RHO_LEAKAGE / 2 * (1 / b_m - RHO_PRIOR) ** 2
    return total
