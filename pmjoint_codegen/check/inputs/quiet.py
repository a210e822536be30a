"""The plant of a design as a model file of its own: ``[plant]`` without disturbance.

The disturbance of a joint is physics that the design leaves out, and so is the lag of an actuator. Neither
can be switched off by a key. But the design's plant is a model as well, and its D is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.chain import DEAD_ZONE, LIMIT, LOWER, UPPER
from pmjoint_codegen.identity import Document
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.report.notation import plain_text
from pmjoint_codegen.values import ADRC, BRAKING, MATCHED, OBSERVER, ZERO
from pmjoint_derive import Derivation, Gains, Model
from pmjoint_derive.adaptation import Entry

Array = npt.NDArray[np.float64]

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
        **_adaptation(model, text),
        "simulation": {
            "reference": document["simulation"]["reference"] if model.segment else text(model.reference),
            "x0": x0.tolist(),
            "horizon": simulation.horizon,
            "output_step": simulation.output_step,
        },
        "units": {"y": model.y_unit, "u": model.u_unit},
    }


def start_away(model: Model, manifest: Manifest) -> Array | None:
    """Initial states at which something happens, of a model that starts where nothing does; else None.

    A matched controller knows y(0), but not the other states: so these are moved too.
    """
    usual = np.array(manifest.simulation.x0)
    if np.any(usual != 0.0):
        return None
    return usual + _away(model)


def _away(model: Model) -> float:
    """How far from the model's own start: that may have no error at all."""
    low, high = model.y_range or (-np.inf, np.inf)
    return float(min(AWAY / float(model.measures.y), SHARE * (high - low)))


def _adaptation(model: Model, text: Callable[[sp.Expr], str]) -> dict[str, Any]:
    """What the controller does not know, with every number stated."""
    given = model.adaptation
    if given is None:
        return {}
    count, shown = len(model.plant.b), [text(entry) for entry in model.plant.theta]

    def name(entry: Entry) -> str:
        if entry.place < count:
            return f"b{count - 1 - entry.place}"
        own = shown[entry.place - count]
        return own if own.isidentifier() and shown.count(own) == 1 else f"theta{entry.place - count + 1}"

    found: dict[str, Any] = {"guess": {name(entry): entry.guess for entry in given.entries}}
    if given.unknown:
        found |= {"unknown": [name(entry) for entry in given.unknown], "force": given.force}
        ranges = {name(entry): list(entry.range) for entry in given.unknown if entry.range is not None}
        found |= {"range": ranges} if ranges else {}
    if given.unknown and given.least_squares is None:
        found |= {"leakage": given.leakage, "gain": {name(entry): entry.gain for entry in given.unknown}}
        found["prior"] = {name(entry): entry.prior for entry in given.unknown}
    if given.inverse is not None:
        found |= {"form": "inverse", "inverse": asdict(given.inverse)}
    if given.least_squares is not None:
        found |= {"estimator": "least_squares", "least_squares": asdict(given.least_squares)}
    return {"adaptation": found}


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
