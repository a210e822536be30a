"""K-filters (14)-(18): estimates of the unmeasured states from y and the applied input.

``xi' = A0 xi + k y + phi(y)``, ``Xi' = A0 Xi + Phi(y)``, ``lambda' = A0 lambda + e_n sigma(y) u`` and ``v_j =
A0^j lambda``. The estimate ``x_hat = xi + Xi theta + sum_j b_j v_j`` errs by epsilon with ``epsilon' = A0
epsilon + D``, whatever u is.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.model import Plant
from pmjoint_derive.signals import Signals, derivative_name
from pmjoint_derive.units import SECOND

SECTION = "Filters"


def shift_matrix(order: int) -> sp.ImmutableMatrix:
    """The upper shift matrix A of (13), order x order."""
    return sp.ImmutableMatrix(order, order, lambda i, j: int(j == i + 1))


def filter_matrix(signals: Signals) -> sp.ImmutableMatrix:
    """``A0 = A - k e1'`` of (14), n x n; n + 1 of an extended-state observer."""
    k = signals.filter_gains
    n = len(k)
    gain = sp.Matrix(n, n, lambda i, j: k[i] if j == 0 else 0)
    return sp.ImmutableMatrix(shift_matrix(n) - gain)


def input_filters(signals: Signals, j: int) -> sp.ImmutableMatrix:
    """``v_j = A0^j lambda`` of (14), a column of length n."""
    return sp.ImmutableMatrix(filter_matrix(signals) ** j * sp.Matrix(signals.lambda_))


def input_filter_rates(design: Design, j: int, v_j: sp.Matrix) -> sp.ImmutableMatrix:
    """``v_j' = A0 v_j + A0^j e_n sigma u``, from (14); ``v_j`` may be symbols or expressions of lambda."""
    plant, signals = design.plant, design.signals
    A0 = filter_matrix(signals)
    e_n = sp.Matrix([0] * (plant.order - 1) + [1])
    return sp.ImmutableMatrix(A0 * v_j + A0**j * e_n * plant.sigma * signals.u)


def estimate(plant: Plant, signals: Signals) -> sp.ImmutableMatrix:
    """``x_hat = xi + Xi theta + sum_j b_j v_j`` (15) with a plant's b and theta, a column of length n."""
    regressor = sp.Matrix(plant.order, plant.p, lambda i, j: signals.Xi[i][j]) * sp.Matrix(
        plant.p, 1, plant.theta
    )
    driven = sp.zeros(plant.order, 1)
    for j in range(plant.m + 1):
        driven += plant.b[plant.m - j] * input_filters(signals, j)
    return sp.ImmutableMatrix(sp.Matrix(signals.xi) + regressor + driven)


def filter_rates(design: Design) -> dict[sp.Symbol, sp.Expr]:
    """Right-hand sides of (14), keyed by filter state."""
    plant, signals = design.plant, design.signals
    A0, n, p = filter_matrix(signals), plant.order, plant.p
    xi_dot = A0 * sp.Matrix(signals.xi) + sp.Matrix(signals.k) * signals.y + sp.Matrix(plant.phi)
    Xi = sp.Matrix(n, p, lambda i, j: signals.Xi[i][j])
    Xi_dot = A0 * Xi + sp.Matrix(n, p, lambda i, j: plant.Phi[i][j])
    lambda_dot = input_filter_rates(design, 0, sp.Matrix(signals.lambda_))
    rates = dict(zip(signals.xi, xi_dot, strict=True))
    rates |= {signals.Xi[i][j]: Xi_dot[i, j] for i in range(n) for j in range(p)}
    return rates | dict(zip(signals.lambda_, lambda_dot, strict=True))


def filter_equations(design: Design) -> list[Equation]:
    """The filters (14), the estimate (15) and the matrix A0 as named equations."""
    meanings = {
        "xi": "filter driven by y",
        "Xi": "filter driven by Phi(y)",
        "lambda": "filter driven by the applied input",
    }
    found = filter_rates(design)
    rates = [
        Equation(
            symbol=real_symbol(derivative_name(state)),
            expression=found[state],
            section=SECTION,
            number="(14)",
            meaning=meaning,
            unit=design.units.of(state) / SECOND,
        )
        for block, meaning in meanings.items()
        for state in design.signals.controller_blocks[block]
    ]
    estimates = [
        Equation(
            symbol=real_symbol(f"x_hat{i}"),
            expression=value,
            section="Estimate",
            number="(15)",
            meaning=f"estimate of x{i}",
            unit=design.units.of(design.signals.x[i - 1]),
        )
        for i, value in enumerate(estimate(design.plant, design.signals), start=1)
    ]
    return rates + estimates
