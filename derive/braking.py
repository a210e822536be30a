"""A compensator that brakes like the actuator can: r_1 returns along a square-root curve, for rho = 2.

``r_1' = r_2 - g(r_1)`` and ``r_2' = -ck_2 r_2 + b_m sigma du``, ``g(r) = ck_1 r/(1 + (r/l)^2)^(1/4)``, ``l =
2 braking b_m u_M/ck_1^2``. Near 0, g is the linear ck_1 r of (23). Far away it is ``sqrt(2 braking b_m u_M
|r|)``: the speed from which a share ``braking`` of the limit u_M stops a double integrator at r = 0. The
identities (27), (28) hold for any g, so the certificate (19)-(35) is that of (23). g is smooth.

The sampled controller advances r_2 by its exact hold and r_1 by one step of the classical Runge-Kutta method
a hold, with r_2 exact at its beginning, middle and end. The matrix ``diag(0, -ck_2/2, -ck_2)`` gives all that
this needs: the integral of ``expm`` of its first entry is T itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import sympy as sp

from pmjoint_derive.design import Derivation, Design
from pmjoint_derive.equation import Equation, Equations, Identity, real_symbol
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND

RANGE = real_symbol("braking_range")
RATE = real_symbol("braking_rate")
_T = sp.Symbol("T")  # of the ring
_ORDER = 4  # of the Runge-Kutta method

Slope = Callable[[sp.Expr], sp.Expr]


def braking_equations(design: Design) -> list[Equation]:
    """``l`` and ``g(r_1)`` as named equations."""
    s, units = design.signals, design.units
    (share,), u_max, ck = s.braking, design.limit, s.ck[0]
    reach = 2 * share * design.plant.b[0] * u_max / ck**2
    speed = ck * s.r[0] / (1 + (s.r[0] / RANGE) ** 2) ** sp.Rational(1, 4)
    y = units.of(s.y)
    about = "r1 beyond which the compensator brakes as the limit of u allows"
    return [
        Equation(RANGE, reach, "Compensator", "", about, y),
        Equation(RATE, speed, "Compensator", "", "speed at which r1 returns, c_k1 r1 near 0", y / SECOND),
    ]


def braking_update(
    design: Design, equations: Equations, F: sp.MatrixBase, G: sp.MatrixBase
) -> tuple[list[Equation], dict[sp.Symbol, sp.Expr]]:
    """The steps of the Runge-Kutta method as named equations, and r one sample later.

    Args:
        design: the design.
        equations: the continuous loop.
        F: ``expm`` of `compensator_matrix` times T.
        G: its integral over the hold.
    """
    s, units = design.signals, design.units
    r1, r2 = s.r
    drive = equations[derivative_name(r2)].expression.xreplace({r2: sp.Integer(0)})
    middle = real_symbol("r2_middle")
    ends = (F[1, 1] * r2 + G[1, 1] / 2 * drive, F[2, 2] * r2 + G[2, 2] * drive)
    end = real_symbol(f"{r2.name}_next")
    speed = equations[RATE.name].expression
    names = tuple(real_symbol(f"r1_slope{i}") for i in range(1, 5))
    slopes = stage_slopes(lambda at: speed.xreplace({r1: at}), r1, (r2, middle, end), G[0, 0], names)
    steps = [Equation(middle, ends[0], "Sampled", "", "r2 half a sample later", units.of(r2))]
    steps += [
        Equation(name, slope, "Sampled", "", f"slope {i} of r1 by Runge and Kutta", units.of(r1) / SECOND)
        for i, (name, slope) in enumerate(zip(names, slopes, strict=True), start=1)
    ]
    return steps, {r1: combined(r1, G[0, 0], names), r2: ends[1]}


def stage_slopes(
    g: Slope, r1: sp.Expr, r2: Sequence[sp.Expr], period: sp.Expr, names: Sequence[sp.Expr]
) -> tuple[sp.Expr, ...]:
    """The four slopes of the classical Runge-Kutta method, each in the name of the one before it.

    Args:
        g: of r_1.
        r1: at the sample.
        r2: at the sample, half a hold later, at its end.
        period: T.
        names: of the slopes.
    """
    begin, middle, end = r2
    return (
        begin - g(r1),
        middle - g(r1 + period * names[0] / 2),
        middle - g(r1 + period * names[1] / 2),
        end - g(r1 + period * names[2]),
    )


def combined(r1: sp.Expr, period: sp.Expr, slopes: Sequence[sp.Expr]) -> sp.Expr:
    """r_1 at the end of the step."""
    first, second, third, fourth = slopes
    return r1 + period * (first + 2 * second + 2 * third + fourth) / 6


def braking_identities(derivation: Derivation, F: sp.MatrixBase, G: sp.MatrixBase) -> list[Identity]:
    """r_2 is exact for held inputs; r_1 agrees with the solution up to T^4, for any g.

    The second is proved in the method's own form: expand it in powers of T for a polynomial g of unknown
    coefficients, which all that matters up to T^4 is, and compare with the derivatives along the solution.
    """
    s, equations = derivation.signals, derivation.equations
    keep = frozenset({s.y, s.u, s.v})
    r2 = s.r[1]
    rate, update = (
        equations.expand(equations[name].expression, keep) for name in (derivative_name(r2), f"{r2}_next")
    )
    rest = update - F[2, 2] * r2 - G[2, 2] * (rate + s.ck[1] * r2)
    exact = Identity(f"{r2}_next", f"{r2} one sample later is exact for held inputs", sp.expand(rest))
    return [exact, _as_built(derivation, F, G), *_order_identities()]


def _as_built(derivation: Derivation, F: sp.MatrixBase, G: sp.MatrixBase) -> Identity:
    """The named steps are those of the method, for the model's own g."""
    s, equations = derivation.signals, derivation.equations
    keep = frozenset({s.y, s.u, s.v})
    (r1, r2), drive = s.r, real_symbol("drive")
    rate = equations.expand(equations[derivative_name(r2)].expression, keep).xreplace({r2: sp.Integer(0)})
    g = equations.expand(equations[RATE.name].expression, keep)
    at = (r2, F[1, 1] * r2 + G[1, 1] / 2 * drive, F[2, 2] * r2 + G[2, 2] * drive)
    known: list[sp.Expr] = []
    for i in range(4):
        padded = (*known, *(sp.Integer(0),) * (4 - len(known)))
        known.append(stage_slopes(lambda place: g.xreplace({r1: place}), r1, at, G[0, 0], padded)[i])
    whole = combined(r1, G[0, 0], known).xreplace({drive: rate})
    found = equations.expand(equations[f"{r1}_next"].expression, keep)
    # Not expanded: both are written alike, and powers of nested sums would take minutes.
    return Identity(f"{r1}_next", f"{r1} one sample later is one step of Runge and Kutta", found - whole)


