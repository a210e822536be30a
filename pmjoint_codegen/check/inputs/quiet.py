"""The plant of a design as a model file of its own: ``[plant]`` without disturbance.

The disturbance of a joint is physics that the design leaves out, and so is the lag of an actuator. Neither
can be switched off by a key. But the design's plant is a model as well, and its D is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.chain import DEAD_ZONE, LIMIT, LOWER, UPPER
from pmjoint_codegen.identity import Document
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.report.notation import plain_text
from pmjoint_codegen.values import ADRC, BRAKING, MATCHED, OBSERVER, ZERO
from pmjoint_derive import Derivation, Gains, Model

AWAY: Final = 0.2  # SI units of y, from the model's own start
SHARE: Final = 0.1  # of the range of y


def quiet_document(derivation: Derivation, manifest: Manifest, document: Document) -> dict[str, Any]:
    """A document with the same controller, start and reference, whose plant is that of the design.

    Args:
        derivation: of the model.
        manifest: of its generated code.
        document: the model file, which has the reference if that is data.
    """
    model, values = derivation.model, {item.name: item.value for item in manifest.parameters}
    names = {item.symbol: sp.Symbol(f"par{i}", real=True) for i, item in enumerate(model.parameters, start=1)}
    constants = {item.symbol: item.expression for item in model.constants}

    def text(expression: sp.Expr) -> str:
        while expression.free_symbols & constants.keys():
            expression = expression.xreplace(constants)
        return plain_text(expression.xreplace(names))

    plant, simulation = model.plant, model.simulation
    columns = {name: np.array([value]) for name, value in values.items()}
    x0 = manifest.start.states(np.array([manifest.simulation.x0]), columns)[0, : plant.order]
    x0[0] += _away(model)
    return {
        "schema": 1,
        "name": f"{model.name}-quiet"[:64],
        "parameters": {names[item.symbol].name: {"value": item.value} for item in model.parameters},
        "plant": {
            "order": plant.order,
            "phi": [text(entry) for entry in plant.phi],
            "Phi": [[text(entry) for entry in row] for row in plant.Phi],
            "theta": [text(entry) for entry in plant.theta],
            "b": [text(entry) for entry in plant.b],
            "sigma": text(plant.sigma),
        },
        "actuator": _actuator(manifest, values),
        "design": _design(model.gains),
        "simulation": {
            "reference": document["simulation"]["reference"] if model.segment else text(model.reference),
            "x0": x0.tolist(),
            "horizon": simulation.horizon,
            "output_step": simulation.output_step,
        },
        "units": {"y": model.y_unit, "u": model.u_unit},
    }


def _away(model: Model) -> float:
    """How far from the model's own start: that may have no error at all."""
    low, high = model.y_range or (-np.inf, np.inf)
    return float(min(AWAY / float(model.measures.y), SHARE * (high - low)))


def _actuator(manifest: Manifest, values: Mapping[str, float]) -> dict[str, float]:
    """Limits and dead zone as numbers; a lag is what this plant does without."""
    kept = {key: values[manifest.chain[key]] for key in (LOWER, UPPER, DEAD_ZONE) if key in manifest.chain}
    return kept if LOWER in kept else {LIMIT: values[manifest.limit], **kept}


def _design(gains: Gains) -> dict[str, Any]:
    """The gains as numbers."""
    found: dict[str, Any] = {kind: list(values) for kind, values in gains.by_kind.items() if values}
    if gains.observer is not None:
        found |= {"law": ADRC, OBSERVER: gains.observer}
    found |= {"input_scale": gains.input_scale, "start": MATCHED if gains.matched else ZERO}
    if gains.braking is not None:
        return found | {"saturation": BRAKING, "braking": gains.braking}
    return found | {"compensator": gains.compensator}
