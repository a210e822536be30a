"""Names of columns and parameters as Matplotlib sets them in mathematics."""

from __future__ import annotations

import re
from typing import Final

from pmjoint_codegen.manifest import LOGIT

_GREEK: Final = {
    "lambda": "\\lambda",
    "xi": "\\xi",
    "Xi": "\\Xi",
    "alpha": "\\alpha",
    "chi": "\\chi",
    "rho": "\\varrho",
    "theta": "\\theta",
}
_WHOLE: Final = {
    "theta": "$\\theta$",
    "theta_dot": "$\\dot\\theta$",
    "y_r": "$y_r$",
    "y_m": "$y_m$",
    "y_f": "$y_f$",
    "y_cmd": "$y_{cmd}$",
    "u_max": "$u_{\\max}$",
    "P_max": "$P_{\\max}$",
}
_STEMS: Final = (
    "x_hat",
    "lambda",
    "alpha",
    "chi",
    "xi",
    "Xi",
    "ck",
    "x",
    "r",
    "z",
    "D",
    "c",
    "e",
    "k",
    "P",
    "F",
    "d",
    "b",
    "g",
)


def symbol(name: str) -> str:
    """A column or parameter for a legend: ``x_hat1`` is an x with a hat and an index."""
    if "-" in name:
        first, _, second = name.partition("-")
        return f"${symbol(first).strip('$')} - {symbol(second).strip('$')}$"
    if name in _WHOLE:
        return _WHOLE[name]
    if re.fullmatch(r"[a-zA-Z]", name):
        return f"${name}$"
    estimated = re.fullmatch(r"([a-zA-Z]+?)_?(\d*)_hat", name)
    if estimated is not None:
        return _estimate(*estimated.groups())
    if name.endswith(LOGIT):
        return f"$\\ell_{{{symbol(name.removesuffix(LOGIT)).strip('$')}}}$"
    if name.startswith("gamma_"):
        return f"$\\gamma_{{{symbol(name.removeprefix('gamma_')).strip('$')}}}$"
    stated = re.fullmatch(r"(\w+)_(guess|low|high|prior)", name)
    if stated is not None:
        return f"${symbol(stated[1]).strip('$')}^{{\\mathrm{{{stated[2]}}}}}$"
    match = re.fullmatch(rf"({'|'.join(_STEMS)})(\d+)", name)
    if match is None:
        return "$\\mathrm{" + name.replace("_", "\\_") + "}$"
    stem, index = match.groups()
    if stem == "x_hat":
        return f"$\\hat{{x}}_{{{index}}}$"
    if stem == "ck":
        return f"$c_{{k{index}}}$"
    return f"${_GREEK.get(stem, stem)}_{{{index}}}$"


def _estimate(stem: str, index: str) -> str:
    """An estimate: its hat is over the stem alone, as wide as a word."""
    letter = _GREEK.get(stem, stem)
    hat = f"\\hat{{{letter}}}" if letter != stem or len(stem) == 1 else f"\\widehat{{\\mathrm{{{stem}}}}}"
    return f"${hat}_{{{index}}}$" if index else f"${hat}$"
