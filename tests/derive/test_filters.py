"""The K-filters' one promise: the estimation error obeys epsilon' = A0 epsilon + D, for any u."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive import Derivation
from pmjoint_derive.closed_loop import disturbance_symbols, plant_rates
from pmjoint_derive.filters import estimate, filter_matrix, filter_rates, input_filter_rates, input_filters


def test_estimation_error_dynamics(derivation: Derivation) -> None:
    s, plant = derivation.signals, derivation.plant
    x_hat = estimate(derivation.plant, derivation.signals)
    rates = filter_rates(derivation.design)
    x_hat_dot = sp.Matrix(
        [sum(sp.diff(entry, state) * rate for state, rate in rates.items()) for entry in x_hat]
    )
    x_dot = sp.Matrix(list(plant_rates(derivation.plant, derivation.signals).values()))
    epsilon = sp.Matrix(s.x) - x_hat
    wanted = filter_matrix(s) * epsilon + sp.Matrix(disturbance_symbols(plant))
    difference = (x_dot - x_hat_dot - wanted).xreplace({s.y: s.x[0]})
    assert difference.applyfunc(sp.expand).is_zero_matrix


def test_input_filter_chain(derivation: Derivation) -> None:
    """v_{m,i}' = v_{m,i+1} - k_i v_{m,1} below rho, and sigma u enters entry rho with factor one."""
    s, plant = derivation.signals, derivation.plant
    v_m = input_filters(s, plant.m)
    rates = input_filter_rates(derivation.design, plant.m, v_m)
    for i in range(1, plant.rho + 1):
        following = v_m[i] if i < plant.order else sp.Integer(0)
        drive = plant.sigma * s.u if i == plant.rho else 0
        assert sp.expand(rates[i - 1] - (following - s.k[i - 1] * v_m[0] + drive)) == 0
