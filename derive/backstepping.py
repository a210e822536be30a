"""Backstepping with saturation compensator (24)-(29), for general relative degree.

Only three things are stated here: the errors z_i (24), the error dynamics that the design asks for, and the
output's rate as the filters know it (21). Every virtual control alpha_i, every partial derivative and the law
v follow by solving

    z_i' = -(c_i + e_i s_i^2) z_i - s_i eta - g_i + (coupling to z_{i+1}),      s_1 = -1,  s_i = d alpha_{i-1}
    / dy,

for the one unknown in it. With ``g_2 = b_m z_1`` and ``g_i = z_{i-1}`` the couplings cancel in the sum of
squares, which is what the certificate (19)-(35) rests on. ``eta = epsilon_2 + D_1`` is what nobody knows of
y'; the paper's D_1 is 0. It and the input u drop out of the solutions; both are checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.closed_loop import disturbance_symbols, output_disturbance
from pmjoint_derive.compensator import compensator_rates
from pmjoint_derive.equation import Equation
from pmjoint_derive.filters import estimate, filter_rates, input_filter_rates, input_filters
from pmjoint_derive.model import Plant, parameter_symbol
from pmjoint_derive.partials import ChainRule
from pmjoint_derive.progress import Stage, unwatched
from pmjoint_derive.shield import multiplied_out, shielded
from pmjoint_derive.signals import Signals, Units, free, partial_name
from pmjoint_derive.units import SECOND

SECTION = "Backstepping"
OMEGA = "Omega"


@dataclass(frozen=True)
class Step:
    """What one design needs at every step.

    Attributes:
        plant: plant with named constants.
        signals: symbols of the design.
        v_m: symbols of v_{m,1} ... v_{m,n}, the filtered input that each step uses as its virtual control.
        omega: symbol of what (21) knows of y' besides ``b_m v_{m,2}``.
        rates: time derivatives of y, the controller's state and the reference, with eta = 0.
        v_m_rates: time derivatives of ``v_m``; u occurs in entry rho and beyond.
    """

    plant: Plant
    signals: Signals
    v_m: tuple[sp.Symbol, ...]
    omega: sp.Symbol
    rates: dict[sp.Symbol, sp.Expr]
    v_m_rates: tuple[sp.Expr, ...]

    @property
    def b_m(self) -> sp.Expr:
        """The leading input coefficient."""
        return self.plant.b[0]

    @property
    def eta(self) -> sp.Expr:
        """What is not known of y' (21)."""
        return unknown_output_rate(self.plant, self.signals)


def unknown_output_rate(plant: Plant, signals: Signals) -> sp.Expr:
    """``eta``: the estimation error epsilon_2 (a plant of order one has none) and a disturbance of y'."""
    error = signals.epsilon[1] if plant.order > 1 else sp.Integer(0)
    return error + output_disturbance(plant)


def omega_expression(plant: Plant, signals: Signals) -> sp.Expr:
    """``Omega``: what is known of y' besides its drive (21), (22).

    The drive is ``b_m v_{m,2}`` for rho >= 2 and ``b_m sigma u`` for rho = 1.
    """
    regressor = sum((entry * th for entry, th in zip(plant.Phi[0], plant.theta, strict=True)), sp.Integer(0))
    if plant.order == 1:
        return plant.phi[0] + regressor
    known = estimate(plant, signals)[1]
    if plant.rho > 1:
        known -= plant.b[0] * input_filters(signals, plant.m)[1]
    return multiplied_out(plant.phi[0] + regressor + known, (signals.y,))


