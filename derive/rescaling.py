"""The physics of a model in the units of its columns.

Expressions of a joint or a system are in SI units. Its y, u and physical states may be shown in others, such
as deg, bar and mm. `Rescaling` says how many SI units each of these is, and `rescaled` writes the physics in
them: ``y`` stands for ``Y y`` and ``u`` for ``U u`` in SI units, so that

    x_i' = x_{i+1} + (phi_i(Y y) + Phi_i(Y y) theta + D_i)/Y + (b_i U/Y) sigma(Y y) u.

The design's coordinates, whose first is y, all have the unit of y over a power of s. Filters, errors and v
then have the file's units by themselves, and so have the generated code, columns, limits and x0.

The law depends on the units of y and u by V (30) alone, which adds squares of both. With ``kappa U/Y`` in
place of kappa it is the law of SI units: V is divided by Y^2, and nothing else changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from typing import Any, Final

import sympy as sp

from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.model import Channel, Demand, ExtraState, Plant, Start
from pmjoint_derive.physics import U, Y
from pmjoint_derive.units import Unit

_PI: Final = Fraction("3.14159265358979323846264338327950288419716939937510582")
_FRACTIONS: Final = 1_000_000  # greatest denominator of a part of pi: an arcsecond is pi/648000
_DIGITS: Final = Fraction(1, 10**20)  # of a decimal that is a part of pi, relative
_V: Final = real_symbol("v")

Table = Mapping[sp.Symbol, sp.Expr]


@dataclass(frozen=True)
class Rescaling:
    """How many SI units the unit of a symbol is.

    Attributes:
        y: of the output.
        u: of the input.
        named: of further symbols: physical states, and parameters whose values are in the unit of a column.
        labels: units of reported signals that change with the scale.
        u_unit: label of u.
    """

    y: sp.Expr
    u: sp.Expr
    named: Mapping[sp.Symbol, sp.Expr] = field(default_factory=dict)
    labels: Mapping[sp.Symbol, Unit] = field(default_factory=dict)
    u_unit: str = "V"

    @property
    def is_si(self) -> bool:
        """Whether nothing changes."""
        return all(value == 1 for value in (self.y, self.u, *self.named.values()))

    def of(self, symbol: sp.Symbol) -> sp.Expr:
        """SI units per unit of a named symbol."""
        return self.named.get(symbol, sp.Integer(1))

    def table(self, order: int) -> dict[sp.Symbol, sp.Expr]:
        """Symbol -> its value in SI units."""
        states = dict.fromkeys((real_symbol(f"x{i}") for i in range(1, order + 1)), self.y)
        scales = {**states, Y: self.y, U: self.u, _V: self.u, **self.named}
        return {symbol: scale * symbol for symbol, scale in scales.items() if scale != 1}


def exact(decimal: str) -> sp.Expr:
    """A decimal as a fraction, or as a part of pi that it equals to 20 digits: deg is pi/180."""
    value = Fraction(Decimal(decimal))
    for inverse in (False, True):
        part = 1 / (value * _PI) if inverse else value / _PI
        near = part.limit_denominator(_FRACTIONS)
        if near and abs(near / part - 1) < _DIGITS:
            found = sp.Rational(near.numerator, near.denominator)
            return 1 / (found * sp.pi) if inverse else found * sp.pi
    return sp.Rational(value.numerator, value.denominator)


def rescaled(physics: Mapping[str, Any], scaling: Rescaling) -> dict[str, Any]:
    """The fields of `Model` that describe a plant, in the units of the columns.

    Args:
        physics: the fields in SI units, ``plant`` among them.
        scaling: of the columns.
    """
    if scaling.is_si:
        return dict(physics)
    plant: Plant = physics["plant"]
    table = scaling.table(plant.order)
    found = {**physics, "plant": _plant(plant, scaling, table)}
    for key in ("constants", "reported"):
        found[key] = tuple(_equation(item, scaling, table) for item in physics.get(key, ()))
    found["extras"] = tuple(_extra(item, table) for item in physics.get("extras", ()))
    found["channels"] = tuple(_channel(item, scaling, table) for item in physics.get("channels", ()))
    found["demands"] = tuple(_demand(item, table) for item in physics.get("demands", ()))
    found["transformation"] = tuple(
        _written(item, scaling, table) for item in physics.get("transformation", ())
    )
    if physics.get("start") is not None:
        found["start"] = _start(physics["start"], plant.order, scaling, table)
    return found


def outside_functions(value: sp.Expr, table: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    """Replace symbols, except in the arguments of functions and in exponents.

    Args:
        value: an expression such as ``amplitude*sin(w*t)``.
        table: symbol -> what stands for it.
    """
    if value.is_Symbol:
        return table.get(value, value)
    if value.is_Pow:
        return outside_functions(value.base, table) ** value.exp
    if value.is_Add or value.is_Mul:
        return value.func(*(outside_functions(part, table) for part in value.args))
    return value


def over(value: sp.Expr, scale: sp.Expr) -> sp.Expr:
    """A quotient, term by term, so that ``(Y a + Y b)/Y`` is ``a + b``."""
    if scale == 1:
        return value
    return sp.Add(*(term / scale for term in sp.Add.make_args(value)))


def _plant(plant: Plant, scaling: Rescaling, table: Table) -> Plant:
    def column(values: Iterable[sp.Expr]) -> tuple[sp.Expr, ...]:
        return tuple(over(value.xreplace(table), scaling.y) for value in values)

    return replace(
        plant,
        phi=column(plant.phi),
        Phi=tuple(column(row) for row in plant.Phi),
        theta=tuple(value.xreplace(table) for value in plant.theta),
        b=tuple(over(value.xreplace(table) * scaling.u, scaling.y) for value in plant.b),
        sigma=plant.sigma.xreplace(table),
        disturbance=column(plant.disturbance),
    )


def _equation(item: Equation, scaling: Rescaling, table: Table) -> Equation:
    expression = over(item.expression.xreplace(table), scaling.of(item.symbol))
    return replace(item, expression=expression, unit=scaling.labels.get(item.symbol, item.unit))


def _written(item: Equation, scaling: Rescaling, table: Table) -> Equation:
    """A rate of a physical state, or a coordinate of the design, which has the unit of y."""
    state = real_symbol(item.name.removeprefix("rate_of_"))
    scale = scaling.of(state) if item.name.startswith("rate_of_") else scaling.y
    return replace(item, expression=over(item.expression.xreplace(table), scale))


def _extra(item: ExtraState, table: Table) -> ExtraState:
    return replace(item, rate=item.rate.xreplace(table))


def _channel(item: Channel, scaling: Rescaling, table: Table) -> Channel:
    """U in its own unit; another channel stays in SI units, and only v is in u's."""
    scale = scaling.u if item.symbol == U else sp.Integer(1)
    return replace(
        item,
        offset=over(item.offset.xreplace(table), scale),
        slope=item.slope.xreplace(table) * scaling.u / scale,
        lower=over(item.lower.xreplace(table), scale),
        upper=over(item.upper.xreplace(table), scale),
        unit=scaling.u_unit if item.symbol == U else item.unit,
    )


def _demand(item: Demand, table: Table) -> Demand:
    return replace(item, expression=item.expression.xreplace(table))


def _start(start: Start, order: int, scaling: Rescaling, table: Table) -> Start:
    design = {real_symbol(f"x{i}") for i in range(1, order + 1)}
    return replace(
        start,
        variables=tuple(_equation(item, scaling, table) for item in start.variables),
        states={
            state: over(form.xreplace(table), scaling.y if state in design else sp.Integer(1))
            for state, form in start.states.items()
        },
    )
