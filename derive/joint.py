"""The antagonistic joint (1)-(4), and how a design reduces it to the plant class.

Held symbolically: ``J theta'' + b_v theta' = r (F1 - F2) + vartheta``, ``F_i = P_i (C1 eps_i^2 + C2 eps_i +
C3) + C4``, ``eps_{1,2} = eps0 +- r theta / l0``, ``P_{1,2} = k0 u0 +- k_u u``, each pressure clipped to [0,
P_max] and, where a time constant tau is given, following its command with a first-order lag. SymPy expands
this balance; its coefficients are (5)-(8), corrected: no second k0 in the input gain, the term in theta^2 u
kept, vartheta divided by J.

A design *keeps* some of the physics (damping, the quadratic gain, the lag) and leaves the rest to the
disturbance. The simulated plant always is the full physics, written in the design's coordinates

    x1 = theta,   x_{i+1} = x_i' - phi_i(y) - Phi_i(y) theta    (rates of the design model),

so that what the design leaves out *is* the disturbance D of (12), and a run can report it. A run is started
in physical states and reports them; both directions of that map come from the one table of coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from pmjoint_derive.equation import Equation
from pmjoint_derive.model import (
    Channel,
    Demand,
    ExtraState,
    OutsideClassError,
    Plant,
    Start,
    real_symbol,
)
from pmjoint_derive.shield import multiplied_out, shielded
from pmjoint_derive.units import parse_unit

KEEP = ("damping", "quadratic_gain", "pressure_lag")
LAG = "tau"
MOVING = (real_symbol("t"),)  # of the torque: what is said of theta, (1)-(4) must be multiplied out to cancel
THETA, OMEGA, U, Y = (real_symbol(name) for name in ("theta", "theta_dot", "u", "y"))
Q1, Q2, P1, P2 = (
    real_symbol(name) for name in ("q1", "q2", "p1", "p2")
)  # pressures' distance from P_0, and their commands

POSITIVE = ("J", "r", "l0", "k0", "u0", "k_u", "P_max", LAG)  # what (1)-(4) presume to be greater than 0

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


def force(pressure: sp.Expr, contraction: sp.Expr) -> sp.Expr:
    """Pulling force of one muscle (2)."""
    C1, C2, C3, C4 = (real_symbol(name) for name in ("C1", "C2", "C3", "C4"))
    return pressure * (C1 * contraction**2 + C2 * contraction + C3) + C4


def acceleration(first: sp.Expr, second: sp.Expr, vartheta: sp.Expr) -> sp.Expr:
    """``theta''`` from the balance (1) with (2), (3), for given muscle pressures."""
    J, b_v, r, l0, eps0 = (real_symbol(name) for name in ("J", "b_v", "r", "l0", "eps0"))
    stretch = r * THETA / l0
    torque = r * (force(first, eps0 + stretch) - force(second, eps0 - stretch))
    return (-b_v * OMEGA + torque + vartheta) / J


def base_pressure() -> sp.Expr:
    """``P_0 = k_0 u_0`` of (4)."""
    return real_symbol("k0") * real_symbol("u0")


def coefficients() -> dict[str, sp.Expr]:
    """``d1``, ``b0``, damping ``a`` and quadratic gain ``kappa``, read off the expanded balance (5)-(8).

    Raises:
        ArithmeticError: when the balance holds a monomial that the class does not know, that is, when (1)-(4)
            were changed.
    """
    P0, k_u = base_pressure(), real_symbol("k_u")
    balance = sp.Poly(sp.expand(acceleration(P0 + k_u * U, P0 - k_u * U, sp.Integer(0))), THETA, OMEGA, U)
    terms = {monomial: sp.factor(value) for monomial, value in balance.terms()}
    stiffness, damping, gain, quadratic = (terms.pop(m) for m in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 1)))
    if terms:
        raise ArithmeticError(f"the balance (1)-(4) holds further monomials: {sorted(terms)}")
    return {"d1": stiffness, "b0": gain, "a": -damping, "kappa": sp.factor(quadratic / gain)}


def reduce_joint(
    keep: tuple[str, ...], *, lagged: bool, vartheta: sp.Expr, limits: tuple[sp.Expr, sp.Expr]
) -> Joint:
    """Reduce (1)-(4) to the plant class.

    Args:
        keep: the physics that the design keeps, from :data:`KEEP`.
        lagged: whether the pressures follow their commands with the time constant tau.
        vartheta: disturbance torque, a function of t and parameters.
        limits: lower and upper limit of u.

    Raises:
        OutsideClassError: for a lag kept without tau, or together with the quadratic gain.
    """
    check_keep(keep, lagged=lagged)
    a = real_symbol("a") if "damping" in keep else sp.Integer(0)
    kept_lag = "pressure_lag" in keep
    design = _lagged_design(a) if kept_lag else _direct_design(a, quadratic="quadratic_gain" in keep)
    forms = _design_coordinates(design, a)
    extra_forms = _extra_coordinates(design.order, lagged=lagged, kept_lag=kept_lag)
    rates = _physical_rates(vartheta, lagged=lagged)
    back = _inverse({**forms, **extra_forms}, lagged=lagged)
    seen = {THETA: back[THETA], OMEGA: back[OMEGA]}  # the pressures stay named: q1, q2
    left_out = tuple(value.xreplace(seen) for value in _left_out(design, forms, rates))
    extras = tuple(
        ExtraState(
            state, sp.simplify(_along(form, rates).xreplace(back)), "Pa", "pressure beyond the design's model"
        )
        for state, form in extra_forms.items()
    )
    motion, lags = _motion(back), _lags(back, lagged=lagged)
    return Joint(
        replace(design, disturbance=left_out),
        extras,
        _channels(*limits),
        _constants(keep),
        (*motion, *lags, *_pressures(lagged=lagged)),
        demands(lagged=lagged),
        Start((*motion, *lags), len(motion), {**forms, **extra_forms}),
    )


def demands(*, lagged: bool) -> tuple[Demand, ...]:
    """The assumptions of (1)-(4): positive inertia, lengths and pressures, the base pressure below P_max."""
    names = (name for name in POSITIVE if lagged or name != LAG)
    symbols = (real_symbol(name) for name in names)
    room = real_symbol("P_max") - base_pressure()
    return (
        *(Demand(symbol, symbol) for symbol in symbols),
        Demand(real_symbol("u0"), room, "the base pressure k0*u0 is not below P_max"),
    )


def check_keep(keep: tuple[str, ...], *, lagged: bool) -> None:
    """Refuse what no design can keep.

    Raises:
        OutsideClassError: naming the key and the reason.
    """
    for item in keep:
        if item not in KEEP:
            raise OutsideClassError(
                "joint.keep", f"{item!r} is nothing that a design can keep", f"allowed: {', '.join(KEEP)}"
            )
    if "pressure_lag" in keep and not lagged:
        raise OutsideClassError(
            "joint.tau", "a pressure lag is kept but has no time constant", "give tau in [joint], in s"
        )
    if {"pressure_lag", "quadratic_gain"} <= set(keep):
        raise OutsideClassError(
            "joint.keep",
            "a lag together with sigma(y) != 1 multiplies y by the pressure, which is not measured",
            "keep one of pressure_lag and quadratic_gain; the other is simulated as a disturbance",
        )


def _constants(keep: tuple[str, ...]) -> tuple[Equation, ...]:
    about = {
        "d1": ("(8)", "1/s^2", "stiffness term"),
        "b0": ("(8)", "rad/(s^2 V)", "input gain, without the second k0 that (8) prints"),
        "a": ("(5)", "1/s", "damping b_v/J, which the paper moves into d"),
        "kappa": ("", "1/rad^2", "quadratic part of the input gain, which (5) leaves out"),
    }
    kept = (
        {"d1", "b0"}
        | ({"a"} if "damping" in keep else set())
        | ({"kappa"} if "quadratic_gain" in keep else set())
    )
    return tuple(
        Equation(real_symbol(name), value, "Plant", number, meaning, parse_unit(unit))
        for name, value in coefficients().items()
        if name in kept
        for number, unit, meaning in (about[name],)
    )


def _direct_design(a: sp.Expr, *, quadratic: bool) -> Plant:
    """Coefficients for n = rho = 2: ``x1' = x2 - a y``, ``x2' = d1 y + b0 sigma(y) u``."""
    zero, d1, b0 = sp.Integer(0), real_symbol("d1"), real_symbol("b0")
    sigma = 1 + real_symbol("kappa") * Y**2 if quadratic else sp.Integer(1)
    return Plant(2, (-a * Y, zero), ((zero,), (Y,)), (d1,), (b0,), sigma, (zero, zero))


def _lagged_design(a: sp.Expr) -> Plant:
    """Coefficients for n = rho = 3: observer form of joint and lag, from the characteristic polynomial."""
    zero, tau = sp.Integer(0), real_symbol(LAG)
    d1, b0, s = real_symbol("d1"), real_symbol("b0"), sp.Symbol("s")
    series = sp.Matrix([[0, 1, 0], [d1, -a, b0], [0, 0, -1 / tau]])
    _, *lower = sp.Poly(series.charpoly(s).as_expr(), s).all_coeffs()
    phi = tuple(-sp.expand(value) * Y for value in lower)
    return Plant(3, phi, ((), (), ()), (), (b0 / tau,), sp.Integer(1), (zero, zero, zero))


def _effective_input() -> sp.Expr:
    """The input equivalent to the present pressures."""
    return (Q1 + Q2) / (2 * real_symbol("k_u"))


def _physical_rates(vartheta: sp.Expr, *, lagged: bool) -> dict[sp.Symbol, sp.Expr]:
    """Rates of theta, theta' and, where they lag, of the pressures' distances from P_0."""
    P0, tau = base_pressure(), real_symbol(LAG)
    rates: dict[sp.Symbol, sp.Expr] = {THETA: OMEGA, OMEGA: acceleration(P0 + Q1, P0 - Q2, vartheta)}
    if lagged:
        return {**rates, Q1: (P1 - Q1) / tau, Q2: (P2 - Q2) / tau}
    return {state: rate.xreplace({Q1: P1, Q2: P2}) for state, rate in rates.items()}


def _design_coordinates(design: Plant, a: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    """``x1 = theta`` and ``x_{i+1} = x_i' - phi_i`` along the design's model, in physical states."""
    d1, b0 = real_symbol("d1"), real_symbol("b0")
    rates = {THETA: OMEGA, OMEGA: d1 * THETA - a * OMEGA + b0 * _effective_input()}
    forms: list[sp.Expr] = [THETA]
    for i in range(design.order - 1):
        forms.append(multiplied_out(_along(forms[-1], rates) - design.phi[i].xreplace({Y: THETA}), MOVING))
    return {real_symbol(f"x{i}"): form for i, form in enumerate(forms, start=1)}


def _extra_coordinates(order: int, *, lagged: bool, kept_lag: bool) -> dict[sp.Symbol, sp.Expr]:
    """What physics has beyond the design: both pressures, or only their asymmetry with a kept lag."""
    if not lagged:
        return {}
    forms = (Q1 - Q2,) if kept_lag else (Q1, Q2)
    return {real_symbol(f"x{order + i}"): form for i, form in enumerate(forms, start=1)}


def _along(form: sp.Expr, rates: dict[sp.Symbol, sp.Expr]) -> sp.Expr:
    """Total derivative of a function of the states."""
    return sum((sp.diff(form, state) * rate for state, rate in rates.items()), sp.Integer(0))


def _inverse(forms: dict[sp.Symbol, sp.Expr], *, lagged: bool) -> dict[sp.Symbol, sp.Expr]:
    """Physical states in terms of the simulated plant's states."""
    unknowns = (THETA, OMEGA, Q1, Q2) if lagged else (THETA, OMEGA)
    (solution,) = sp.linsolve([form - state for state, form in forms.items()], unknowns)
    return dict(zip(unknowns, solution, strict=True))


