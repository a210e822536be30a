"""Converts a unit of ``[joint]`` to SI units, or gives one line that states why it cannot.

The labels of the shipped models and all products of coherent SI units are known here; pint handles any other,
and is loaded only then: it takes longer than the rest of reading a model.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from typing import Any, Final

from pmjoint_codegen.errors import MissingToolError, ModelError, installing, quoted
from pmjoint_codegen.values import SI
from pmjoint_derive.units import Unit, parse_unit

_ANGLE: Final = "rad"  # pint, too, treats angles as plain numbers
_COHERENT: Final = frozenset(
    ("kg", "m", "s", "A", "K", "mol", "cd", "N", "Pa", "J", "W", "C", "V", "Hz", _ANGLE)
)
# Numbers beyond two digits and powers of powers are no units, and would cost time and memory.
_HOSTILE: Final = re.compile(r"[\d.]{3}|(\^|\*\*)[\s()+\-\d]*(\^|\*\*)")


@dataclass(frozen=True)
class Wanted:
    """The required unit of a joint's number.

    Attributes:
        unit: in SI units, such as ``kg m^2``; empty if any unit is allowed.
        example: another unit of the same dimension.
    """

    unit: str
    example: str

    @property
    def rule(self) -> str:
        """The rule in a message."""
        kind = f"a unit of the dimension of {self.unit}" if self.unit not in ("", "1") else "a unit"
        if self.unit == "1":
            kind = "a dimensionless unit"
        return f'allowed: {kind}, such as "{self.unit or "N m"}" or "{self.example}"'


ANY: Final = Wanted("", "deg/s")


@dataclass(frozen=True)
class Scales:
    """Conversion into SI units; one record serves one model file.

    Attributes:
        where: file at the start of a message.
    """

    where: str

    def of(self, text: str, key: str, wanted: Wanted) -> str:
        """How many SI units a unit is, as a decimal; ``1`` for those of the SI itself.

        Args:
            text: the unit.
            key: its place in the file.
            wanted: its dimension.

        Raises:
            ModelError: no unit, a unit of another dimension, or one with an offset such as ``degC``.
            MissingToolError: pint is needed and not installed.
        """
        unit = parse_unit(text)
        if unit.powers.keys() <= _COHERENT and (not wanted.unit or _is_same(unit, parse_unit(wanted.unit))):
            return SI
        place = f"{self.where}: {key}"
        found = self._read(text, place, wanted)
        if wanted.unit and found.dimensionality != self._read(wanted.unit, place, wanted).dimensionality:
            raise ModelError(
                f"{quoted(text)} does not convert to {wanted.unit}", where=place, remedy=wanted.rule
            )
        return _decimal(found.magnitude)

    def si_label(self, text: str) -> str:
        """The SI unit of a unit's dimension, as an engineer writes it where there is one."""
        if text in ("", "1") or self.of(text, self.where, ANY) == SI:
            return text or "1"
        one = self._read(text, self.where, ANY)
        if _is_angle(one):
            return _ANGLE
        named = (name for name in _COHERENT if name not in ("Hz", _ANGLE))
        found = [
            name
            for name in (*sorted(named), "N m")
            if self._read(name, self.where, ANY).dimensionality == one.dimensionality
        ]
        return found[0] if found else f"{one.units:~C}".replace("**", "^").replace("*", " ")

    def power(self, text: str, of: str) -> int:
        """The power of another unit's dimension in a unit, times in any power aside: 1 for mm/s and m.

        Angles count as a dimension here; 0 where the unit is no such power.

        Args:
            text: a unit.
            of: the other unit.
        """
        own, other = (_dimensions(self._read(each, self.where, ANY)) for each in (text, of))
        return next((k for k in (1, -1, 2, -2) if own == {base: k * n for base, n in other.items()}), 0)

    def _read(self, text: str, place: str, wanted: Wanted) -> Any:
        """One of a unit in SI base units, as pint has it."""
        refusal = ModelError(f"{quoted(text)} is not a known unit", where=place, remedy=wanted.rule)
        if _HOSTILE.search(text):
            raise refusal
        registry = self._registry(place)
        try:
            unit = registry.parse_units(text)
            nothing, one = (registry.Quantity(Decimal(n), unit).to_base_units() for n in (0, 1))
        except Exception as error:  # pint raises what its parser, tokenizer and arithmetic happen to raise
            raise refusal from error
        if nothing.magnitude != 0 or not one.magnitude > 0:
            raise ModelError(
                f"{quoted(text)} has an offset: its zero is not 0", where=place, remedy=wanted.rule
            )
        return one

    def _registry(self, place: str) -> Any:
        try:
            return self._loaded
        except ModuleNotFoundError as error:
            raise MissingToolError(
                f"{error.name} is needed to convert a unit other than those of the SI",
                where=place,
                remedy=f"install it: {installing('pmjoint-codegen[derive]')}",
            ) from None

    @cached_property
    def _loaded(self) -> Any:
        import pint  # a quarter of a second, most of it for the table of units

        return pint.UnitRegistry(non_int_type=Decimal)


def _is_angle(one: Any) -> bool:
    return bool(one.dimensionless) and "radian" in one.units._units


def _dimensions(one: Any) -> dict[str, Any]:
    """Dimensions of a quantity in SI base units, without time unless nothing else is left."""
    found = dict(one.dimensionality)
    angle = one.units._units.get("radian", 0)
    if angle:
        found["[angle]"] = angle
    rest = {base: power for base, power in found.items() if base != "[time]"}
    return rest or found or {"[number]": 1}


def _is_same(unit: Unit, wanted: Unit) -> bool:
    """Whether two labels name one unit, regardless of angles."""
    plain = ({base: n for base, n in one.powers.items() if base != _ANGLE} for one in (unit, wanted))
    return next(plain) == next(plain)


def _decimal(magnitude: Any) -> str:
    """A decimal without an exponent's plus sign and without redundant zeros."""
    number = Decimal(magnitude).normalize()
    return SI if number == 1 else str(number)
