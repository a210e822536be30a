"""Physical units as products of integer powers, enough to label every signal of a design.

A unit is written as engineers write it: ``rad/(s^2 V)``, ``1/s``, ``V s``. Only products, quotients and
integer powers occur in the derivation, so the algebra is a mapping from base symbol to exponent. Numbers
hidden in a model's expressions (the 0.1 in ``0.1*sin(x2)``) have units that are not written down; so units
are *labels*, not checks.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

_TOKEN = re.compile(r"[A-Za-zµΩ%°]+|1|[/()*·]|\^-?\d+")


@dataclass(frozen=True)
class Unit:
    """A product of integer powers of base symbols.

    Attributes:
        powers: exponent of each base symbol; no exponent is zero.
    """

    powers: Mapping[str, int]

    def __post_init__(self) -> None:
        """Drop zero exponents and freeze the mapping."""
        object.__setattr__(
            self, "powers", MappingProxyType({base: power for base, power in self.powers.items() if power})
        )

    def __mul__(self, other: Unit) -> Unit:
        """Product of two units."""
        bases = dict.fromkeys((*self.powers, *other.powers))
        return Unit({base: self.powers.get(base, 0) + other.powers.get(base, 0) for base in bases})

    def __pow__(self, exponent: int) -> Unit:
        """Integer power of a unit."""
        return Unit({base: power * exponent for base, power in self.powers.items()})

    def __truediv__(self, other: Unit) -> Unit:
        """Quotient of two units."""
        return self * other**-1

    def __str__(self) -> str:
        """The unit as an engineer writes it, ``1`` when it is dimensionless."""
        above = [_factor(base, power) for base, power in self.powers.items() if power > 0]
        below = [_factor(base, -power) for base, power in self.powers.items() if power < 0]
        numerator = " ".join(above) or "1"
        if not below:
            return numerator
        denominator = below[0] if len(below) == 1 else f"({' '.join(below)})"
        return f"{numerator}/{denominator}"


def _factor(base: str, power: int) -> str:
    return base if power == 1 else f"{base}^{power}"


@dataclass(frozen=True)
class Measures:
    """The units of y and u in SI units, in which the design's gains are stated.

    Attributes:
        y: how many SI units the unit of y is, as a decimal.
        u: likewise of u.
        input_scale: u over y: what kappa of SI units is multiplied with for the law in these units.
        si: SI units of y and u; None: their own.
    """

    y: str = "1"
    u: str = "1"
    input_scale: str = "1"
    si: tuple[str, str] | None = None


SECOND = Unit({"s": 1})


def parse_unit(text: str) -> Unit:
    """Read a unit such as ``rad/(s^2 V)``; a slash binds the next factor or bracket only.

    Args:
        text: the unit; empty and ``1`` are dimensionless. Text of any other form is kept whole as one base
            symbol, since
            a label that is not understood is still a label.
    """
    tokens = _TOKEN.findall(text)
    if "".join(tokens) != "".join(text.split()):
        return Unit({text.strip(): 1})
    try:
        unit, rest = _product(tokens)
    except (IndexError, ValueError):
        return Unit({text.strip(): 1})
    return unit if not rest else Unit({text.strip(): 1})


def _product(tokens: list[str]) -> tuple[Unit, list[str]]:
    unit, sign = Unit({}), 1
    while tokens and tokens[0] != ")":
        if tokens[0] in "/*·":
            sign, tokens = (-1 if tokens[0] == "/" else 1), tokens[1:]
            continue
        factor, tokens = _read_factor(tokens)
        unit, sign = unit * factor**sign, 1
    return unit, tokens


def _read_factor(tokens: list[str]) -> tuple[Unit, list[str]]:
    if tokens[0] == "(":
        unit, rest = _product(tokens[1:])
        if rest[0] != ")":
            raise ValueError("bracket not closed")
        return unit, rest[1:]
    if tokens[0].startswith("^"):
        raise ValueError("a power without a base")
    base = Unit({}) if tokens[0] == "1" else Unit({tokens[0]: 1})
    if len(tokens) > 1 and tokens[1].startswith("^"):
        return base ** int(tokens[1][1:]), tokens[2:]
    return base, tokens[1:]