def _left_out(
    design: Plant, forms: dict[sp.Symbol, sp.Expr], rates: dict[sp.Symbol, sp.Expr]
) -> tuple[sp.Expr, ...]:
    """``D`` of (12): rates of the full physics less those of the design, in physical states and u."""
    values = {real_symbol(name): value for name, value in coefficients().items()}
    states = [*forms.values(), sp.Integer(0)]
    return tuple(
        _collected(
            multiplied_out(
                (_along(states[i], rates) - states[i + 1] - drift.xreplace({Y: THETA})).xreplace(values),
                MOVING,
            )
        )
        - (design.b_vector[i] * design.sigma * U).xreplace({Y: THETA})
        for i, drift in enumerate(design.drift)
    )


def _collected(value: sp.Expr) -> sp.Expr:
    """Terms by pressure and speed, each coefficient factored."""
    return shielded(lambda whole: sp.collect(whole, (Q1, Q2, P1, P2, OMEGA), sp.factor), value, MOVING)


def _channels(lower: sp.Expr, upper: sp.Expr) -> tuple[Channel, ...]:
    """The limited input u, and both pressures' distances from P_0, clipped at an empty or full muscle."""
    P0, P_max, k_u, zero = base_pressure(), real_symbol("P_max"), real_symbol("k_u"), sp.Integer(0)
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