def prepare(plant: Plant, signals: Signals) -> Step:
    """Collect the rates that every step uses."""
    v_m = tuple(parameter_symbol(f"v{plant.m}_{i}") for i in range(1, plant.order + 1))
    omega = parameter_symbol(OMEGA)
    drive = plant.b[0] * v_m[1] if plant.rho > 1 else plant.b[0] * plant.sigma * signals.u
    rates = {signals.y: drive + omega, **filter_rates(plant, signals), **compensator_rates(plant, signals)}
    rates |= dict(zip(signals.y_r, signals.y_r[1:], strict=False))
    v_m_rates = tuple(input_filter_rates(plant, signals, plant.m, sp.Matrix(v_m)))
    return Step(plant, signals, v_m, omega, rates, v_m_rates)


def error_definition(step: Step, i: int) -> sp.Expr:
    """``z_i`` of (24)."""
    s = step.signals
    if i == 1:
        return s.y - s.y_r[0] - s.r[0]
    return step.v_m[i - 1] - s.alpha[i - 2] - s.y_r[i - 1] / step.b_m - s.r[i - 1] / step.b_m


def sensitivity(step: Step, i: int) -> sp.Expr:
    """``s_i``: how eta, which is not known of y', enters z_i', with its sign turned."""
    return (
        sp.Integer(-1)
        if i == 1
        else parameter_symbol(partial_name(step.signals.alpha[i - 2], step.signals.y))
    )


def wanted_rate(step: Step, i: int) -> sp.Expr:
    """The error dynamics that step i asks for: damping, eta, and couplings that cancel in the sum."""
    s, s_i = step.signals, sensitivity(step, i)
    rate = -(s.c[i - 1] + s.e[i - 1] * s_i**2) * s.z[i - 1] - s_i * step.eta
    if i < step.plant.rho:
        rate += step.b_m * s.z[1] if i == 1 else s.z[i]
    if i == 2:
        rate -= step.b_m * s.z[0]
    elif i > 2:
        rate -= s.z[i - 2]
    return rate


def actual_rate(step: Step, i: int, alpha_rate: sp.Expr) -> sp.Expr:
    """``z_i'`` along the loop, with the next virtual control (or v) as the unknown in it; (27), (28).

    Args:
        step: rates of the design.
        i: step number, 1..rho.
        alpha_rate: ``alpha_{i-1}'`` for eta = 0.
    """
    s, rho = step.signals, step.plant.rho
    if i == 1:
        rate = step.rates[s.y] + step.eta - s.y_r[1] - step.rates[s.r[0]]
    else:
        rate = step.v_m_rates[i - 1] - alpha_rate - sensitivity(step, i) * step.eta
        rate -= (s.y_r[i] + step.rates[s.r[i - 1]]) / step.b_m
    if i == rho:
        return rate.xreplace({s.du: s.u - s.v})
    following = (
        s.z[i] + s.alpha[i - 1] + (s.y_r[i] + s.r[i]) / step.b_m
    )  # z_{i+1} of (24), solved for v_{m,i+1}
    return rate.xreplace({step.v_m[i]: following})


def solve_step(step: Step, i: int, alpha_rate: sp.Expr, partials: list[sp.Symbol]) -> sp.Expr:
    """The virtual control alpha_i (25), or v (29) at the last step.

    Raises:
        ArithmeticError: when the solution would need u, an estimation error or a disturbance, that is, when
            the derivation is wrong.
    """
    s = step.signals
    unknown = s.v if i == step.plant.rho else s.alpha[i - 1]
    moving = (s.y,)
    residual = multiplied_out(actual_rate(step, i, alpha_rate) - wanted_rate(step, i), moving)
    slope = shielded(sp.factor, residual.coeff(unknown), moving)
    rest = multiplied_out(residual - residual.coeff(unknown) * unknown, moving)
    hidden = rest.free_symbols & {unknown, s.u, s.du, *s.epsilon, *disturbance_symbols(step.plant)}
    if hidden:
        raise ArithmeticError(f"step {i}: {unknown} would depend on {free(hidden)}")
    return shielded(lambda value: sp.collect(value, partials), -rest, moving) / slope


def total_rate(step: Step, partials: dict[sp.Symbol, sp.Symbol]) -> sp.Expr:
    """``alpha'`` for eta = 0: the sum of partial derivatives times rates in (29), by name."""
    return sum((name * step.rates[by] for by, name in partials.items()), sp.Integer(0))


