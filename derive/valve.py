"""The actuator between the controller and the plant: a valve with limits, a dead zone and a lag.

The controller tells the valve ``u_command = clip(v + w sgn v, lower, upper)`` (10): it adds the width w of
the dead zone that it believes in. It counts on ``u``, what is left of the command beyond w. The valve
delivers ``u_valve``, what is left beyond its own width, ``dead_zone_plant``. A first-order lag follows, whose
state only the plant has. What comes out in the end drives the plant; ``u`` stays the input of filters and du.
"""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.model import Channel, ExtraState, Model, Start
from pmjoint_derive.units import parse_unit

COMMAND, VALVE = map(real_symbol, ("u_command", "u_valve"))


def with_valve(model: Model) -> Model:
    """The model with the valve's output among its channels and the lag among its states.

    Args:
        model: as its file states it; without dead zone and lag it is returned unchanged.
    """
    if model.dead_zone is None and model.lag is None:
        return model
    u, *others = model.actuator
    lower, upper = model.limits
    u = replace(u, lower=_beyond(lower, model.dead_zone), upper=_beyond(upper, model.dead_zone))
    valve = Channel(
        VALVE,
        u.offset,
        u.slope,
        u.lower,
        u.upper,
        u.unit,
        "what the valve delivers",
        expression=_delivered(model),
    )
    channels = (u, valve, *(replace(channel, of=VALVE) for channel in others))
    lags = _lagging(model)
    return replace(
        model, channels=channels, extras=(*model.extras, *lags), start=_with_lags(model.start, lags)
    )


def _with_lags(start: Start | None, lags: tuple[ExtraState, ...]) -> Start | None:
    """A start in physical states, with the lag's own state among them: it starts at 0 unless it is given."""
    if start is None or not lags:
        return start
    own = tuple(
        Equation(lag.symbol, lag.symbol, "Plant", "", lag.about, parse_unit(lag.unit)) for lag in lags
    )
    return replace(
        start,
        variables=(*start.variables, *own),
        states={**start.states, **{lag.symbol: lag.symbol for lag in lags}},
    )


def valve_equations(model: Model) -> list[Equation]:
    """``u_command``, where there is a dead zone."""
    if model.dead_zone is None:
        return []
    v, (lower, upper) = real_symbol("v"), model.limits
    command = sp.Max(lower, sp.Min(v + model.dead_zone * sp.sign(v), upper))
    return [
        Equation(COMMAND, command, "Closed loop", "(10)", "what the valve is told", parse_unit(model.u_unit))
    ]


def sensor_equations(model: Model) -> list[Equation]:
    """``y_m`` and ``y_f``, which are y without a clock: noise, resolution and filter act in sampled runs."""
    y, read, unit = real_symbol("y"), real_symbol("y_m"), parse_unit(model.y_unit)
    found = []
    if model.chain.keys() & {"resolution", "noise", "filter"}:
        found.append(Equation(read, y, "Closed loop", "", "what the sensor reads", unit))
    if "filter" in model.chain:
        found.append(Equation(real_symbol("y_f"), read, "Closed loop", "", "y_m behind the filter", unit))
    return found


def drive(model: Model) -> dict[sp.Symbol, sp.Symbol]:
    """U -> what drives the plant in its place; empty where u does, or where further channels do."""
    if [channel.symbol for channel in model.channels] != [real_symbol("u"), VALVE]:
        return {}
    return {real_symbol("u"): VALVE if model.lag is None else _lag_state(model)}


def _delivered(model: Model) -> sp.Expr:
    """The valve's output: what is left of the command beyond the dead zone."""
    lower, upper = model.limits
    if model.dead_zone is None:
        return sp.Max(lower, sp.Min(real_symbol("v"), upper))
    return COMMAND - sp.Max(-model.dead_zone, sp.Min(COMMAND, model.dead_zone))


def _beyond(bound: sp.Expr, zone: sp.Expr | None) -> sp.Expr:
    """What is left of a limit beyond the dead zone."""
    return bound if zone is None else bound - sp.Max(-zone, sp.Min(bound, zone))


def _lag_state(model: Model) -> sp.Symbol:
    return real_symbol(f"x{model.plant.order + 1}")


def _lagging(model: Model) -> tuple[ExtraState, ...]:
    if model.lag is None:
        return ()
    state = _lag_state(model)
    return (ExtraState(state, (VALVE - state) / model.lag, model.u_unit, "lag of the actuator"),)
