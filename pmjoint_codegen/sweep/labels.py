"""Names and units as a figure of a sweep shows them."""

from __future__ import annotations

import re
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import xarray as xr

GREEK: Final = MappingProxyType(  # words that are letters -> TeX
    {
        **{
            word: rf"\{word}"
            for word in ("alpha", "beta", "gamma", "delta", "theta", "kappa", "lambda", "mu")
        },
        **{word: rf"\{word}" for word in ("nu", "xi", "rho", "sigma", "tau", "phi", "psi", "omega", "zeta")},
        "eps": r"\varepsilon",
        "epsilon": r"\varepsilon",
    }
)


def symbol(name: str) -> str:
    """Letter, index and word of a name as mathematics: ``b0_plant``, ``ck1``, ``tau``; others as they are."""
    match = re.fullmatch(rf"(ck|[A-Za-z]|{'|'.join(GREEK)})(\d*)(?:_([A-Za-z]+))?", name)
    if match is None:
        return name.replace("_", " ")
    letter, index, word = match.groups()
    if word == "dot":
        letter, word = rf"\dot{{{GREEK.get(letter, letter)}}}", None
    letter, index = ("c", f"k{index}") if letter == "ck" else (GREEK.get(letter, letter), index)
    below = ",".join(part for part in (index, rf"\mathrm{{{word}}}" if word else "") if part)
    return f"${letter}_{{{below}}}$" if below else f"${letter}$"


def unit(values: xr.DataArray) -> str:
    """The unit of a column, with raised powers; ``1`` for a pure number."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", str(values.attrs.get("units", ""))) or "1"
