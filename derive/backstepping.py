"""Backstepping with saturation compensator (24)-(29), for general relative degree.

Only three things are stated here: the errors z_i (24), the error dynamics that the design requires, and
the output's rate from the filters (21). Every virtual control alpha_i, every partial derivative and the
law v follow by solving

    z_i' = -(c_i + e_i s_i^2) z_i - s_i eta - g_i + (coupling to z_{i+1}),
    s_1 = -1,  s_i = d alpha_{i-1} / dy,

for the one unknown in it. With ``g_2 = b_m z_1`` and ``g_i = z_{i-1}`` the couplings cancel in the sum of
squares, which is what the certificate (19)-(35) rests on. ``eta = epsilon_2 + D_1`` is the unknown part of
y'; the paper's D_1 is 0. It and the input u drop out of the solutions; both are checked.

That is for the paper's input. The parameter ``input_scale``, kappa > 0, makes the law that of the input
``kappa u``, whose errors are ``kappa z_i`` from step 2 on: ``g_2 = (b_m/kappa^2) z_1``, and ``kappa^2 e_i``
stands for e_i. So the couplings cancel in ``z_1^2 + kappa^2 (z_2^2 + ... + z_rho^2)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from pmjoint_derive.braking import braking_equations, braking_update
from pmjoint_derive.certificate import certificate_equations
from pmjoint_derive.closed_loop import disturbance_symbols, unknown_output_rate
from pmjoint_derive.compensator import compensator_equations, compensator_rates
from pmjoint_derive.design import Design, Sampled
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.filters import (
    estimate,
    filter_equations,
    filter_rates,
    input_filter_rates,
    input_filters,
)
from pmjoint_derive.hold import Hold
from pmjoint_derive.lyapunov import prove
from pmjoint_derive.partials import ChainRule
from pmjoint_derive.progress import Stage, unwatched
from pmjoint_derive.shield import multiplied_out, shielded
from pmjoint_derive.signals import Units, free, partial_name
from pmjoint_derive.units import SECOND

SECTION = "Backstepping"
OMEGA = "Omega"

Partials = Mapping[sp.Symbol, sp.Symbol]  # signal -> name of a virtual control's derivative by it


@dataclass(frozen=True)
class Backstepping(Design):
    """The paper's design, with what every step uses."""

    decays = True

    @cached_property
    def v_m(self) -> tuple[sp.Symbol, ...]:
        """Symbols of v_{m,1} ... v_{m,n}: the filtered input, each step's virtual control."""
        return tuple(real_symbol(f"v{self.plant.m}_{i}") for i in range(1, self.plant.order + 1))

    @cached_property
    def omega(self) -> sp.Symbol:
        """Symbol of the known part of y' (21) besides ``b_m v_{m,2}``."""
        return real_symbol(OMEGA)

    @cached_property
    def rates(self) -> dict[sp.Symbol, sp.Expr]:
        """Time derivatives of y, the controller's state and the reference, with eta = 0."""
        s = self.signals
        drive = self.b_m * self.v_m[1] if self.plant.rho > 1 else self.b_m * self.plant.sigma * s.u
        following = dict(zip(s.y_r, s.y_r[1:], strict=False))
        return {
            s.y: drive + self.omega,
            **filter_rates(self),
            **self.compensator_rates,
            **following,
            **self.inverse_rate,
        }

    @property
    def inverse_rate(self) -> dict[sp.Symbol, sp.Expr]:
        """Rate of an estimate of 1/b_m; this design has none."""
        return {}

    @cached_property
    def compensator_rates(self) -> dict[sp.Symbol, sp.Expr]:
        """Rates of the compensator's states (23)."""
        return compensator_rates(self)

    @cached_property
    def v_m_rates(self) -> tuple[sp.Expr, ...]:
        """Time derivatives of `v_m`; u occurs in entry rho and beyond."""
        return tuple(input_filter_rates(self, self.plant.m, sp.Matrix(self.v_m)))

    @property
    def b_m(self) -> sp.Expr:
        """The leading input coefficient."""
        return self.plant.b[0]

    @property
    def eta(self) -> sp.Expr:
        """The unknown part of y' (21)."""
        return unknown_output_rate(self)

    def sampled(self, equations: Equations, hold: Hold) -> Sampled:
        """R: exact for (23), one step of Runge and Kutta for a braking compensator's r_1."""
        if not self.signals.braking:
            return super().sampled(equations, hold)
        return braking_update(self, equations, hold.Fr, hold.Gr)

    filters = filter_equations
    compensator = compensator_equations
    prove = staticmethod(prove)
    certificate = staticmethod(certificate_equations)

    def law(self, stage: Stage = unwatched) -> list[Equation]:
        """(24)-(29)."""
        return backstep(self, stage)

    def prepared(self) -> list[Equation]:
        """What the errors and virtual controls are made of, by name."""
        equations = [*filtered_input_equations(self), omega_equation(self)]
        return equations + (braking_equations(self) if self.signals.braking else [])

    def held(self, i: int) -> sp.Expr:
        """What error i >= 2 holds besides ``v_{m,i} - alpha_{i-1}``, with reversed sign (24)."""
        s = self.signals
        return (s.y_r[i - 1] + s.r[i - 1]) / self.b_m

    def held_rate(self, i: int) -> sp.Expr:
        """Its rate."""
        s = self.signals
        return (s.y_r[i] + self.rates[s.r[i - 1]]) / self.b_m

    def step(self, i: int, known: Sequence[Partials]) -> list[Equation]:
        """Virtual control i (25), or v (29) at the last step, as the last of some named equations.

        Args:
            i: step number, 1..rho.
            known: partial derivatives of the virtual controls before it, by signal.
        """
        s, partials = self.signals, known[-1] if known else {}
        slope, rest = solve_step(self, i, total_rate(self, partials), list(partials.values()))
        if i == self.plant.rho:
            return [Equation(s.v, rest / slope, SECTION, "(29)", "control law", self.units.of(s.v))]
        alpha = s.alpha[i - 1]
        number = "(25)" if i == 1 else ""
        return [Equation(alpha, rest / slope, SECTION, number, f"virtual control {i}", self.units.of(alpha))]

    def error_rates(self) -> list[Equation]:
        """The error dynamics that the law achieves, exact for any saturation; the basis of (31)."""
        return [
            Equation(
                real_symbol(f"{symbol.name}_dot"),
                wanted_rate(self, i),
                "Certificate",
                "(27)" if i == 1 else "(28)",
                f"rate of error {i} under the law, whatever u is",
                self.units.of(symbol) / SECOND,
            )
            for i, symbol in enumerate(self.signals.z, start=1)
        ]


