"""The driver: a model in, one frozen record of named equations out.

Stages in order, each a pure function of what comes before it:

    name_constants         design                -> the design with named b, theta, and what they stand for
    plant_equations        design                -> y, D_i, x_i'                            (7), (11), (12)
    extra_equations        model                 -> quantities of the simulated plant only
    actuator_equations     model, design         -> u, and further outputs of the actuator             (10)
    design.filters         design                -> xi', Xi', lambda', x_hat                     (14), (15)
    reference_equations    model, design         -> y_r and its derivatives
    design.law             design                -> z_i, alpha_i, partial derivatives, v   (24), (25), (29)
    design.estimation      design                -> rates of what it estimates of the plant
    design.compensator     design                -> du, r'                                             (23)
    design.error_rates     design                -> z_i' under the law                           (27), (28)
    error_equations        model, design         -> e, epsilon                                         (17)
    design.lyapunov        design                -> V, where a run reports it
    sampling_equations     design, equations     -> xi, Xi, lambda, r one sample later
    start_equations        design, law           -> xi, Xi, lambda, r at the matched start
    true_plant             physics, equations    -> the plant in its own parameters
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from pmjoint_derive.adaptation import settings_of
from pmjoint_derive.adaptive import Adaptive
from pmjoint_derive.adrc import Adrc
from pmjoint_derive.backstepping import Backstepping
from pmjoint_derive.believed import believed_plant
from pmjoint_derive.closed_loop import (
    actuator_equations,
    error_equations,
    extra_equations,
    plant_equations,
    reference_equations,
)
from pmjoint_derive.constants import name_constants
from pmjoint_derive.design import Derivation, Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.model import Model, OutsideClassError
from pmjoint_derive.progress import Stage, unwatched
from pmjoint_derive.sampling import sampling_equations
from pmjoint_derive.signals import Units
from pmjoint_derive.start import start_equations
from pmjoint_derive.true_plant import true_plant
from pmjoint_derive.units import parse_unit
from pmjoint_derive.valve import sensor_equations, valve_equations, with_valve

DESIGNS: Mapping[str, type[Design]] = MappingProxyType(
    {"backstepping": Backstepping, "adaptive": Adaptive, "adrc": Adrc}
)


def derive(model: Model, stage: Stage = unwatched) -> Derivation:
    """Derive filters, compensator, virtual controls, partial derivatives and the law of a model's design.

    Args:
        model: what to derive from.
        stage: called with the name of each stage and the fraction of it completed.

    Raises:
        OutsideClassError: if a parameter has the name of an equation; anything else outside the class was
            refused when the plant was made.
    """
    model = with_valve(model)
    made_by = DESIGNS[model.design]
    signals = made_by.signals_for(model.plant, model.adaptation)
    settings = settings_of(model.adaptation, parse_unit(model.y_unit))
    signals = replace(signals, adaptation=tuple(item.symbol for item in settings))
    if model.gains.braking is not None:
        signals = replace(signals, braking=(real_symbol("braking"),))
    units = Units(model, signals)
    believed = believed_plant(model.plant, model.adaptation)
    made = made_by(believed, model.plant, signals, units, model.least_limit, model.adaptation)
    design, constants = name_constants(made)
    constants = [*model.constants, *constants]
    physics = [*plant_equations(design), *extra_equations(model)]
    delivered = actuator_equations(model, design)
    law = design.law(stage)
    continuous: list[Equation] = [
        *constants,
        *physics,
        *model.transformation,
        *design.filters(),
        *reference_equations(model, design),
        *law,
        *design.estimation(),
        *design.compensator(),
        *design.error_rates(),
        *valve_equations(model),
        *sensor_equations(model),
        *delivered,
        *error_equations(model, design),
    ]
    energy = design.lyapunov()
    continuous += energy
    stage("deriving the sampled controller", 0.0)
    held = sampling_equations(design, Equations(continuous))
    started = start_equations(design, law)
    stage("deriving the true plant", 0.0)
    estimated = [item for item in continuous if item.symbol in signals.epsilon] if energy else []
    own, true = true_plant(
        model, design, [*constants, *physics, *delivered[1:]], continuous, [*estimated, *energy]
    )
    equations = Equations([*continuous, *held, *started, *true])
    _check_names(model, equations)
    return Derivation(model, design, equations, own)


def _check_names(model: Model, equations: Equations) -> None:
    """Refuse a parameter that shares its name, and so its symbol, with an equation of the derivation."""
    for item in model.parameters:
        if item.name in equations:
            raise OutsideClassError(
                f"parameters.{item.name}",
                f"already names an equation of the derivation ({equations[item.name].meaning})",
                "choose another name",
            )
