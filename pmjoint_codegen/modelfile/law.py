"""The keys ``law`` and ``observer`` of ``[design]``: which control law a file wants, and what that law takes.

Backstepping, or ADRC, a law to compare with: an extended-state observer that has neither the filters' gains
nor a compensator.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from pmjoint_codegen.errors import ModelError, quoted
from pmjoint_codegen.modelfile.tables import Positive, Table
from pmjoint_codegen.values import ADRC, BACKSTEPPING, CLIP, OBSERVER

if TYPE_CHECKING:
    from pmjoint_codegen.modelfile.schema import ModelSpec

_FOREIGN = ("e", "ck", "k", "poles", "bandwidth", "braking")  # keys that mean nothing to ADRC
_TAKEN = re.compile(rf"{OBSERVER}|eso[1-9]\d*")


class LawSpec(Table):
    """Keys of ``[design]`` that choose a law."""

    law: Literal["backstepping", "adrc"] = Field(
        default="backstepping", description='"backstepping" or "adrc"'
    )
    observer: Positive | None = Field(
        default=None, description='a finite number of 1/s greater than 0, with law = "adrc"'
    )


def check_law(spec: ModelSpec, where: str) -> bool:
    """Compare the keys of a design with its law.

    Args:
        spec: a file.
        where: file at the start of a message.

    Returns:
        Whether the law is one that takes the gains of backstepping.

    Raises:
        ModelError: a key that its law does not know, one that it needs, or a parameter that has the name of
            something of the observer.
    """
    design = spec.design

    def refuse(key: str, what: str, remedy: str) -> ModelError:
        return ModelError(what, where=f"{where}: {key}", remedy=remedy)

    if design.law == BACKSTEPPING:
        if design.observer is not None:
            raise refuse(
                "design.observer", "has no effect on backstepping", 'give law = "adrc", or leave it out'
            )
        return True
    for key in ("c", OBSERVER):
        if getattr(design, key) is None:
            allowed = type(design).model_fields[key].description
            raise refuse(f"design.{key}", "is missing", f"allowed: {allowed}")
    foreign = [key for key in _FOREIGN if getattr(design, key) is not None]
    foreign += ["input_scale"] if design.input_scale != 1 else []
    if foreign:
        remedy = (
            "leave it out: this law takes c, its poles at -c_i, and observer, with all poles at -observer"
        )
        raise refuse(f"design.{foreign[0]}", 'means nothing to law = "adrc"', remedy)
    for key, absent in {"compensator": False, "saturation": CLIP}.items():
        if getattr(design, key) not in (None, absent):
            what = f'is {quoted(str(getattr(design, key)).lower())}, but law = "adrc" is clipped plainly'
            raise refuse(f"design.{key}", what, "leave it out")
    if spec.adaptation is not None and (spec.adaptation.unknown or spec.adaptation.load):
        remedy = "leave it out: the observer estimates all that the model leaves out, as one disturbance"
        raise refuse("adaptation", 'law = "adrc" estimates no parameter', remedy)
    for name in filter(_TAKEN.fullmatch, spec.parameter_names):
        raise refuse(
            f"parameters.{name}", f'already names something of law = "{ADRC}"', "choose another name"
        )
    return False
