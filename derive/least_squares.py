"""Least squares in place of tuning functions: the law counts on the rates that the estimates have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.adaptation import LS_FORGETTING, LS_K_MAX, LS_KAPPA, Adaptation
from pmjoint_derive.backstepping import Backstepping, Partials
from pmjoint_derive.design import Sampled
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.estimation import (
    SECTION,
    advanced,
    logit_equation,
    omega_1,
    own_gain,
    regressor,
    regressor_equation,
)
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND

ERROR = real_symbol("prediction_error")
NORM = real_symbol("prediction_norm")


@dataclass(frozen=True)
class LeastSquares:
    """Normalised least squares with bounded forgetting; the gain matrix is a state.

    Attributes:
        step: the design, of relative degree 1 or 2: its law counts on the rates of the estimates.
        adaptation: what it estimates.
    """

    step: Backstepping
    adaptation: Adaptation

    def prepared(self) -> list[Equation]:
        """The regressors of y' and of ``y - xi_1``, the prediction error and the rates of estimates."""
        step, units = self.step, self.step.units
        y, unknown = step.signals.y, self.adaptation.unknown
        found = [regressor_equation(step, entry) for entry in unknown]
        found += [
            Equation(
                omega_1(entry),
                regressor(step, entry, 1),
                SECTION,
                "",
                f"regressor of {entry.name} in y - xi1",
                units.of(y) / units.of(entry.estimate),
            )
            for entry in unknown
        ]
        norm = 1 + sum((omega_1(entry) ** 2 for entry in unknown), sp.Integer(0))
        miss = y - real_symbol("x_hat1")
        found += [
            Equation(ERROR, miss, SECTION, "", "prediction error", units.of(y)),
            Equation(NORM, norm, SECTION, "", "norm that bounds the regressor", None),
        ]
        found += [
            Equation(
                real_symbol(derivative_name(entry.estimate)),
                own_gain(entry) * self._drive(i),
                SECTION,
                "",
                f"rate of the estimate of {entry.name}",
                units.of(entry.estimate) / SECOND,
            )
            for i, entry in enumerate(unknown)
        ]
        return found

    def _filtered(self, i: int) -> sp.Expr:
        """``(Gamma Omega_1)_i``."""
        row = self.adaptation.covariance[i]
        pairs = zip(row, self.adaptation.unknown, strict=True)
        return sum((symbol * omega_1(entry) for symbol, entry in pairs), sp.Integer(0))

    def _drive(self, i: int) -> sp.Expr:
        return LS_KAPPA * self._filtered(i) * ERROR / NORM

    def _forgetting(self) -> sp.Expr:
        trace = sum((row[i] for i, row in enumerate(self.adaptation.covariance)), sp.Integer(0))
        return LS_FORGETTING * (1 - trace / LS_K_MAX)

    def motion(self, i: int, known: Sequence[Partials]) -> tuple[list[Equation], sp.Expr]:
        """``d alpha_1/d Theta_hat Theta_hat'``, exactly."""
        by = known[i - 2]
        terms = (
            by[entry.estimate] * real_symbol(derivative_name(entry.estimate))
            for entry in self.adaptation.unknown
            if entry.estimate in by
        )
        return [], sum(terms, sp.Integer(0))

    def equations(self) -> list[Equation]:
        """Rates of logits, and of the gain matrix."""
        forgetting, unknown = self._forgetting(), enumerate(self.adaptation.unknown)
        found = [logit_equation(entry, self._drive(i)) for i, entry in unknown if entry.range is not None]
        for (i, j), symbol in self._entries().items():
            learnt = LS_KAPPA * self._filtered(i) * self._filtered(j) / NORM
            rate = forgetting * symbol - learnt
            unit = self.step.units.of(symbol) / SECOND
            name = real_symbol(derivative_name(symbol))
            found.append(Equation(name, rate, SECTION, "", "rate of the gain matrix", unit))
        return found

    def _entries(self) -> dict[tuple[int, int], sp.Symbol]:
        """The upper triangle by its indices."""
        rows = self.adaptation.covariance
        return {(i, j): rows[i][j] for i in range(len(rows)) for j in range(i, len(rows))}

    def disagreement(self, i: int, known: Sequence[Partials]) -> sp.Expr:
        """None: every step counts on the rates that the estimates have."""
        return sp.Integer(0)

    def sampled(self, T: sp.Expr) -> Sampled:
        """Estimates and gain matrix with the data of one hold, as if these came in one measurement.

        So the matrix stays positive definite for any sample time.
        """
        unknown = self.adaptation.unknown
        filtered = [self._filtered(i) for i in range(len(unknown))]
        information = sum(
            (omega_1(entry) * value for entry, value in zip(unknown, filtered, strict=True)), sp.Integer(0)
        )
        weight = LS_KAPPA / (NORM + LS_KAPPA * T * information)
        found = advanced(self.adaptation, [weight * value * ERROR for value in filtered], T)
        grown = 1 + T * self._forgetting()
        for (i, j), symbol in self._entries().items():
            found[symbol] = grown * (symbol - T * weight * filtered[i] * filtered[j])
        return [], found
