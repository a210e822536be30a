"""ADRC, a design to compare with: a linear extended-state observer, and a law that cancels what it estimates.

The plant of the class with rho = n, in observer form, has all that its model leaves out in its last rate:

    x_i' = x_{i+1} + drift_i(y),   x_n' = drift_n(y) + b_0 sigma(y) u + f,   drift = phi + Phi theta.

The observer takes f for a state more, ``x_{n+1} = f`` and ``f' = 0``, with the applied input and the measured
y; its n + 1 poles are at ``-observer``, so ``l_i = binomial(n + 1, i) observer^i``. Its error obeys ``A0 =
shift - l e1'`` whatever u is. The law counts on it: with the derivatives of y that the model has at the
estimate, ``eta_0 = x_hat_1``, ``eta_1 = x_hat_2 + drift_1(x_hat_1)``, ..., and ``z_i = eta_{i-1} -
y_r^{(i-1)}``, it gives ``z_n' = -(a_1 z_1 + ... + a_n z_n)`` with the poles ``-c_1, ..., -c_n``.

A sampled observer steps ``x_hat + T x_hat'`` with the rate at the sample: an exact hold of y lags the true y
by half a sample on the average, which a high gain takes for a disturbance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import sympy as sp

from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.compensator import switched
from pmjoint_derive.design import Derivation, Design, Sampled
from pmjoint_derive.equation import Equation, Equations, Identity, real_symbol
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.hold import Hold
from pmjoint_derive.model import OutsideClassError, Plant
from pmjoint_derive.progress import Stage
from pmjoint_derive.signals import Signals, derivative_name, named
from pmjoint_derive.units import SECOND
from pmjoint_derive.vanishing import expand_to_zero

SECTION = "ADRC"
KNOWN = real_symbol("Omega")


@dataclass(frozen=True)
class Adrc(Design):
    """The observer, the law, and no certificate.

    States of the observer are ``eso1`` to ``eso{n+1}``: estimates of x, then that of f.
    """

    certifies: ClassVar[bool] = False
    exact_hold: ClassVar[bool] = False

    @classmethod
    def signals_for(cls, plant: Plant, adaptation: Adaptation | None) -> Signals:
        """The block xi holds the observer; there are no other filters and no compensator.

        Raises:
            OutsideClassError: a plant with zeros, or something to be estimated.
        """
        if plant.m > 0:
            raise OutsideClassError(
                "plant.b",
                f'has {len(plant.b)} entries, so u acts before the last rate, where law = "adrc" observes it',
                'give b = [b_0] alone, or law = "backstepping"',
            )
        if adaptation is not None and adaptation.unknown:
            raise OutsideClassError(
                "adaptation.unknown",
                'law = "adrc" estimates no parameter',
                'leave it out: its observer estimates the sum of all; or give law = "backstepping"',
            )
        n = plant.order
        blocks = {"Xi": (), "lambda_": (), "r": (), "alpha": (), "e": (), "ck": (), "k": ()}
        observer = {"xi": named("eso", n + 1), "z": named("z", n), "observer": (real_symbol("observer"),)}
        return replace(Signals.of(plant), **blocks, **observer)

    @property
    def f_hat(self) -> sp.Symbol:
        """The last state of the observer."""
        return self.signals.xi[-1]

    @property
    def drive(self) -> sp.Expr:
        """What one unit of input does to the last rate."""
        return self.plant.b[0] * self.plant.sigma

    def filters(self) -> list[Equation]:
        """The observer, and the estimates of x that a run reports."""
        s = self.signals
        rates = [
            Equation(
                real_symbol(derivative_name(state)),
                rate,
                SECTION,
                "",
                "observer" if state != self.f_hat else "observer, of all that the model leaves out",
                self.units.of(state) / SECOND,
            )
            for state, rate in observer_rates(self).items()
        ]
        estimates = [
            Equation(
                real_symbol(f"x_hat{i}"), state, "Estimate", "", f"estimate of x{i}", self.units.of(state)
            )
            for i, state in enumerate(s.xi[:-1], start=1)
        ]
        return [*rates, *estimates]

    def compensator(self) -> list[Equation]:
        """``du`` alone."""
        return switched(self, {})

    def matched_filters(self) -> dict[sp.Symbol, sp.Expr]:
        """``x_hat_1 = y``, a plant at rest, and no disturbance as yet."""
        s, zero = self.signals, sp.Integer(0)
        rest = (s.y, *(-drift for drift in self.plant.drift[:-1]), zero)
        return dict(zip(s.xi, rest, strict=True))

    def law(self, stage: Stage) -> list[Equation]:
        """``z_1`` to ``z_n``, ``Omega``, v."""
        stage("deriving v", 0.0)
        s, units = self.signals, self.units
        eta = output_derivatives(self)
        errors = [
            Equation(z, value - y_r, SECTION, "", f"estimated error, derivative {i}", units.of(z))
            for i, (z, value, y_r) in enumerate(zip(s.z, eta, s.y_r, strict=False))
        ]
        n = self.plant.order
        known = f"known part of derivative {n} of y, without the input"
        wanted = s.y_r[n] - sum(a * z for a, z in zip(pole_polynomial(s.c), s.z, strict=True))
        v = (wanted - KNOWN - self.f_hat) / self.drive
        return [
            *errors,
            Equation(KNOWN, eta[n], SECTION, "", known, units.of(s.y_r[n])),
            Equation(s.v, v, SECTION, "", "control law", units.of(s.v)),
        ]

    def sampled_filters(self, equations: Equations, hold: Hold) -> dict[sp.Symbol, sp.Expr]:
        """``x_hat + T x_hat'``; the sample time T is the integral of the hold of 0."""
        T = hold.Gr[0, 0]
        return {state: state + T * equations[derivative_name(state)].expression for state in self.signals.xi}

    def sampled(self, equations: Equations, hold: Hold) -> Sampled:
        """Nothing beside the observer."""
        return [], {}

    def error_rates(self) -> list[Equation]:
        """None: that of the estimated error holds along the model alone."""
        return []

    @staticmethod
    def prove(derivation: Derivation) -> tuple[Identity, ...]:
        """The observer's error dynamics, its step, and the poles of the law."""
        return (*_estimation(derivation), *_steps(derivation), *_poles(derivation))

    @staticmethod
    def certificate(derivation: Derivation) -> tuple[Equation, ...]:
        """None."""
        return ()


