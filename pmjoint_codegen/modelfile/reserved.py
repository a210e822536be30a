"""Names that a design with guesses or estimates gives to numbers, signals and steps of its own.

They are refused beside ``[adaptation]`` alone: elsewhere ``V`` and ``tau_w`` are names like any other.
"""

from __future__ import annotations

import re
from typing import Final

from pmjoint_derive.adaptation import RHO_HAT, Adaptation, Entry, settings_of
from pmjoint_derive.units import Unit

_OF_DESIGN: Final = re.compile(
    r"chi\d+|V|V_(z|Theta|epsilon)|P_\d\d|zeta\d+|alpha_bar(_start)?|prediction_(error|norm)|pull_rho"
    r"|d\d*(alpha|zeta|Gamma)\w*_d\w+"  # partial derivatives
)
_OF_ENTRY: Final = ("omega_{}", "omega1_{}", "tau_{}", "pull_{}", "Gamma_{}", "Gamma_{}_start")
_OF_ESTIMATE: Final = ("{}", "{}_dot", "{}_next", "{}_start")
_OF_RANGE: Final = ("{}_turn", "{}_logit", "{}_logit_dot", "{}_logit_next", "{}_logit_start")


def own_names(adaptation: Adaptation) -> tuple[str, ...]:
    """Names of guesses, numbers and estimates, with any that occurs twice."""
    settings = settings_of(adaptation, Unit({}))
    estimates = [entry.estimate for entry in adaptation.unknown]
    inverse = [RHO_HAT] if adaptation.inverse else []
    return tuple(symbol.name for symbol in (*(item.symbol for item in settings), *estimates, *inverse))


def is_taken(name: str, adaptation: Adaptation) -> bool:
    """Whether a parameter or state cannot have this name.

    Args:
        name: of the parameter or state.
        adaptation: what the controller does not know.
    """
    if name in own_names(adaptation):
        return True
    if not adaptation.unknown:
        return False
    states = [entry.estimate.name for entry in adaptation.unknown]
    states += [RHO_HAT.name] if adaptation.inverse else []
    states += [symbol.name for row in adaptation.covariance for symbol in row]
    made = {form.format(state) for state in states for form in _OF_ESTIMATE}
    made |= {each for entry in adaptation.unknown for each in _of_entry(entry)}
    return name in made or _OF_DESIGN.fullmatch(name) is not None


def _of_entry(entry: Entry) -> list[str]:
    return [form.format(entry.name) for form in (*_OF_ENTRY, *_OF_RANGE)]
