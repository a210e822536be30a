"""The units of y, u and physical states of ``[joint]`` and ``[system]``, which their columns have.

Expressions of the physics are in SI units. `pmjoint_derive.rescaling` then writes the result in the file's
units. Columns, x0, limits, the sensor's numbers and the reference are in them.

A reference is an expression in y's unit: ``20*sin(w*t)`` is an amplitude of 20 deg where y is in deg.
Parameters of y's dimension stand for quantities, whatever unit they have: ``amplitude`` may be in rad. All
others, and all arguments of functions, are in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any, Final

import sympy as sp

from pmjoint_codegen.chain import LINKS
from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.bench import chain_names
from pmjoint_codegen.modelfile.load import LOAD, is_loaded
from pmjoint_codegen.modelfile.schema import ModelSpec
from pmjoint_codegen.modelfile.units import ANY, Scales, Wanted
from pmjoint_codegen.values import SI, from_si, to_si
from pmjoint_derive import Parameter, real_symbol
from pmjoint_derive.balance import OMEGA, THETA
from pmjoint_derive.rescaling import Rescaling, exact, outside_functions
from pmjoint_derive.units import SECOND, Measures, Unit, parse_unit

_PLAIN: Final = ("", "1")


@dataclass(frozen=True)
class Columns:
    """The units of y and u in a model file.

    Attributes:
        y: label of y's unit.
        u: label of u's.
        y_scale: how many SI units that of y is, as a decimal.
        u_scale: likewise of u.
        scales: conversion of this file's units.
    """

    y: str
    u: str
    y_scale: str
    u_scale: str
    scales: Scales

    @property
    def is_si(self) -> bool:
        """Whether both are units of the SI."""
        return self.y_scale == self.u_scale == SI

    @property
    def measures(self) -> Measures:
        """For the derivation."""
        if self.is_si:
            return Measures()
        si = (self.scales.si_label(self.y), self.scales.si_label(self.u))
        return Measures(self.y_scale, self.u_scale, ratio(self.u_scale, self.y_scale), si)

    def scale_of(self, unit: str) -> str:
        """SI units per unit of a link of the bench, such as ``u/s``."""
        return {"y": self.y_scale, "u": self.u_scale}.get(unit.partition("/")[0], SI)


def columns_of(spec: ModelSpec, scales: Scales) -> Columns:
    """The units of y and u.

    Raises:
        ModelError: not a unit, one of another dimension than a joint's, or one with an offset.
    """
    y, u = spec.units.y, spec.units.u
    wanted = {"y": ANY, "u": ANY}
    if spec.joint is not None:
        wanted = {"y": Wanted("rad", "deg"), "u": Wanted("V", "mV")}
    found = {
        name: SI if text in _PLAIN and spec.joint is None else scales.of(text, f"units.{name}", wanted[name])
        for name, text in (("y", y), ("u", u))
    }
    if spec.joint is not None and y in _PLAIN:
        raise ModelError("is no angle", where=f"{scales.where}: units.y", remedy="allowed: rad, or deg")
    return Columns(y, u, found["y"], found["u"], scales)


def in_column_units(
    parameters: tuple[Parameter, ...], spec: ModelSpec, columns: Columns
) -> tuple[Parameter, ...]:
    """Parameters of the actuator, the sensor and the load in the units of u and y, others in SI units.

    Raises:
        ModelError: one that stands for a quantity of y and for one of u, whose units differ.
    """
    scales = _in_columns(spec, columns)
    return tuple(_in_unit(item, scales.get(item.name, SI)) for item in parameters)


def _in_columns(spec: ModelSpec, columns: Columns) -> dict[str, str]:
    """Parameters of the actuator, the sensor and the load -> SI units per unit of their column."""
    return _of_links(spec, columns) | ({LOAD: columns.y_scale} if is_loaded(spec) else {})


def _of_links(spec: ModelSpec, columns: Columns) -> dict[str, str]:
    """Parameter of the actuator or the sensor -> SI units per unit of its column."""
    names = chain_names(spec)
    found: dict[str, str] = {}
    for link in LINKS:
        name, scale = names.get(link.key), columns.scale_of(link.unit)
        if name is not None and found.setdefault(name, scale) != scale:
            raise ModelError(
                "stands for a quantity of y and for one of u, which have different units",
                where=f"{columns.scales.where}: parameters.{name}",
                remedy="give each its own parameter",
            )
    return found


def _in_unit(item: Parameter, scale: str) -> Parameter:
    if scale == SI:
        return item
    own = ratio(item.scale, scale)
    return replace(item, value=to_si(from_si(item.value, item.scale), own), scale=own)


def ratio(scale: str, other: str) -> str:
    """One scale over another, as a decimal."""
    number = (Decimal(scale) / Decimal(other)).normalize()
    return SI if number == 1 else str(number)


def rescaling_of(spec: ModelSpec, physics: Mapping[str, Any], columns: Columns) -> Rescaling:
    """How many SI units the units of a file are.

    Args:
        spec: the file.
        physics: its plant in SI units, with physical states in ``reported``.
        columns: units of y and u.

    Raises:
        ModelError: the unit of a state is none, or has an offset.
    """
    named = {real_symbol(name): exact(scale) for name, scale in _in_columns(spec, columns).items()}
    labels: dict[sp.Symbol, Unit] = {}
    if spec.joint is not None:
        angle = parse_unit(columns.y)
        labels = {THETA: angle, OMEGA: angle / SECOND}
        named |= dict.fromkeys(labels, exact(columns.y_scale))
    elif physics.get("start") is not None:
        for i, item in enumerate(physics["start"].variables, start=1):
            named[item.symbol] = _of_state(item.unit, f"system.units, entry {i}", columns.scales)
    return Rescaling(exact(columns.y_scale), exact(columns.u_scale), named, labels, columns.u)


def _of_state(unit: Unit | None, key: str, scales: Scales) -> sp.Expr:
    text = "" if unit is None else str(unit)
    return sp.Integer(1) if text in _PLAIN else exact(scales.of(text, key, ANY))


def in_unit_of_y(reference: sp.Expr, parameters: tuple[Parameter, ...], columns: Columns) -> sp.Expr:
    """A reference with the values of parameters of y's dimension in y's unit.

    Args:
        reference: of t and parameters.
        parameters: all of the model.
        columns: units of y and u.
    """
    if columns.y_scale == SI:
        return reference
    one = exact(columns.y_scale)
    table = {}
    for item in parameters:
        if item.symbol in reference.free_symbols and item.unit not in _PLAIN:
            inside = exact(ratio(columns.scales.of(item.unit, item.name, ANY), item.scale))
            power = columns.scales.power(item.unit, columns.y)
            table[item.symbol] = item.symbol * inside / one**power
    return outside_functions(reference, table)