def observer_rates(design: Adrc) -> dict[sp.Symbol, sp.Expr]:
    """Rates of the observer, keyed by state."""
    s = design.signals
    known = (*design.plant.known_rates(s.u), sp.Integer(0))
    linear = filter_matrix(s) * sp.Matrix(s.xi) + sp.Matrix(s.filter_gains) * s.y
    return {state: rate + drift for state, rate, drift in zip(s.xi, linear, known, strict=True)}


def output_derivatives(design: Adrc) -> list[sp.Expr]:
    """``eta_0`` to ``eta_n``: y and its derivatives along the model, at the estimate; u and f left out."""
    s, zero = design.signals, sp.Integer(0)
    first, *_ = states = s.xi[:-1]
    drift = [entry.xreplace({s.y: first}) for entry in design.plant.drift]
    rates = [following + known for following, known in zip((*states[1:], zero), drift, strict=True)]
    found: list[sp.Expr] = [first]
    for _ in states:
        pairs = zip(states, rates, strict=True)
        found.append(sum((sp.diff(found[-1], state) * rate for state, rate in pairs), zero))
    return found


def pole_polynomial(c: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    """``a_1, ..., a_n`` of ``(s + c_1) ... (s + c_n) = s^n + a_n s^(n-1) + ... + a_1``."""
    s = sp.Dummy("s")
    coefficients = sp.Poly(sp.prod([s + entry for entry in c]), s).all_coeffs()
    return [sp.factor(entry) for entry in reversed(coefficients[1:])]


def _estimation(derivation: Derivation) -> list[Identity]:
    """``(x - x_hat, -f_hat)' = A0 (x - x_hat, -f_hat) + (D, 0)``: f itself is the D of the last rate."""
    s, plant = derivation.signals, derivation.design.certified
    D = [real_symbol(f"D{i}") for i in range(1, plant.order + 1)]
    shifted = [*s.x[1:], sp.Integer(0)]
    actual = [x + known + d for x, known, d in zip(shifted, plant.known_rates(s.u), D, strict=True)]
    truth = sp.Matrix([*actual, 0]).xreplace({s.y: s.x[0]})
    rates = sp.Matrix([derivation.equations[derivative_name(state)].expression for state in s.xi])
    error = sp.Matrix([*s.x, 0]) - sp.Matrix(s.xi)
    rest = truth - rates.xreplace({s.y: s.x[0]}) - filter_matrix(s) * error - sp.Matrix([*D, 0])
    return [
        Identity(f"{state} error", f"the error of {state} obeys A0, whatever u is", sp.expand(entry))
        for state, entry in zip(s.xi, rest, strict=True)
    ]


def _steps(derivation: Derivation) -> list[Identity]:
    """One sample later the observer has moved along its rate, and nowhere else."""
    s, equations = derivation.signals, derivation.equations
    T = Hold.of(s).Gr[0, 0]
    return [
        Identity(
            f"{state}_next",
            f"{state} one sample later is a step along its rate",
            sp.expand(
                equations[f"{state}_next"].expression
                - state
                - T * equations[derivative_name(state)].expression
            ),
        )
        for state in s.xi
    ]


def _poles(derivation: Derivation) -> list[Identity]:
    """Along the model, with u = v and the estimates for the states: z_i' = z_{i+1}, and the poles -c_i."""
    s, plant, equations = derivation.signals, derivation.plant, derivation.equations
    *states, f_hat = s.xi
    first = states[0]
    errors = [equations[z.name].expression for z in s.z]
    steps = {symbol: equations[symbol.name].expression for symbol in (KNOWN, *s.z)}
    v = equations[s.v.name].expression.xreplace(steps)
    known = [entry.xreplace({s.y: first}) for entry in plant.drift]
    rates = dict(
        zip(states, [x + drift for x, drift in zip((*states[1:], f_hat), known, strict=True)], strict=True)
    )
    rates[states[-1]] += plant.b[0] * plant.sigma * v
    rates |= dict(zip(s.y_r, s.y_r[1:], strict=False))
    found = [sum(sp.diff(error, by) * rate for by, rate in rates.items()) for error in errors]
    a = pole_polynomial(s.c)
    wanted = [*errors[1:], -sum(entry * error for entry, error in zip(a, errors, strict=True))]
    return [
        Identity(
            f"{z}'",
            f"along the model, the rate of {z} is "
            + ("that of the poles -c" if z == s.z[-1] else "the next"),
            expand_to_zero(rate - expected, plant.sigma),
        )
        for z, rate, expected in zip(s.z, found, wanted, strict=True)
    ]
