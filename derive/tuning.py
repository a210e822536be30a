"""Tuning functions: the estimates move as the errors ask, and each step of the law counts on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.adaptation import LEAKAGE, RHO_GAMMA, RHO_HAT, Adaptation, Entry
from pmjoint_derive.backstepping import Backstepping, Partials, sensitivity
from pmjoint_derive.design import Sampled
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.estimation import (
    ALPHA_BAR,
    SECTION,
    advanced,
    inverse_pull,
    logit_equation,
    omega,
    own_gain,
    pull,
    regressor_equation,
    tau,
    weighted,
    zeta,
)
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND


@dataclass(frozen=True)
class Tuning:
    """Tuning functions.

    Attributes:
        step: the design.
        adaptation: what it estimates.
    """

    step: Backstepping
    adaptation: Adaptation

    def gain(self, entry: Entry) -> sp.Expr:
        """Gamma's entry: its name where it moves."""
        return entry.gamma if entry.range is None else real_symbol(f"Gamma_{entry.name}")

    def prepared(self) -> list[Equation]:
        """The regressor, and gains that move."""
        return [item for entry in self.adaptation.unknown for item in self._of(entry)]

    def _of(self, entry: Entry) -> list[Equation]:
        found = [regressor_equation(self.step, entry)]
        if entry.range is None:
            return found
        about = f"gain of {entry.estimate}, which vanishes at the ends of its range"
        gain, unit = self.gain(entry), self.step.units.of(entry.gamma)
        return [*found, Equation(gain, entry.gamma * own_gain(entry), SECTION, "", about, unit)]

    def _excess(self, entry: Entry) -> sp.Expr:
        """What tau has less in the entry of b_m where its inverse is estimated too."""
        s = self.step.signals
        if not s.inverse or entry.place != 0:
            return sp.Integer(0)
        acting = self.step.plant.sigma * s.v if self.step.plant.rho == 1 else s.alpha[0]
        return acting * s.z[0]

    def _leak(self, entry: Entry) -> sp.Expr:
        return LEAKAGE * (entry.estimate - entry.prior_symbol)

    def _along(self, by: Partials, factor: sp.Expr) -> sp.Expr:
        """``d alpha / d Theta_hat Gamma omega`` times a factor."""
        terms = (
            by[entry.estimate] * self.gain(entry) * omega(entry) * factor
            for entry in self.adaptation.unknown
            if entry.estimate in by
        )
        return sum(terms, sp.Integer(0))

    def motion(self, i: int, known: Sequence[Partials]) -> tuple[list[Equation], sp.Expr]:
        """``zeta_i``, and what ``tau_i`` and leakage move, less what earlier steps are owed."""
        step, by = self.step, known[i - 2]
        factor = Equation(
            zeta(step, i),
            zeta(step, i - 1) - weighted(step, i),
            SECTION,
            "",
            f"factor of the regressor in tuning function {i}",
            step.units.of(step.signals.y),
        )
        moved = self._along(by, factor.symbol)
        for entry in self.adaptation.unknown:
            if entry.estimate in by:
                rest = self._excess(entry) + self._leak(entry)
                moved -= by[entry.estimate] * self.gain(entry) * rest
        return [factor], moved + self._paid(i, known)

    def _paid(self, i: int, known: Sequence[Partials]) -> sp.Expr:
        """What steps 2 ... i - 1 need since ``tau_i`` is more than they counted on."""
        s = self.step.signals
        s_i = sensitivity(self.step, i)
        terms = (
            -s.weights[j - 1] * s.z[j - 1] * s_i * self._along(known[j - 2], sp.Integer(1))
            for j in range(2, i)
        )
        return sum(terms, sp.Integer(0))

    def equations(self) -> list[Equation]:
        """tau, the pull of tau and leakage, and the rates."""
        step, units = self.step, self.step.units
        last, found = zeta(step, step.plant.rho), []
        for entry in self.adaptation.unknown:
            hat = entry.estimate
            unit = units.of(step.signals.y) ** 2 / SECOND / units.of(hat)
            found += [
                Equation(
                    tau(entry),
                    last * omega(entry) - self._excess(entry),
                    SECTION,
                    "",
                    f"last tuning function, of {entry.name}",
                    unit,
                ),
                Equation(
                    pull(entry),
                    tau(entry) - self._leak(entry),
                    SECTION,
                    "",
                    f"what moves {hat}: tau and leakage",
                    unit,
                ),
                Equation(
                    real_symbol(derivative_name(hat)),
                    self.gain(entry) * pull(entry),
                    SECTION,
                    "",
                    f"rate of the estimate of {entry.name}",
                    units.of(hat) / SECOND,
                ),
            ]
            if entry.range is not None:
                found.append(logit_equation(entry, entry.gamma * pull(entry)))
        if self.adaptation.inverse is not None:
            found += self._of_inverse()
        return found

    def _of_inverse(self) -> list[Equation]:
        name = real_symbol(f"pull_{RHO_HAT.name.removesuffix('_hat')}")
        value, about = inverse_pull(self.step, self.adaptation), "what moves rho_hat"
        unit = self.step.units.of(RHO_HAT) / SECOND
        rate = real_symbol(derivative_name(RHO_HAT))
        return [
            Equation(name, value, SECTION, "", about, None),
            Equation(rate, RHO_GAMMA * name, SECTION, "", "rate of the estimate of 1/b_m", unit),
        ]

    def disagreement(self, i: int, known: Sequence[Partials]) -> sp.Expr:
        """Of step 1, what ``b_hat rho_hat`` is not 1; of others, the tuning functions after theirs."""
        s, step = self.step.signals, self.step
        if i == 1:
            if not s.inverse:
                return sp.Integer(0)
            acting = step.plant.sigma * s.v if step.plant.rho == 1 else s.alpha[0]
            return step.b_m * acting - ALPHA_BAR
        late = zeta(step, i) - zeta(step, step.plant.rho)
        return self._along(known[i - 2], late) + self._paid(i, known)

    def sampled(self, T: sp.Expr) -> Sampled:
        """The pulls act over one hold."""
        rates = [entry.gamma * pull(entry) for entry in self.adaptation.unknown]
        found = advanced(self.adaptation, rates, T)
        if self.adaptation.inverse is not None:
            found[RHO_HAT] = RHO_HAT + T * RHO_GAMMA * real_symbol("pull_rho")
        return [], found