def omega_expression(design: Design) -> sp.Expr:
    """``Omega``: the known part of y' besides its drive (21), (22).

    The drive is ``b_m v_{m,2}`` for rho >= 2 and ``b_m sigma u`` for rho = 1.
    """
    plant, signals = design.plant, design.signals
    if plant.order == 1:
        return plant.drift[0]
    known = estimate(plant, signals)[1]
    if plant.rho > 1:
        known -= plant.b[0] * input_filters(signals, plant.m)[1]
    return multiplied_out(plant.drift[0] + known, (signals.y,))


def error_definition(step: Backstepping, i: int) -> sp.Expr:
    """``z_i`` of (24)."""
    s = step.signals
    if i == 1:
        return s.y - s.y_r[0] - s.r[0]
    return multiplied_out(step.v_m[i - 1] - s.alpha[i - 2] - step.held(i), (s.y,))


def sensitivity(step: Backstepping, i: int) -> sp.Expr:
    """``s_i``: the factor of eta, the unknown part of y', in z_i', with reversed sign."""
    return sp.Integer(-1) if i == 1 else real_symbol(partial_name(step.signals.alpha[i - 2], step.signals.y))


def wanted_rate(step: Backstepping, i: int) -> sp.Expr:
    """The error dynamics that step i requires: damping, eta, and couplings that cancel in the sum of V."""
    s, s_i = step.signals, sensitivity(step, i)
    weight = s.weights[i - 1]
    rate = -(s.c[i - 1] + weight * s.e[i - 1] * s_i**2) * s.z[i - 1] - s_i * step.eta
    if i < step.plant.rho:
        rate += step.b_m * s.z[1] if i == 1 else s.z[i]
    if i == 2:
        rate -= step.b_m / weight * s.z[0]
    elif i > 2:
        rate -= s.z[i - 2]
    return rate


def actual_rate(step: Backstepping, i: int, alpha_rate: sp.Expr) -> sp.Expr:
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
        rate -= step.held_rate(i)
    if i == rho:
        return rate.xreplace({s.du: s.u - s.v})
    following = s.z[i] + s.alpha[i - 1] + step.held(i + 1)  # z_{i+1} of (24), solved for v_{m,i+1}
    return rate.xreplace({step.v_m[i]: following})


def solve_step(
    step: Backstepping, i: int, alpha_rate: sp.Expr, partials: list[sp.Symbol]
) -> tuple[sp.Expr, sp.Expr]:
    """Slope and value of ``slope alpha_i = value`` (25), or of ``slope v = value`` (29) at the last step.

    Raises:
        ArithmeticError: if the solution would need u, an estimation error or a disturbance, that is, when
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
    return slope, shielded(lambda value: sp.collect(value, partials), -rest, moving)


def total_rate(step: Backstepping, partials: Partials) -> sp.Expr:
    """``alpha'`` for eta = 0: the sum of partial derivatives times rates in (29), by name."""
    moving = ((name, step.rates[by]) for by, name in partials.items() if by in step.rates)
    return sum((name * rate for name, rate in moving), sp.Integer(0))


def backstep(step: Backstepping, stage: Stage = unwatched) -> list[Equation]:
    """All named steps of (24)-(29), in the order in which they can be evaluated; each step is reported."""
    plant, signals, units = step.plant, step.signals, step.units
    equations = step.prepared()
    chain = ChainRule(signals, units, SECTION)
    chain.add(equations)
    known: list[Partials] = []
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
        law = step.step(i, known)
        equations += [z_i, *law]
        chain.add([z_i, *law])
        if i == plant.rho:
            break
        alpha = signals.alpha[i - 1]
        stage(f"deriving partial derivatives of alpha_{i}, {place}", 0.0)
        derivatives, helpers = chain.partials(alpha)
        partials = {by: real_symbol(partial_name(alpha, by)) for by in derivatives}
        known.append(partials)
        named = partial_equations(alpha, partials, derivatives, units)
        for by, item in zip(partials, named, strict=True):
            chain.add_partial(alpha, by, item)
        equations += [*helpers, *named]
    return equations


def filtered_input_equations(step: Backstepping) -> list[Equation]:
    """``v_{m,i}`` in terms of lambda (14), for the entries that the law uses."""
    plant, s = step.plant, step.signals
    if plant.rho == 1:
        return []
    expressions = input_filters(s, plant.m)
    unit = step.units.of(s.u)
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


def omega_equation(step: Backstepping) -> Equation:
    """``Omega`` as a named equation."""
    expression = omega_expression(step)
    unit = step.units.of(step.signals.y) / SECOND
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
