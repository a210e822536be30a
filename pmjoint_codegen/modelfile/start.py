"""``x0`` by name: ``{ theta = 0.1, P1 = 2e5 }`` in place of a list; what is not named starts at 0.

The pressures of a joint with a lag may be given as such, P1 and P2, or as distances from P_0, q1 and q2.
P_0 is then that of the file's parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pmjoint_codegen.errors import ModelError, did_you_mean
from pmjoint_codegen.modelfile.joint import joint_parameters
from pmjoint_codegen.modelfile.units import Scales

if TYPE_CHECKING:
    from pmjoint_codegen.modelfile.schema import ModelSpec

_KEY = "simulation.x0"
_MOTION, _DISTANCES, _PRESSURES = ("theta", "theta_dot"), ("q1", "q2"), ("P1", "P2")


def named_start(document: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """``x0`` of a document where it is a table, else None."""
    simulation = document.get("simulation")
    found = simulation.get("x0") if isinstance(simulation, Mapping) else None
    return found if isinstance(found, Mapping) else None


def in_order(spec: ModelSpec, given: Mapping[str, Any], where: str) -> tuple[float, ...]:
    """The list that a table stands for.

    Args:
        spec: the file.
        given: name -> number.
        where: file at the start of a message.

    Raises:
        ModelError: an unknown name, a pressure given twice, or what is no finite number.
    """
    lagged = spec.joint is not None and spec.joint.tau is not None
    names = _names(spec, lagged=lagged)
    known = (*names, *_PRESSURES) if lagged else names
    for name, value in given.items():
        _check(name, value, known, f"{where}: {_KEY}")
    found = {name: float(given.get(name, 0.0)) for name in names}
    for name, distance, side in zip(_PRESSURES, _DISTANCES, (1.0, -1.0), strict=True):
        if name not in given:
            continue
        if distance in given:
            raise ModelError(
                f"{name} and {distance} are both given", where=f"{where}: {_KEY}", remedy="give one of them"
            )
        found[distance] = side * (float(given[name]) - _base(spec, where))
    return tuple(found.values())


def _names(spec: ModelSpec, *, lagged: bool) -> tuple[str, ...]:
    if spec.joint is not None:
        return (*_MOTION, *_DISTANCES) if lagged else _MOTION
    if spec.system is not None and spec.system.states is not None:
        return spec.system.states
    return tuple(f"x{i}" for i in range(1, spec.order + 1))


def _check(name: str, value: object, known: tuple[str, ...], place: str) -> None:
    if name not in known:
        guess = did_you_mean(name, known)
        raise ModelError("is no state", where=f"{place}.{name}", remedy=f"{guess}allowed: {', '.join(known)}")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ModelError("is no finite number", where=f"{place}.{name}", remedy="allowed: a finite number")


def _base(spec: ModelSpec, where: str) -> float:
    """P_0 in Pa."""
    assert spec.joint is not None
    values = {item.name: item.value for item in joint_parameters(spec.joint, Scales(where))}
    return values["k0"] * values["u0"]
