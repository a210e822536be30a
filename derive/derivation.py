"""The driver: a model in, one frozen record of named equations out.

Stages, each a pure function of what stands before it:

    name_constants          plant                 -> plant with named b, theta
    plant_equations         plant                 -> y, D_i, x_i'                     (7), (11), (12)
    extra_equations         model                 -> what only the simulated plant has
    filter_equations        plant                 -> xi', Xi', lambda', x_hat         (14), (15)
    compensator_equations   plant                 -> du, r'                           (23)
    reference_equations     reference             -> y_r and its derivatives
    backstep                plant                 -> z_i, alpha_i, partials, v        (24), (25), (29)
    sampling_equations      filters, compensator  -> xi, Xi, lambda, r one sample later
    error_rate_equations    plant                 -> z_i' under the law               (27), (28)
    actuator, errors        model                 -> u, e, epsilon                    (10), (17)
    true_plant              physics, design       -> the plant in parameters of its own
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.backstepping import backstep, error_rate_equations
from pmjoint_derive.closed_loop import (
    actuator_equations,
    error_equations,
    extra_equations,
    plant_equations,
    reference_equations,
)
from pmjoint_derive.compensator import compensator_equations
from pmjoint_derive.constants import name_constants
from pmjoint_derive.equation import Equation, Equations
from pmjoint_derive.filters import filter_equations
from pmjoint_derive.model import Model, OutsideClassError, Plant
from pmjoint_derive.progress import Stage, unwatched
from pmjoint_derive.sampling import sampling_equations
from pmjoint_derive.signals import Signals, Units
from pmjoint_derive.true_plant import true_plant


@dataclass(frozen=True)
class Derivation:
    """Everything that is known of one closed loop.

    Attributes:
        model: what it was derived from.
        plant: the plant with named constants.
        signals: the symbols in the equations.
        units: their physical units.
        equations: the named equations in an order in which they can be read.
        own_parameters: parameter that plant and controller share -> the plant's own, in the model's order.
    """

    model: Model
    plant: Plant
    signals: Signals
    units: Units
    equations: Equations
    own_parameters: Mapping[sp.Symbol, sp.Symbol]

    def expanded(self, name: str) -> sp.Expr:
        """An equation's right-hand side in y, u, states, the reference, epsilon and parameters only.

        Raises:
            KeyError: when no equation has that name.
        """
        s = self.signals
        return self.equations.expand(
            self.equations[name].expression, keep=frozenset({s.y, s.u, *s.y_r, *s.epsilon})
        )


def derive(model: Model, stage: Stage = unwatched) -> Derivation:
    """Derive filters, compensator, virtual controls, partial derivatives and the law for a model.

    Args:
        model: what to derive from.
        stage: told what is being derived.

    Raises:
        OutsideClassError: when a parameter bears the name of an equation; what else is outside the class was
            refused when the plant was made.
    """
    signals, units = Signals.of(model.plant), Units(model)
    named = name_constants(model.plant, signals, units)
    plant = named.plant
    constants = [*model.constants, *named.equations]
    physics = [*plant_equations(plant, signals, units), *extra_equations(model)]
    delivered = actuator_equations(model, signals)
    continuous: list[Equation] = [
        *constants,
        *physics,
        *filter_equations(plant, signals, units),
        *reference_equations(model, signals, units),
        *backstep(plant, signals, units, stage),
        *compensator_equations(plant, signals, units),
        *error_rate_equations(plant, signals, units),
        *delivered,
        *error_equations(signals, units),
    ]
    stage("deriving the sampled controller", 0.0)
    held = sampling_equations(Equations(continuous), signals, units)
    stage("deriving the true plant", 0.0)
    true = true_plant(model, plant, signals, units, [*constants, *physics, *delivered[1:]], continuous)
    equations = Equations([*continuous, *held, *true.equations])
    _check_names(model, equations)
    return Derivation(model, plant, signals, units, equations, true.parameters)


def _check_names(model: Model, equations: Equations) -> None:
    """Refuse a parameter that shares its name, and so its symbol, with what the derivation defines."""
    for item in model.parameters:
        if item.name in equations:
            raise OutsideClassError(
                f"parameters.{item.name}",
                f"already names an equation of the derivation ({equations[item.name].meaning})",
                "choose another name",
            )
