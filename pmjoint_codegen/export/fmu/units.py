"""Physical units in SI base units, as an FMU declares them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from pmjoint_codegen.values import SI
from pmjoint_derive.units import Unit, parse_unit

_BASES: Final = {
    "[mass]": "kg",
    "[length]": "m",
    "[time]": "s",
    "[current]": "A",
    "[temperature]": "K",
    "[substance]": "mol",
    "[luminosity]": "cd",
}
_ANGLES: Final = ("rad", "deg", "degree", "degrees", "°")  # numbers to pint, a base unit to the FMI

Meaning = tuple[tuple[tuple[str, int], ...], float]  # exponents of base units, and how many of them


@dataclass(frozen=True)
class Declared:
    """A unit of variables.

    Attributes:
        name: as variables name it.
        exponents: of the SI base units and rad; None where the label has no known meaning.
        factor: how many products of base units it is.
        shown: the unit that a tool should show in its place, and how many of it are one; None: itself.
    """

    name: str
    exponents: tuple[tuple[str, int], ...] | None = None
    factor: float = 1.0
    shown: tuple[str, float] | None = None


@dataclass(frozen=True)
class Units:
    """Makes declarations; one record serves one export."""

    def of(self, label: str, scale: str = SI) -> Declared | None:
        """The declaration of a unit, or None for a plain number.

        Args:
            label: the unit as the model file has it.
            scale: how many SI units it is, where values are kept in SI units.
        """
        unit = parse_unit(label)
        if not unit.powers:
            return None
        found = self._meaning(unit)
        if found is None:
            return Declared(label)
        exponents, factor = found
        if scale == SI:
            return Declared(label, exponents, factor)
        return Declared(_product(exponents), exponents, 1.0, (label, 1.0 / float(scale)))

    def _meaning(self, unit: Unit) -> Meaning | None:
        """Exponents and factor; None where a part is unknown or has an offset, such as degC."""
        total: dict[str, int] = {}
        factor = 1.0
        for label, power in unit.powers.items():
            part = self._part(label)
            if part is None:
                return None
            for base, exponent in part[0]:
                total[base] = total.get(base, 0) + exponent * power
            factor *= part[1] ** power
        order = (*_BASES.values(), "rad")
        return tuple((base, total[base]) for base in order if total.get(base)), factor

    def _part(self, label: str) -> Meaning | None:
        """One factor of a unit."""
        try:
            zero, one = (self._registry.Quantity(float(n), label).to_base_units() for n in (0, 1))
            dimensions = [(_BASES[name], int(power)) for name, power in one.dimensionality.items()]
        except (
            Exception
        ):  # pint raises what its parser and tables happen to raise: the label means nothing here
            return None
        if zero.magnitude != 0:
            return None
        angle = [("rad", 1)] if label in _ANGLES else []
        return (*dimensions, *angle), float(one.magnitude)

    @cached_property
    def _registry(self) -> Any:
        import pint  # a quarter of a second, most of it for the table of units

        return pint.UnitRegistry()


def _product(exponents: tuple[tuple[str, int], ...]) -> str:
    """A product of base units as the FMI writes it, such as kg.m2.s-2."""
    return ".".join(base if power == 1 else f"{base}{power}" for base, power in exponents) or "1"
