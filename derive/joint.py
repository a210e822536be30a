"""How a design reduces a joint, the balance of `pmjoint_derive.balance`, to the plant class.

The pressures are ``P_{1,2} = P_0 +- k_u u``, each clipped to [0, P_max] and, where a time constant tau is
given, following its command with a first-order lag. A design *keeps* some of the physics (damping, torque,
the varying gain, the lag) and leaves the rest to the disturbance. Let ``S(theta)`` be the stiffness and the
kept torque over J, ``b0`` the gain at theta = 0 and ``sigma = gain/b0``:

    n = rho = 2:                   phi = (-a y, S(y)),  b = b0
    n = rho = 3, with a kept lag:  phi = (-(a + 1/tau) y, S(y) - (a/tau) y, S(y)/tau),  b = b0/tau

For n = 2 the paper's ``S = d1 theta`` stands in Phi. The simulated plant always is the full physics, written
in the design's coordinates

    x1 = theta,   x_{i+1} = x_i' - phi_i(y) - Phi_i(y) theta    (rates of the design model),

so that what the design leaves out *is* the disturbance D of (12), and a run can report it. S cancels from
the coordinates, so they are linear in the physical states. A run is started in physical states and reports
them; both directions of that map come from the one table of coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.balance import K_U, OMEGA, THETA, Balance, U, base_pressure
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.kept import (
    B0,
    KAPPA,
    KEEP,
    LAG,
    MOVING,
    P1,
    P2,
    Q1,
    Q2,
    TAU,
    A,
    Kept,
    check_keep,
    effective_input,
    keep_of,
    left_out,
)
from pmjoint_derive.model import Channel, Demand, ExtraState, Plant, Start
from pmjoint_derive.shield import multiplied_out
from pmjoint_derive.units import parse_unit

__all__ = ["KEEP", "LAG", "POSITIVE", "TAKEN", "Joint", "check_keep", "demands", "reduce_joint"]

Y = real_symbol("y")

LENGTHS = ("r", "l0")  # of the muscles
POSITIVE = ("J", *LENGTHS, "k0", "u0", "k_u", "P_max", LAG)  # what (1)-(4) presume to be greater than 0

# reserved names: physical states, commands, pressures, coefficients (8)
TAKEN = ("theta", "theta_dot", "q1", "q2", "p1", "p2", "P1", "P2", "d1", "b0", "a", "kappa")


@dataclass(frozen=True)
class Joint:
    """A design's view of a joint; the fields are those of `Model`.

    Attributes:
        plant: the plant that the controller is designed for; its disturbance is the omitted physics.
        extras: states of the physics that the design does not have.
        channels: the actuator's output: u, and the two pressures' distances from P_0.
        constants: the coefficients (8) as named equations.
        reported: the angle theta, its rate theta_dot and the muscle pressures as named equations.
        demands: assumptions of (1)-(4) on the parameters.
        start: the physical states that a run starts from.
    """

    plant: Plant
    extras: tuple[ExtraState, ...]
    channels: tuple[Channel, ...]
    constants: tuple[Equation, ...]
    reported: tuple[Equation, ...]
    demands: tuple[Demand, ...]
    start: Start


def reduce_joint(
    keep: tuple[str, ...],
    balance: Balance,
    *,
    lagged: bool,
    limits: tuple[sp.Expr, sp.Expr],
    lengths: tuple[str, ...] = LENGTHS,
) -> Joint:
    """Reduce a joint to the plant class.

    Args:
        keep: the physics that the design keeps, from :data:`KEEP`.
        balance: the torques on the joint.
        lagged: whether the pressures follow their commands with the time constant tau.
        limits: lower and upper limit of u.
        lengths: parameters of the muscles that must be positive.

    Raises:
        OutsideClassError: for a lag kept without tau, or together with a gain that varies.
    """
    check_keep(keep, lagged=lagged)
    kept = keep_of(keep, balance)
    forms = _design_coordinates(kept)
    extra_forms = _extra_coordinates(kept.order, lagged=lagged, kept_lag=kept.lag)
    back = _inverse({**forms, **extra_forms}, lagged=lagged)
    seen = {THETA: back[THETA], OMEGA: back[OMEGA]}  # the pressures stay named: q1, q2
    omitted = tuple(value.xreplace(seen) for value in left_out(kept, lagged=lagged))
    extras = tuple(
        ExtraState(
            state, sp.simplify(_lagging(form).xreplace(back)), "Pa", "pressure beyond the design's model"
        )
        for state, form in extra_forms.items()
    )
    motion, lags = _motion(back), _lags(back, lagged=lagged)
    return Joint(
        _design(kept, omitted),
        extras,
        _channels(*limits),
        _constants(kept),
        (*motion, *lags, *_pressures(lagged=lagged)),
        demands(lagged=lagged, lengths=lengths),
        Start((*motion, *lags), len(motion), {**forms, **extra_forms}),
    )


def demands(*, lagged: bool, lengths: tuple[str, ...] = LENGTHS) -> tuple[Demand, ...]:
    """The assumptions of (1)-(4): positive inertia, lengths and pressures, the base pressure below P_max."""
    first, *rest = (name for name in POSITIVE if name not in LENGTHS and (lagged or name != LAG))
    names = (first, *lengths, *rest)
    symbols = (real_symbol(name) for name in names)
    room = real_symbol("P_max") - base_pressure()
    return (
        *(Demand(symbol, symbol) for symbol in symbols),
        Demand(real_symbol("u0"), room, "the base pressure k0*u0 is not below P_max"),
    )


def _constants(kept: Kept) -> tuple[Equation, ...]:
    """Named coefficients, without those of physics that the design does not keep."""
    about = {
        "d1": ("(8)", "1/s^2", "stiffness term"),
        "b0": ("(8)", "rad/(s^2 V)", "input gain, without the second k0 that (8) prints"),
        "a": ("(5)", "1/s", "damping b_v/J, which the paper moves into d"),
        "kappa": ("", "1/rad^2", "quadratic part of the input gain, which (5) leaves out"),
    }
    if not kept.is_paper:
        about["b0"] = ("", "rad/(s^2 V)", "input gain at theta = 0")
    used = {A: kept.a != 0, KAPPA: kept.sigma != 1}
    return tuple(
        Equation(real_symbol(name), kept.named[name], "Plant", number, meaning, parse_unit(unit))
        for name, (number, unit, meaning) in about.items()
        if name in kept.named and used.get(real_symbol(name), True)
    )


def _design(kept: Kept, omitted: tuple[sp.Expr, ...]) -> Plant:
    """The plant class: see the module's first lines."""
    a, zero = kept.a, sp.Integer(0)
    rest, sigma = (value.xreplace({THETA: Y}) for value in (kept.rest, kept.sigma))
    if kept.lag:
        slopes = (-a - 1 / TAU, kept.linear - a / TAU, kept.linear / TAU)
        phi = tuple(slope * Y + term for slope, term in zip(slopes, (zero, rest, rest / TAU), strict=True))
        return Plant(3, phi, ((), (), ()), (), (B0 / TAU,), sigma, omitted)
    Phi, theta = (((zero,), (Y,)), (kept.linear,)) if kept.is_paper else (((), ()), ())
    return Plant(2, (-a * Y, rest), Phi, theta, (B0,), sigma, omitted)