def _order_identities() -> list[Identity]:
    """Powers of T of the step and of the solution, from r_1 = 0, which a shift of g's argument makes any.

    In a polynomial ring, where powers beyond the method's order are dropped at once.
    """
    _, T, r1, r2, ck, drive, *unknown = sp.ring(f"T, r1, r2, ck, drive, g:{_ORDER + 1}", sp.QQ)

    def g(at: Any) -> Any:
        value = unknown[-1]
        for c in reversed(unknown[:-1]):
            value = _truncated(value * at) + c
        return value

    def held(period: Any) -> Any:  # r2 after a time, in powers of it
        rate, value = drive - ck * r2, r2
        for i in range(1, _ORDER + 1):
            value, rate = value + rate * period**i / math.factorial(i), -ck * rate
        return value

    known: list[Any] = []
    for i in range(4):
        padded = (*known, *(T * 0,) * (4 - len(known)))
        known.append(_truncated(stage_slopes(g, T * 0, (r2, held(T / 2), held(T)), T, padded)[i]))
    step = _truncated(combined(T * 0, T, known))
    found, derivative = [], r1
    for order in range(_ORDER + 1):
        wanted = derivative.evaluate(r1, 0).set_ring(step.ring) / math.factorial(order)
        rest = (step - wanted * T**order).as_expr().coeff(_T, order)
        claim = f"Runge and Kutta's step has the solution's power {order} of T, for any g"
        found.append(Identity(f"r1_next, T^{order}", claim, sp.expand(rest)))
        speed = r2 - sum(c * r1**i for i, c in enumerate(unknown))
        derivative = derivative.diff(r1) * speed + derivative.diff(r2) * (drive - ck * r2)
    return found


def _truncated(value: Any) -> Any:
    """A polynomial without powers of T, its first variable, beyond the method's order."""
    return value.ring.from_dict({powers: c for powers, c in value.items() if powers[0] <= _ORDER})
