"""How the estimates of an adaptive design move: tuning functions, or least squares.

The regressor ``omega = dy'/dTheta`` has an entry for each estimate: ``v_{j,2}`` for b_j, ``Phi_1l + Xi_2l``
for theta_l, and for rho = 1 also ``sigma u`` for b_m. Tuning functions add up what the errors ask of the
estimates,

    tau_i = zeta_i omega,   zeta_1 = z_1,   zeta_i = zeta_{i-1} - w_i s_i z_i,   s_i = d alpha_{i-1}/dy,

less ``alpha_1 z_1`` in the entry of b_m where 1/b_m is estimated too, with the weights w of V (30). With the
pull of leakage, ``Theta_hat' = Gamma (tau_rho - leakage (Theta_hat - prior))``. Gamma is diagonal. With a
range (l, h) its entry ``4 gamma (Theta_hat - l)(h - Theta_hat)/(h - l)^2`` vanishes at the ends, so that the
estimate never leaves. Least squares does without errors: it fits ``y - xi_1 = Omega_1' Theta``, a relation
that no control law enters, and so is not misled by saturation.

The state of an estimate with a range is its logit, less that of the guess g, where it starts:

    s = ln((Theta_hat - l)/(h - Theta_hat)) - ln((g - l)/(h - g)),   s(0) = 0,
    Theta_hat = g + 2 (g - l)(h - g) T/(h - l + (2 g - l - h) T),    T = tanh(s/2),
    s' = 4 gamma/(h - l) (tau_rho - leakage (Theta_hat - prior)),

in which the range has no ends and the gain is constant. Near an end Theta_hat has no digits left to say how
near, and how soon it will be away again; s has them. No step can carry it across.

One sample later tau counts as held. There s ends at +-14, about 1e-6 of a range from its ends: float tells
these apart, and a controller that has learnt too much finds back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import sympy as sp

from pmjoint_derive.adaptation import (
    RHO_HAT,
    RHO_LEAKAGE,
    RHO_PRIOR,
    Adaptation,
    Entry,
)
from pmjoint_derive.backstepping import Backstepping, Partials, sensitivity
from pmjoint_derive.design import Sampled
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.filters import input_filters
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND, Unit

SECTION = "Adaptation"
ALPHA_BAR = real_symbol("alpha_bar")  # b_m times virtual control 1
LARGEST = sp.Integer(14)  # of the logit of a sampled estimate


def omega(entry: Entry) -> sp.Symbol:
    """Name of an entry's regressor."""
    return real_symbol(f"omega_{entry.name}")


def omega_1(entry: Entry) -> sp.Symbol:
    """Name of an entry's regressor of ``y - xi_1``."""
    return real_symbol(f"omega1_{entry.name}")


def tau(entry: Entry) -> sp.Symbol:
    """Name of an entry of the last tuning function."""
    return real_symbol(f"tau_{entry.name}")


def pull(entry: Entry) -> sp.Symbol:
    """Name of tau with leakage."""
    return real_symbol(f"pull_{entry.name}")


def zeta(step: Backstepping, i: int) -> sp.Symbol:
    """Name of the factor of omega in tau_i."""
    return step.signals.z[0] if i == 1 else real_symbol(f"zeta{i}")


def regressor(step: Backstepping, entry: Entry, row: int) -> sp.Expr:
    """Entry of ``(v_{m,row}, ..., v_{0,row}, Xi_row)``, that is, of x_hat_row by Theta; 0 beyond order n."""
    s, count = step.signals, len(step.plant.b)
    if row > step.plant.order:
        return sp.Integer(0)
    if entry.place < count:
        return sp.expand(input_filters(s, count - 1 - entry.place)[row - 1])
    return s.Xi[row - 1][entry.place - count]


def output_rate_by(step: Backstepping, entry: Entry) -> sp.Expr:
    """``omega`` of one entry: the derivative of y' by it."""
    plant, count = step.plant, len(step.plant.b)
    found = regressor(step, entry, 2)
    if entry.place >= count:
        return plant.Phi[0][entry.place - count] + found
    return found + (plant.sigma * step.signals.u if plant.rho == 1 and entry.place == 0 else 0)


def regressor_equation(step: Backstepping, entry: Entry) -> Equation:
    """``omega`` of one entry as a named equation."""
    unit = step.units.of(step.signals.y) / SECOND / step.units.of(entry.estimate)
    about = f"regressor of {entry.name} in y'"
    return Equation(omega(entry), output_rate_by(step, entry), SECTION, "", about, unit)