def backstep(plant: Plant, signals: Signals, units: Units, stage: Stage = unwatched) -> list[Equation]:
    """All named steps of (24)-(29), in the order in which they can be evaluated; each step is told of."""
    step = prepare(plant, signals)
    equations = [*filtered_input_equations(step, units), omega_equation(step, units)]
    chain = ChainRule(signals, units, SECTION)
    chain.add(equations)
    partials: dict[sp.Symbol, sp.Symbol] = {}
    for i in range(1, plant.rho + 1):
        z_i = Equation(
            signals.z[i - 1],
            error_definition(step, i),
            SECTION,
            "(24)",
            f"error {i}",
            units.of(signals.z[i - 1]),
        )
        place = f"step {i} of {plant.rho}"
        stage(f"deriving {f'alpha_{i}' if i < plant.rho else 'v'}, {place}", 0.0)
        law = solve_step(step, i, total_rate(step, partials), list(partials.values()))
        equations.append(z_i)
        chain.add([z_i])
        if i == plant.rho:
            equations.append(Equation(signals.v, law, SECTION, "(29)", "control law", units.of(signals.v)))
            break
        alpha = signals.alpha[i - 1]
        number = "(25)" if i == 1 else ""
        equations.append(Equation(alpha, law, SECTION, number, f"virtual control {i}", units.of(alpha)))
        chain.add(equations[-1:])
        stage(f"deriving partial derivatives of alpha_{i}, {place}", 0.0)
        derivatives, helpers = chain.partials(alpha)
        partials = {by: parameter_symbol(partial_name(alpha, by)) for by in derivatives}
        named = partial_equations(alpha, partials, derivatives, units)
        for by, item in zip(partials, named, strict=True):
            chain.add_partial(alpha, by, item)
        equations += [*helpers, *named]
    return equations


def filtered_input_equations(step: Step, units: Units) -> list[Equation]:
    """``v_{m,i}`` in terms of lambda (14), for the entries that the law uses."""
    plant, s = step.plant, step.signals
    if plant.rho == 1:
        return []
    expressions = input_filters(s, plant.m)
    unit = units.of(s.u)
    return [
        Equation(
            step.v_m[i],
            sp.expand(expressions[i]),
            SECTION,
            "(14)",
            f"entry {i + 1} of A0^{plant.m} lambda",
            unit * SECOND ** (plant.rho - i),
        )
        for i in range(min(plant.rho + 1, plant.order))
    ]


def omega_equation(step: Step, units: Units) -> Equation:
    """``Omega`` as a named equation."""
    expression = omega_expression(step.plant, step.signals)
    unit = units.of(step.signals.y) / SECOND
    return Equation(step.omega, expression, SECTION, "(21)", "what is known of y' besides its drive", unit)


def partial_equations(
    alpha: sp.Symbol, names: dict[sp.Symbol, sp.Symbol], values: dict[sp.Symbol, sp.Expr], units: Units
) -> list[Equation]:
    """Partial derivatives of one virtual control as named equations."""
    return [
        Equation(
            name,
            values[by],
            SECTION,
            "(29)",
            f"partial derivative of {alpha} by {by}",
            units.of(alpha) / units.of(by),
        )
        for by, name in names.items()
    ]


def error_rate_equations(plant: Plant, signals: Signals, units: Units) -> list[Equation]:
    """The error dynamics that the law achieves, exact for any saturation; the basis of (31)."""
    step = prepare(plant, signals)
    return [
        Equation(
            parameter_symbol(f"{symbol.name}_dot"),
            wanted_rate(step, i),
            "Certificate",
            "(27)" if i == 1 else "(28)",
            f"rate of error {i} under the law, whatever u is",
            units.of(symbol) / SECOND,
        )
        for i, symbol in enumerate(signals.z, start=1)
    ]
