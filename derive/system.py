"""A system given by rates of its own states, or by a transfer function, as the plant of a design.

The design's plant is the output-feedback form of `elimination`, without anything left out. The simulated
plant is the same physics in the design's coordinates x, and its disturbance d of the rates of the physical
states s acts there as ``D_i = sum_j dx_i/ds_j d_j``. A run starts in s and reports s.

A transfer function ``(c_m s^m + ... + c_0)/(a_0 s^n + ... + a_n)`` with m < n has the observer canonical form
``x_i' = x_{i+1} - a_i/a_0 y + b_{n-i} u`` with ``b_j = c_j/a_0``; its states are x themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.elimination import eliminate
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.model import OutsideClassError, Plant, Start
from pmjoint_derive.observer_form import coordinates
from pmjoint_derive.physics import Y
from pmjoint_derive.start import start_symbol
from pmjoint_derive.units import SECOND, Unit, parse_unit

SECTION = "System"


@dataclass(frozen=True)
class System:
    """A design's view of a system; the fields are those of `Model`.

    Attributes:
        plant: the plant that the controller is designed for; its disturbance is that of the rates.
        reported: the physical states as named equations.
        start: the physical states that a run starts from.
        transformation: the rates as written, and the design's coordinates in the physical states.
    """

    plant: Plant
    reported: tuple[Equation, ...]
    start: Start
    transformation: tuple[Equation, ...]


def reduce_system(
    states: tuple[sp.Symbol, ...],
    rates: tuple[sp.Expr, ...],
    output: sp.Expr,
    disturbance: tuple[sp.Expr, ...],
    units: tuple[str | None, ...],
    y_unit: str,
) -> System:
    """Reduce a system to the plant class.

    Args:
        states: n symbols.
        rates: n functions of states, u and parameters.
        output: of states and parameters.
        disturbance: n functions of states, t and parameters, added to the rates of the simulated plant.
        units: of the states; None: taken from the output's where the rates tell.
        y_unit: of the output.

    Raises:
        OutsideClassError: there is no output-feedback form; naming the term.
    """
    found = eliminate(states, rates, output)
    form, x = found.form, coordinates(len(states))
    acting = tuple(
        sum(
            (sp.diff(value, state) * entry for state, entry in zip(states, disturbance, strict=True)),
            sp.Integer(0),
        )
        for value in form.forward
    )
    rows: tuple[tuple[sp.Expr, ...], ...] = ((),) * len(states)
    plant = Plant(len(states), form.phi, rows, (), found.b, found.sigma, acting)
    labels = _units(states, rates, output, units, parse_unit(y_unit))
    reported = tuple(
        Equation(state, form.back[state], SECTION, "", f"state {state} of the system", label)
        for state, label in zip(states, labels, strict=True)
    )
    start = Start(reported, len(states), dict(zip(x, form.forward, strict=True)))
    return System(
        plant, reported, start, (*_written(states, rates, labels), *_forward(form.forward, x, y_unit))
    )


def _written(
    states: tuple[sp.Symbol, ...], rates: tuple[sp.Expr, ...], units: Sequence[Unit | None]
) -> list[Equation]:
    """The rates as the model file has them."""
    return [
        Equation(
            real_symbol(f"rate_of_{state}"),
            rate,
            SECTION,
            "",
            f"rate of {state} as the model file has it",
            None if unit is None else unit / SECOND,
        )
        for state, rate, unit in zip(states, rates, units, strict=True)
    ]


def _forward(forms: Sequence[sp.Expr], x: Sequence[sp.Symbol], y_unit: str) -> list[Equation]:
    """The design's coordinates in the physical states: where a run starts, and at every other time."""
    unit = parse_unit(y_unit)
    return [
        Equation(
            start_symbol(state), form, SECTION, "", f"{state} in the states of the system", unit / SECOND**i
        )
        for i, (state, form) in enumerate(zip(x, forms, strict=True))
    ]


def _units(
    states: tuple[sp.Symbol, ...],
    rates: tuple[sp.Expr, ...],
    output: sp.Expr,
    stated: tuple[str | None, ...],
    y_unit: Unit,
) -> list[Unit | None]:
    """The unit of each state: as stated, that of the output, or of a state whose rate it is, per second."""
    found = {state: parse_unit(text) for state, text in zip(states, stated, strict=True) if text is not None}
    if output.is_Symbol:
        found.setdefault(output, y_unit)
    for _ in states:
        for state, rate in zip(states, rates, strict=True):
            if state in found and rate in states:
                found.setdefault(rate, found[state] / SECOND)
    return [found.get(state) for state in states]


def transfer_plant(
    num: tuple[sp.Expr, ...], den: tuple[sp.Expr, ...], disturbance: tuple[sp.Expr, ...]
) -> Plant:
    """The observer canonical form of a transfer function.

    Args:
        num: coefficients ``c_m ... c_0``, highest power first, of parameters.
        den: coefficients ``a_0 ... a_n``, likewise.
        disturbance: n functions of x1 ... xn, t and parameters.

    Raises:
        OutsideClassError: it is not strictly proper, or has a leading coefficient of 0.
    """
    key = "system.transfer_function"
    if len(num) >= len(den):
        raise OutsideClassError(
            f"{key}.num",
            "the numerator has no lower degree than the denominator, so u acts on the output at once",
            "add the pole that every real actuator or sensor has",
        )
    for name, leading in (("num", num[0]), ("den", den[0])):
        if sp.simplify(leading) == 0:
            raise OutsideClassError(f"{key}.{name}", "the leading coefficient is 0", "leave it out")
    order = len(den) - 1
    phi = tuple(-sp.cancel(value / den[0]) * Y for value in den[1:])
    rows: tuple[tuple[sp.Expr, ...], ...] = ((),) * order
    b = tuple(sp.cancel(value / den[0]) for value in num)
    return Plant(order, phi, rows, (), b, sp.Integer(1), disturbance)
