"""Backstepping with estimates of unknown b and theta: tuning functions, with a saturation compensator.

The design is that of `backstepping` with estimates in place of b and theta. What it takes wrong is one more
unknown part of y': with ``Theta~ = Theta - Theta_hat`` and the regressor ``omega = dy'/dTheta``,

    y' = Omega + b_hat v_{m,2} + eta,       eta = omega' Theta~ + epsilon_2 + D_1.

Estimates move, and the law counts on that: it contains the motion that its own errors ask for up to step i,
by the tuning functions ``tau_i``, and pays for what later steps add (Krstic, Kanellakopoulos, Kokotovic,
*Nonlinear and Adaptive Control Design*, 1995, chapter 10). The compensator is ``chi``: r_1 = chi_1 and r_i =
b_m chi_i of (23), so that no rate of an estimate enters it:

    chi_1' = b_hat chi_2 - ck_1 chi_1,      chi_i' = chi_{i+1} - ck_i chi_i,
    chi_rho' = -ck_rho chi_rho + sigma du   (rho = 1: chi_1' = -ck_1 chi_1 + b_hat sigma du),
    z_1 = y - y_r - chi_1,                  z_i = v_{m,i} - alpha_{i-1} - chi_i.

``alpha_i`` here contains ``y_r^(i)/b_m`` of (24). The law divides by the estimate of b_m, or multiplies by an
estimate ``rho_hat`` of its inverse. With all estimates right and at rest it is the law of `backstepping`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import sympy as sp

from pmjoint_derive.adaptation import RHO_GAMMA, RHO_HAT, Adaptation
from pmjoint_derive.adaptive_certificate import certificate_equations
from pmjoint_derive.adaptive_energy import lyapunov_equations
from pmjoint_derive.adaptive_proof import prove
from pmjoint_derive.backstepping import (
    SECTION,
    Backstepping,
    Partials,
    solve_step,
    total_rate,
    wanted_rate,
)
from pmjoint_derive.compensator import switched
from pmjoint_derive.design import Sampled
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.estimation import ALPHA_BAR, Estimator, estimate_equations, inverse_pull, omega
from pmjoint_derive.filters import filter_equations
from pmjoint_derive.hold import Hold
from pmjoint_derive.least_squares import LeastSquares
from pmjoint_derive.model import Plant
from pmjoint_derive.signals import Signals, derivative_name, named, partial_name
from pmjoint_derive.tuning import Tuning
from pmjoint_derive.units import SECOND


@dataclass(frozen=True)
class Adaptive(Backstepping):
    """The design with estimates."""

    decays = False  # V_Theta need not

    @classmethod
    def signals_for(cls, plant: Plant, adaptation: Adaptation | None) -> Signals:
        """Those of the known design, with chi for r, and the estimates."""
        assert adaptation is not None and adaptation.unknown  # of a model that chooses this design
        pairs = {symbol: None for row in adaptation.covariance for symbol in row}
        return replace(
            Signals.of(plant),
            r=named("chi", plant.rho),
            estimates=tuple(entry.estimate for entry in adaptation.unknown),
            learnt=tuple(entry.state for entry in adaptation.unknown),
            inverse=(RHO_HAT,) if adaptation.inverse else (),
            covariance=tuple(pairs),
        )

    @property
    def eta(self) -> sp.Expr:
        """The unknown part of y': also by what the estimates are wrong."""
        assert self.adaptation is not None
        own = (*self.truth.b, *self.truth.theta)
        missed = (omega(entry) * (own[entry.place] - entry.estimate) for entry in self.adaptation.unknown)
        return super().eta + sum(missed, sp.Integer(0))

    @cached_property
    def estimator(self) -> Estimator:
        """How the estimates move."""
        assert self.adaptation is not None
        kind = Tuning if self.adaptation.least_squares is None else LeastSquares
        return kind(self, self.adaptation)

    @property
    def inverse_rate(self) -> dict[sp.Symbol, sp.Expr]:
        """Rate of rho_hat; unlike those of the other estimates, it does not depend on later steps."""
        assert self.adaptation is not None
        if self.adaptation.inverse is None:
            return {}
        return {RHO_HAT: RHO_GAMMA * inverse_pull(self, self.adaptation)}

    @cached_property
    def compensator_rates(self) -> dict[sp.Symbol, sp.Expr]:
        """Rates of chi."""
        s, rho = self.signals, self.plant.rho
        chi, drive = s.r, self.plant.sigma * s.du
        if rho == 1:
            return {chi[0]: -s.ck[0] * chi[0] + self.b_m * drive}
        following = (self.b_m * chi[1], *chi[2:], drive)
        return {state: -ck * state + then for state, ck, then in zip(chi, s.ck, following, strict=True)}

    def filters(self) -> list[Equation]:
        """The estimates, and the filters with them."""
        assert self.adaptation is not None
        return [*estimate_equations(self, self.adaptation), *filter_equations(self)]

    def compensator(self) -> list[Equation]:
        """``du`` and the rates of chi."""
        return switched(self, self.compensator_rates)

    def prepared(self) -> list[Equation]:
        """``v_{m,i}`` and Omega, the regressor and the gains of the estimates."""
        return [*super().prepared(), *self.estimator.prepared()]

    def held(self, i: int) -> sp.Expr:
        """``chi_i``."""
        return self.signals.r[i - 1]

    def held_rate(self, i: int) -> sp.Expr:
        """``chi_i'``."""
        return self.rates[self.signals.r[i - 1]]

    def step(self, i: int, known: Sequence[Partials]) -> list[Equation]:
        """Virtual control i, or v at the last step, with the tuning function that it needs."""
        return self._first() if i == 1 else self._later(i, known)

    def _first(self) -> list[Equation]:
        """``b_m alpha_1``, then alpha_1, or v, by the estimate of b_m or of its inverse."""
        s, rho = self.signals, self.plant.rho
        _, value = solve_step(self, 1, sp.Integer(0), [])
        first = s.v if rho == 1 else s.alpha[0]
        bar = Equation(ALPHA_BAR, value, SECTION, "", f"{first} times b_m", self.units.of(s.y) / SECOND)
        inverse = RHO_HAT if s.inverse else 1 / self.b_m
        law = inverse * ALPHA_BAR / (self.plant.sigma if rho == 1 else 1)
        meaning = "control law" if rho == 1 else "virtual control 1, with the reference's rate"
        return [bar, Equation(first, law, SECTION, "", meaning, self.units.of(first))]

    def _later(self, i: int, known: Sequence[Partials]) -> list[Equation]:
        s, partials = self.signals, known[-1]
        unknown = s.v if i == self.plant.rho else s.alpha[i - 1]
        tuning, motion = self.estimator.motion(i, known)
        alpha_rate = total_rate(self, partials) + motion
        slope, value = solve_step(self, i, alpha_rate, list(partials.values()))
        meaning = "control law" if i == self.plant.rho else f"virtual control {i}, with derivative {i} of y_r"
        return [*tuning, Equation(unknown, value / slope, SECTION, "", meaning, self.units.of(unknown))]

    def estimation(self) -> list[Equation]:
        """Rates of the estimates."""
        return self.estimator.equations()

    def sampled(self, equations: Equations, hold: Hold) -> Sampled:
        """Chi by the exact hold at the estimate of b_m now; estimates with what moves them held."""
        steps, found = self.estimator.sampled(hold.Gr[0, 0])
        return steps, {**chi_update(self, hold), **found}

    def lyapunov(self) -> list[Equation]:
        """V, with the true values of what is estimated."""
        return lyapunov_equations(self)

    def error_rates(self) -> list[Equation]:
        """z_i' under the law, exact for any saturation and any plant of the class."""
        s, units = self.signals, self.units
        slopes = [{hat: real_symbol(partial_name(alpha, hat)) for hat in s.estimates} for alpha in s.alpha]
        if s.inverse and slopes:  # alpha_1 is then written without the estimate of b_m
            slopes[0].pop(self.b_m, None)
        return [
            Equation(
                real_symbol(derivative_name(z)),
                wanted_rate(self, i) + self.estimator.disagreement(i, slopes),
                "Certificate",
                "",
                f"rate of error {i} under the law, whatever u is",
                units.of(z) / SECOND,
            )
            for i, z in enumerate(s.z, start=1)
        ]

    prove = staticmethod(prove)
    certificate = staticmethod(certificate_equations)


def chi_update(step: Adaptive, hold: Hold) -> dict[sp.Symbol, sp.Expr]:
    """Chi one sample later: ``(chi_1, b_hat chi_2, ...)`` is r of (23), and b_hat counts as held."""
    s, rho, b = step.signals, step.plant.rho, step.b_m
    F, G = hold.Fr[1:, 1:], hold.Gr[1:, 1:]
    drive = s.compensator * step.plant.sigma * s.du
    found = {
        s.r[i]: sum((F[i, j] * s.r[j] for j in range(i, rho)), G[i, rho - 1] * drive) for i in range(1, rho)
    }
    later = sum((F[0, j] * s.r[j] for j in range(1, rho)), G[0, rho - 1] * drive)
    return {s.r[0]: F[0, 0] * s.r[0] + b * later, **found}
