"""Named laws of a muscle's static force: source, constants, and their values where published.

A law is written as a model file would write it, an expression of P (Pa), eps and its constants; values are
in SI units. Laws are facts of the literature. A value is only here where its source could be checked.

Not here: the law of Martens and Boblan (Actuators 6 (2017) 33), affine in pressure too. Its published
constants, as they are quoted elsewhere, do not reproduce its published force map (12 % of the largest force
instead of 2.35 %), so there is nothing to check an implementation against.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

PAPER: Final = "paper"  # (2), whose constants C1..C4 are lines of [joint]


@dataclass(frozen=True)
class Constant:
    """A constant of a law.

    Attributes:
        unit: SI unit.
        example: another unit of the same dimension.
        about: one line for the reader.
        value: in SI units, or None where the file must give it.
    """

    unit: str
    example: str
    about: str
    value: float | None = None


@dataclass(frozen=True)
class ForceLaw:
    """A law of the static force of one muscle.

    Attributes:
        formula: an expression of P, eps and the constants, N.
        source: where law and values come from.
        constants: name -> constant.
    """

    formula: str
    source: str
    constants: Mapping[str, Constant]


def _valued(law: ForceLaw, source: str, **values: float) -> ForceLaw:
    """The law of a named muscle: values for some constants."""
    constants = {
        name: Constant(item.unit, item.example, item.about, values.get(name, item.value))
        for name, item in law.constants.items()
    }
    return ForceLaw(law.formula, f"{law.source}; values: {source}", MappingProxyType(constants))


_PAPER = ForceLaw(
    "P*(C1*eps**2 + C2*eps + C3) + C4",
    "Cai et al., IEEE Access 2020, (2)",
    MappingProxyType({}),
)
_BRAID: Final = {
    "D0": Constant("m", "mm", "diameter at rest"),
    "alpha0": Constant("rad", "deg", "angle between thread and axis at rest"),
}
_CHOU_HANNAFORD = ForceLaw(
    "P*pi*D0**2/4*(3*(1 - eps)**2/tan(alpha0)**2 - 1/sin(alpha0)**2)",
    "Chou and Hannaford, IEEE Trans. Robotics and Automation 12 (1996) 90-102: ideal braid, work of pressure",
    MappingProxyType(_BRAID),
)
_TONDU_LOPEZ = ForceLaw(
    "P*pi*D0**2/4*(3*(1 - k_end*eps)**2/tan(alpha0)**2 - 1/sin(alpha0)**2)",
    "Tondu and Lopez, IEEE Control Systems Magazine 20(2) (2000) 15-38: braid with conical ends, k constant",
    MappingProxyType(
        {**_BRAID, "k_end": Constant("1", "%", "factor of the contraction for the ends' shape")}
    ),
)
_HUNT = ForceLaw(
    "F_max*(a0*(exp(-a1*eps/eps_max) - 1) + P/P_ref*exp(-a3*(eps/eps_max)**2))",
    "Bolen and Hunt: surface fitted to Festo muscles; github.com/Agile-and-Adaptive-Robotics/Bipedal_Robot",
    MappingProxyType(
        {
            "F_max": Constant("N", "kN", "force at P_ref without contraction"),
            "P_ref": Constant("Pa", "kPa", "pressure that F_max and eps_max are of", 620e3),
            "eps_max": Constant("1", "%", "contraction without load at P_ref"),
            "a0": Constant("1", "%", "constant of the fit"),
            "a1": Constant("1", "%", "constant of the fit"),
            "a3": Constant("1", "%", "constant of the fit"),
        }
    ),
)
_SAROSI = ForceLaw(
    "(a1*P + a2)*exp(a3*eps) + a4*P*eps + a5*P + a6",
    "Sarosi, Tehnicki vjesnik 22 (2015) 1489-1494, DOI 10.17559/TV-20140716143627",
    MappingProxyType(
        {
            "a1": Constant("m^2", "N/bar", "constant of the fit"),
            "a2": Constant("N", "kN", "constant of the fit"),
            "a3": Constant("1", "1/percent", "constant of the fit"),
            "a4": Constant("m^2", "N/bar", "constant of the fit"),
            "a5": Constant("m^2", "N/bar", "constant of the fit"),
            "a6": Constant("N", "kN", "constant of the fit"),
        }
    ),
)
_FITS: Final = "festo_lookup_coeffs.json and festo4.m there"
_QUOTED: Final = "as quoted in ModelComparison2.m of github.com/Agile-and-Adaptive-Robotics/Bipedal_Robot"

FORCE_LAWS: Final[Mapping[str, ForceLaw]] = MappingProxyType(
    {
        PAPER: _PAPER,
        "chou-hannaford": _CHOU_HANNAFORD,
        "tondu-lopez": _TONDU_LOPEZ,
        "hunt": _HUNT,
        # F_max of a 10 mm muscle depends on its length, eps_max of every muscle does: the file gives them
        "hunt-10": _valued(_HUNT, _FITS, a0=0.568207874671, a1=4.25442545542, a3=0.55972777762),
        "hunt-20": _valued(_HUNT, _FITS, F_max=1500.0, a0=0.257852586017, a1=6.4766142989, a3=1.32087718059),
        "hunt-40": _valued(_HUNT, _FITS, F_max=6000.0, a0=0.122366088343, a1=10.4714342293, a3=2.02328814095),
        "sarosi": _SAROSI,
        # quoted for p in bar and the contraction in percent: 1 N/bar is 1e-5 m^2
        "sarosi-dmsp-10": _valued(
            _SAROSI,
            _QUOTED,
            a1=-9.2194029e-5,
            a2=203.7012413,
            a3=-34.221042,
            a4=-3.2255991e-3,
            a5=109.2038216e-5,
            a6=-208.372034,
        ),
        "sarosi-dmsp-20-200": _valued(
            _SAROSI,
            _QUOTED,
            a1=-4.00180705e-5,
            a2=292.4620246,
            a3=-32.930845,
            a4=-9.33564098e-3,
            a5=294.0538256e-5,
            a6=-280.498151,
        ),
        "sarosi-dmsp-20-400": _valued(
            _SAROSI,
            _QUOTED,
            a1=-4.35573e-5,
            a2=281.2237,
            a3=-32.866,
            a4=-9.27035e-3,
            a5=302.20107e-5,
            a6=-263.69185,
        ),
    }
)
