"""A design: the data of every step of a derivation, and the interface of a control law.

A design is one class, such as `pmjoint_derive.backstepping.Backstepping`, and one row of
`pmjoint_derive.derivation.DESIGNS`. Plant, reference, actuator and the true plant are the same for all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import sympy as sp

from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.equation import Equation, Equations, Identity
from pmjoint_derive.hold import Hold, held_update
from pmjoint_derive.model import Model, Plant
from pmjoint_derive.progress import Stage
from pmjoint_derive.signals import Signals, Units

Sampled = tuple[list[Equation], dict[sp.Symbol, sp.Expr]]  # named steps; state -> its next value


@dataclass(frozen=True)
class Design(ABC):
    """A controller for one plant.

    Attributes:
        plant: the plant as the controller takes it, with named constants: guesses and estimates in their
            places.
        truth: the plant that is simulated, likewise with named constants.
        signals: symbols of the closed loop, with the errors and virtual controls of this design.
        units: physical units of the signals.
        limit: the least |u| of the actuator's limits; only a braking compensator needs it.
        adaptation: what the controller does not know of the plant; None: nothing.
    """

    decays: ClassVar[bool] = False  # whether V falls at the rate of (35), and not only does not rise

    plant: Plant
    truth: Plant
    signals: Signals
    units: Units
    limit: sp.Expr = sp.oo
    adaptation: Adaptation | None = None

    certifies: ClassVar[bool] = True  # whether a Lyapunov function comes with the law
    exact_hold: ClassVar[bool] = True  # of the sampled filters, while y and u are held

    @classmethod
    def signals_for(cls, plant: Plant, adaptation: Adaptation | None) -> Signals:
        """The symbols of this design; one with other errors or virtual controls than (24), (25) says so.

        Args:
            plant: of the model.
            adaptation: of the model.
        """
        return Signals.of(plant)

    @cached_property
    def certified(self) -> Plant:
        """The plant that the design's claims are about: true values of what is estimated, else `plant`.

        What the controller takes wrong without estimating it is part of the disturbance (12).
        """
        if self.adaptation is None:
            return self.plant
        Theta, own = [*self.plant.b, *self.plant.theta], [*self.truth.b, *self.truth.theta]
        for entry in self.adaptation.unknown:
            Theta[entry.place] = own[entry.place]
        count = len(self.plant.b)
        return replace(self.plant, b=tuple(Theta[:count]), theta=tuple(Theta[count:]))

    @abstractmethod
    def filters(self) -> list[Equation]:
        """Rates of xi, Xi and lambda, and the estimate ``x_hat1``, ``x_hat2``, ...

        They are linear with the matrix ``A0``, which the sampled controller's exact hold presumes (14).
        """

    @abstractmethod
    def compensator(self) -> list[Equation]:
        """``du`` and the rates of r, which are linear with the matrix of (23)."""

    @abstractmethod
    def law(self, stage: Stage) -> list[Equation]:
        """Errors, virtual controls, their partial derivatives by name, and v, in order of evaluation.

        Args:
            stage: called with the name of what is derived and the fraction completed.
        """

    def matched_filters(self) -> dict[sp.Symbol, sp.Expr]:
        """Matched values of xi, Xi and lambda, as functions of y; keyed by state."""
        plant, s = self.plant, self.signals
        zero = sp.Integer(0)
        found = dict(zip(s.xi, (s.y, *(-phi for phi in plant.phi)), strict=False))
        rows = ((zero,) * plant.p, *(tuple(-entry for entry in row) for row in plant.Phi))
        for states, row in zip(s.Xi, rows, strict=False):
            found |= dict(zip(states, row, strict=True))
        return found | dict.fromkeys(s.lambda_, zero)

    def estimation(self) -> list[Equation]:
        """Rates of estimates of the plant, and what they are made of; none unless the design has any."""
        return []

    def sampled_filters(self, equations: Equations, hold: Hold) -> dict[sp.Symbol, sp.Expr]:
        """Xi, Xi and lambda one sample later, keyed by state; arguments as of `sampled`."""
        s = self.signals
        found: dict[sp.Symbol, sp.Expr] = {}
        for states in (s.xi, *zip(*s.Xi, strict=True), s.lambda_):
            found |= dict(zip(states, held_update(equations, states, hold.F0, hold.G0), strict=True))
        return found

    def sampled(self, equations: Equations, hold: Hold) -> Sampled:
        """The compensator and estimates one sample later, and steps on the way as named equations.

        Args:
            equations: the continuous loop.
            hold: matrices of the exact hold.
        """
        r = self.signals.r
        return [], dict(zip(r, held_update(equations, r, hold.Fr, hold.Gr), strict=True))

    def lyapunov(self) -> list[Equation]:
        """V as a signal that a run reports, and what it is made of; none unless the design has any."""
        return []

    @abstractmethod
    def error_rates(self) -> list[Equation]:
        """Rates of the errors under the law, where the design claims any."""

    @staticmethod
    @abstractmethod
    def prove(derivation: Derivation) -> tuple[Identity, ...]:
        """Identities that the design's claims rest on."""

    @staticmethod
    @abstractmethod
    def certificate(derivation: Derivation) -> tuple[Equation, ...]:
        """The Lyapunov function and its rate, for a reader; empty where the design has none."""


@dataclass(frozen=True)
class Derivation:
    """All equations of one closed loop.

    Attributes:
        model: what it was derived from.
        design: plant, symbols and units, and what the law claims.
        equations: the named equations in an order in which they can be read.
        own_parameters: parameter that plant and controller share -> the plant's own, in the model's order.
    """

    model: Model
    design: Design
    equations: Equations
    own_parameters: Mapping[sp.Symbol, sp.Symbol]

    @property
    def plant(self) -> Plant:
        """The plant with named constants."""
        return self.design.plant

    @property
    def signals(self) -> Signals:
        """The symbols in the equations."""
        return self.design.signals

    @property
    def units(self) -> Units:
        """Physical units of the signals."""
        return self.design.units

    @property
    def gain_values(self) -> dict[sp.Symbol, float]:
        """The model's value of every gain and of the input's scale, in the order of the parameter vector."""
        gains = self.model.gains
        values, bandwidth = gains.by_kind, () if gains.observer is None else (gains.observer,)
        return {
            symbol: value
            for kind, symbols in self.signals.gains_by_kind.items()
            for symbol, value in zip(symbols, values[kind], strict=True)
        } | {
            self.signals.input_scale: gains.input_scale,
            **dict(zip(self.signals.observer, bandwidth, strict=True)),
        }

    def expanded(self, name: str) -> sp.Expr:
        """An equation's right-hand side in y, u, states, estimates, the reference, epsilon, parameters only.

        Raises:
            KeyError: when no equation has that name.
        """
        s = self.signals
        return self.equations.expand(
            self.equations[name].expression, keep=frozenset({s.y, s.u, *s.y_r, *s.epsilon, *s.estimates})
        )