def own_gain(entry: Entry) -> sp.Expr:
    """Factor that keeps an estimate in its range: 1 in the middle, 0 at the ends; 1 without a range."""
    if entry.range is None:
        return sp.Integer(1)
    low, high = entry.ends
    return 4 * (entry.estimate - low) * (high - entry.estimate) / (high - low) ** 2


def turn(entry: Entry) -> sp.Symbol:
    """Name of ``tanh(s/2)`` of the state s of an estimate with a range."""
    return real_symbol(f"{entry.name}_turn")


def place(entry: Entry) -> sp.Expr:
    """The estimate with a range, by `turn`."""
    (low, high), guess, T = entry.ends, entry.guess_symbol, turn(entry)
    room = 2 * (guess - low) * (high - guess)
    return guess + room * T / (high - low + (2 * guess - low - high) * T)


def turn_at(entry: Entry) -> sp.Expr:
    """`turn` by the estimate: the inverse of `place`."""
    (low, high), guess, hat = entry.ends, entry.guess_symbol, entry.estimate
    room = 2 * (guess - low) * (high - guess)
    return (hat - guess) * (high - low) / (room - (hat - guess) * (2 * guess - low - high))


def logit_rate(entry: Entry, rate: sp.Expr) -> sp.Expr:
    """Rate of that state, for a rate of the estimate without `own_gain`."""
    low, high = entry.ends
    return 4 * rate / (high - low)


def estimate_equations(step: Backstepping, adaptation: Adaptation) -> list[Equation]:
    """The estimates whose states are their logits."""
    found = []
    for entry in adaptation.ranged:
        hat, about = entry.estimate, f"how far {entry.estimate} is from its guess, from -1 to 1"
        found += [
            Equation(turn(entry), sp.tanh(entry.state / 2), SECTION, "", about, Unit({})),
            Equation(
                hat, place(entry), SECTION, "", f"estimate of {entry.name}, in its range", step.units.of(hat)
            ),
        ]
    return found


def logit_equation(entry: Entry, rate: sp.Expr) -> Equation:
    """Rate of the state of an estimate with a range; `rate` as of `logit_rate`."""
    name = real_symbol(derivative_name(entry.state))
    about = f"rate of the logit of {entry.estimate}"
    return Equation(name, logit_rate(entry, rate), SECTION, "", about, SECOND**-1)


def weighted(step: Backstepping, i: int) -> sp.Expr:
    """``w_i s_i z_i``."""
    s = step.signals
    return s.weights[i - 1] * sensitivity(step, i) * s.z[i - 1]


class Estimator(Protocol):
    """What the design asks of an estimator."""

    def prepared(self) -> list[Equation]:
        """Equations before the first step."""

    def motion(self, i: int, known: Sequence[Partials]) -> tuple[list[Equation], sp.Expr]:
        """What step i counts on: equations, and the part of ``alpha_{i-1}'`` by estimates of b and theta."""

    def equations(self) -> list[Equation]:
        """Rates of the estimates, after the law."""

    def disagreement(self, i: int, known: Sequence[Partials]) -> sp.Expr:
        """What z_i' has beyond the known design's, since step i does not count on later ones."""

    def sampled(self, T: sp.Expr) -> Sampled:
        """The estimates one sample later, and steps on the way."""


def inverse_pull(step: Backstepping, adaptation: Adaptation) -> sp.Expr:
    """What rho_hat moves by, over its gain: ``-sgn(b_m) alpha_bar z_1`` and the pull of leakage."""
    return -adaptation.sign * ALPHA_BAR * step.signals.z[0] - RHO_LEAKAGE * (RHO_HAT - RHO_PRIOR)


def advanced(adaptation: Adaptation, rates: Sequence[sp.Expr], T: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    """The states of the estimates one sample later, for rates that are held.

    Args:
        adaptation: what is estimated.
        rates: of the estimates, without `own_gain`.
        T: sample time.
    """
    found: dict[sp.Symbol, sp.Expr] = {}
    for entry, rate in zip(adaptation.unknown, rates, strict=True):
        state = entry.state
        if entry.range is None:
            found[state] = state + T * rate
        else:
            then = state + T * logit_rate(entry, rate)
            found[state] = sp.Max(-LARGEST, sp.Min(then, LARGEST))
    return found
