"""The plant (11), the actuator (10) and the errors that close the loop around the controller."""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.filters import estimate, shift_matrix
from pmjoint_derive.model import Model, Plant
from pmjoint_derive.segment import segment_reference, segment_sizes
from pmjoint_derive.signals import Signals, derivative_name
from pmjoint_derive.units import SECOND, parse_unit

# the disturbance that the paper simulates, (37); any other is the D of (12)
_EXAMPLE = sp.sin(real_symbol("x2")) * sp.cos(real_symbol("t")) / 10


def disturbance_symbols(plant: Plant) -> tuple[sp.Symbol, ...]:
    """Symbols D1..Dn of the disturbance."""
    return tuple(real_symbol(f"D{i}") for i in range(1, plant.order + 1))


def output_disturbance(plant: Plant) -> sp.Expr:
    """``D1`` where the model disturbs y' itself, else 0; every equation of the paper has ``D1 = 0`` (13)."""
    return sp.Integer(0) if plant.disturbance[0] == 0 else disturbance_symbols(plant)[0]


def unknown_output_rate(design: Design) -> sp.Expr:
    """``eta``, the unknown part of y': epsilon_2, absent in a plant of order one, and a disturbance."""
    error = design.signals.epsilon[1] if design.plant.order > 1 else sp.Integer(0)
    return error + output_disturbance(design.plant)


def plant_rates(plant: Plant, signals: Signals) -> dict[sp.Symbol, sp.Expr]:
    """Right-hand sides of ``x' = A x + phi + Phi theta + b sigma u + D`` (11), (12), keyed by state."""
    rates = (
        shift_matrix(plant.order) * sp.Matrix(signals.x)
        + sp.Matrix(plant.known_rates(signals.u))
        + sp.Matrix(disturbance_symbols(plant))
    )
    return dict(zip(signals.x, rates, strict=True))


def plant_equations(design: Design) -> list[Equation]:
    """Output, disturbance and state equations of the simulated plant."""
    plant, signals, units = design.truth, design.signals, design.units
    output = Equation(signals.y, signals.x[0], "Plant", "(7)", "measured output", units.of(signals.y))
    disturbances = [
        Equation(
            symbol,
            value,
            "Plant",
            "(37)" if value == _EXAMPLE else "(12)",
            "disturbance, unknown to the controller",
            units.of(state) / SECOND,
        )
        for symbol, value, state in zip(disturbance_symbols(plant), plant.disturbance, signals.x, strict=True)
    ]
    rates = [
        Equation(
            real_symbol(derivative_name(state)),
            rate,
            "Plant",
            "(11)",
            f"rate of {state}",
            units.of(state) / SECOND,
        )
        for state, rate in plant_rates(plant, signals).items()
    ]
    return [output, *disturbances, *rates]


def reference_equations(model: Model, design: Design) -> list[Equation]:
    """The reference and its derivatives up to order rho."""
    signals = design.signals
    meanings = ["reference", *(f"derivative {i} of the reference" for i in range(1, len(signals.y_r)))]
    return [
        Equation(
            symbol,
            _reference_derivative(model, signals, i),
            "Reference",
            "",
            meanings[i],
            design.units.of(symbol),
        )
        for i, symbol in enumerate(signals.y_r)
    ]


def _reference_derivative(model: Model, signals: Signals, order: int) -> sp.Expr:
    if model.segment:
        return segment_reference(*segment_sizes(model.segment, model.plant.rho), order)
    return sp.diff(model.reference, signals.t, order)


def actuator_equations(model: Model, design: Design) -> list[Equation]:
    """Saturation (10): the actuator's output, u first."""
    return [
        Equation(
            channel.symbol,
            channel.value,
            "Closed loop",
            "(10)",
            channel.about,
            parse_unit(channel.unit),
        )
        for channel in model.actuator
    ]


def extra_equations(model: Model) -> list[Equation]:
    """Reported signals of the physics, and rates of the states that only the simulated plant has."""
    rates = [
        Equation(
            real_symbol(derivative_name(state.symbol)),
            state.rate,
            "Plant",
            "",
            f"rate of {state.symbol}",
            parse_unit(state.unit) / SECOND,
        )
        for state in model.extras
    ]
    return [*model.reported, *rates]


def tracking_error(model: Model) -> sp.Symbol:
    """The symbol of ``e = y - y_r``; a plant may have a parameter e, and the error is then called e_y."""
    taken = any(item.name == "e" for item in model.parameters)
    return real_symbol("e_y" if taken else "e")


def column_name(model: Model, signal: sp.Symbol) -> str:
    """The name of a signal's column, which is e for the tracking error whatever the parameters are."""
    return "e" if signal == tracking_error(model) else str(signal.name)


def error_equations(model: Model, design: Design) -> list[Equation]:
    """Tracking error and estimation errors (17)."""
    signals, units = design.signals, design.units
    exact = design.certified == design.plant
    x_hat = (
        [real_symbol(f"x_hat{i}") for i in range(1, design.plant.order + 1)]
        if exact
        else estimate(design.certified, signals)
    )
    tracking = Equation(
        tracking_error(model),
        signals.y - signals.y_r[0],
        "Closed loop",
        "",
        "tracking error" + (f", e = z1 + {signals.r[0]}" if signals.r else ""),
        units.of(signals.y),
    )
    estimation = [
        Equation(
            symbol,
            state - known,
            "Estimate",
            "(17)",
            f"estimation error of x{i}" + ("" if exact else ", with the true values of what is estimated"),
            units.of(symbol),
        )
        for i, (symbol, state, known) in enumerate(zip(signals.epsilon, signals.x, x_hat, strict=True), 1)
    ]
    return [tracking, *estimation]
