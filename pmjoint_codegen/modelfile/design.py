"""The design of a model file in numbers: what its keys come to at the file's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.points import NotFiniteError, value_at
from pmjoint_codegen.modelfile.schema import ModelSpec
from pmjoint_codegen.values import BRAKING, MATCHED
from pmjoint_derive import Gains, Parameter

DEFAULT_BRAKING: Final = 0.5  # of the limit: the reference needs the rest


def gains_of(
    spec: ModelSpec, physics: Mapping[str, Any], parameters: tuple[Parameter, ...], where: str
) -> Gains:
    """The gains as numbers.

    Args:
        spec: a validated model file.
        physics: ``plant`` and, for a joint, ``constants`` of the model.
        parameters: of the model, with their values.
        where: file at the start of a message.

    Raises:
        ModelError: ``input_scale = "auto"`` where b_m has no finite value other than 0.
    """
    design = spec.design
    scale = design.input_scale
    if scale == "auto":
        scale = _leading(physics, parameters, where)
    brakes = design.saturation == BRAKING and spec.relative_degree == 2  # for one state, it is (23)
    return Gains(
        c=design.c,
        e=design.e,
        ck=design.ck,
        k=design.k,
        compensator=design.compensated,
        matched=design.start == MATCHED,
        input_scale=float(scale),
        braking=(DEFAULT_BRAKING if design.braking is None else design.braking) if brakes else None,
    )


def _leading(physics: Mapping[str, Any], parameters: tuple[Parameter, ...], where: str) -> float:
    """|b_m| at the file's values."""
    point: dict[sp.Symbol, float] = {item.symbol: item.value for item in parameters}
    try:
        for constant in physics.get("constants", ()):
            point[constant.symbol] = value_at(constant.expression, point)
        size = abs(value_at(physics["plant"].b[0], point))
    except NotFiniteError:
        size = 0.0
    if size == 0:
        raise ModelError(
            "is auto, but b_m is 0 or not finite at the given parameters",
            where=f"{where}: design.input_scale",
            remedy="allowed: parameters for which it is a number other than 0",
        )
    return size