def _design_coordinates(kept: Kept) -> dict[sp.Symbol, sp.Expr]:
    """``x1 = theta`` and ``x_{i+1} = x_i' - phi_i`` along the design's model, in physical states."""
    forms = [THETA, OMEGA + kept.a * THETA]
    if kept.lag:  # x3 = theta'' + (a + 1/tau) theta' - phi_2, where theta'' = S - a theta' + b0 w
        lagging = B0 * effective_input(Q1, Q2)
        forms = [THETA, OMEGA + (kept.a + 1 / TAU) * THETA, lagging + OMEGA / TAU + kept.a / TAU * THETA]
    return {real_symbol(f"x{i}"): multiplied_out(form, MOVING) for i, form in enumerate(forms, start=1)}


def _extra_coordinates(order: int, *, lagged: bool, kept_lag: bool) -> dict[sp.Symbol, sp.Expr]:
    """What physics has beyond the design: both pressures, or only their asymmetry with a kept lag."""
    if not lagged:
        return {}
    forms = (Q1 - Q2,) if kept_lag else (Q1, Q2)
    return {real_symbol(f"x{order + i}"): form for i, form in enumerate(forms, start=1)}


def _lagging(form: sp.Expr) -> sp.Expr:
    """Total derivative of a function of the lagging pressures."""
    rates = {Q1: (P1 - Q1) / TAU, Q2: (P2 - Q2) / TAU}
    return sum((sp.diff(form, state) * rate for state, rate in rates.items()), sp.Integer(0))


def _inverse(forms: dict[sp.Symbol, sp.Expr], *, lagged: bool) -> dict[sp.Symbol, sp.Expr]:
    """Physical states in terms of the simulated plant's states."""
    unknowns = (THETA, OMEGA, Q1, Q2) if lagged else (THETA, OMEGA)
    (solution,) = sp.linsolve([form - state for state, form in forms.items()], unknowns)
    return dict(zip(unknowns, solution, strict=True))


def _channels(lower: sp.Expr, upper: sp.Expr) -> tuple[Channel, ...]:
    """The limited input u, and both pressures' distances from P_0, clipped at an empty or full muscle."""
    P0, P_max, k_u, zero = base_pressure(), real_symbol("P_max"), K_U, sp.Integer(0)
    least, most = k_u * lower, k_u * upper
    return (
        Channel(U, zero, sp.Integer(1), lower, upper, "V", "applied input sat(v)"),
        Channel(P1, zero, k_u, sp.Max(-P0, least), sp.Min(P_max - P0, most), "Pa", "command of P1 - P_0"),
        Channel(P2, zero, k_u, sp.Max(P0 - P_max, least), sp.Min(P0, most), "Pa", "command of P_0 - P2"),
    )


def _motion(back: dict[sp.Symbol, sp.Expr]) -> tuple[Equation, ...]:
    """Angle and angular velocity in the plant's states: x2 is neither where the design keeps damping."""
    labels = {THETA: ("joint angle", "rad"), OMEGA: ("angular velocity", "rad/s")}
    return tuple(
        Equation(state, back[state], "Plant", "(1)", label, parse_unit(unit))
        for state, (label, unit) in labels.items()
    )


def _lags(back: dict[sp.Symbol, sp.Expr], *, lagged: bool) -> tuple[Equation, ...]:
    """Lagging pressures, as distances from P_0, in the plant's states."""
    labels = {Q1: "pressure of muscle 1 above P_0", Q2: "pressure of muscle 2 below P_0"}
    pascal = parse_unit("Pa")
    return tuple(
        Equation(q, sp.factor(back[q]), "Plant", "(4)", label, pascal)
        for q, label in labels.items()
        if lagged
    )


def _pressures(*, lagged: bool) -> tuple[Equation, ...]:
    P0, pascal = base_pressure(), parse_unit("Pa")
    first, second = (Q1, Q2) if lagged else (P1, P2)
    return (
        Equation(real_symbol("P1"), P0 + first, "Plant", "(4)", "pressure of muscle 1", pascal),
        Equation(real_symbol("P2"), P0 - second, "Plant", "(4)", "pressure of muscle 2", pascal),
    )
