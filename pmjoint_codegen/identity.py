"""When two models are the same: hashes over the parsed model file, not over its text.

Comments, layout and ``15`` versus ``15.0`` do not matter. The *model* hash covers everything; ``model.json``
holds it. The *structure* hash covers only what shapes the kernels; their banners show it. A new value of a
parameter or gain changes no kernel, so compiled code is reused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

Document = Mapping[str, Any]


def _normal(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, (int, float, Mapping, list, tuple)):
        return value
    if isinstance(value, Mapping):
        return {str(key): _normal(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_normal(entry) for entry in value]
    return float(value)


def canonical_hash(value: Any) -> str:
    """SHA-256 of the canonical JSON of ``value``: keys sorted, numbers as doubles, no white space."""
    text = json.dumps(_normal(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def model_hash(document: Document) -> str:
    """Hash of everything in a model file, except the numbers of a reference that is data.

    No kernel contains these, and a run reports a hash of their own.
    """
    reference = document.get("simulation", {}).get("reference")
    if isinstance(reference, Mapping):
        document = {**document, "simulation": {**document["simulation"], "reference": _DATA}}
    return canonical_hash(document)


_DATA: dict[str, Any] = {"data": True}
_REMARKS = {"disturbance_bound", "range"}  # statements about the plant, not part of it


def structure(document: Document) -> dict[str, Any]:
    """The part of a model file that shapes its kernels: expressions, names in order, and sizes."""
    plant = dict(document.get("plant", {}))
    for key in _REMARKS:
        plant.pop(key, None)
    joint = document.get("joint", {})
    system = {key: value for key, value in document.get("system", {}).items() if key not in _REMARKS}
    design = document.get("design", {})
    reference = document.get("simulation", {}).get("reference")
    return {
        "schema": document.get("schema"),
        "parameters": list(document.get("parameters", {})),
        "plant": plant,
        "joint": [
            sorted({*joint} - _REMARKS),
            joint.get("keep"),
            joint.get("disturbance"),
        ],
        **({"system": system} if system else {}),
        **({"adaptation": _adaptation(document)} if "adaptation" in document else {}),
        "limit": document.get("actuator", {}).get("limit"),
        **({"law": design["law"]} if design.get("law", "backstepping") != "backstepping" else {}),
        "gains": {key: len(value) for key, value in design.items() if isinstance(value, (list, tuple))},
        "reference": _DATA if isinstance(reference, Mapping) else reference,
    }


def _adaptation(document: Document) -> dict[str, Any]:
    """The part of ``[adaptation]`` that shapes kernels: what is estimated and how, not the numbers.

    The law contains the sign of b_m, which its guess or its range states.
    """
    table = document["adaptation"]
    ends = {name: ends[0] for name, ends in table.get("range", {}).items() if ends}
    return {
        **{key: table.get(key) for key in ("unknown", "load", "form", "estimator", "force")},
        "guess": sorted({*table.get("guess", {})} - {*(table.get("unknown") or ())}),
        "range": sorted(ends),
        "negative": sorted(
            name
            for name, number in {**ends, **table.get("guess", {})}.items()
            if number < 0 and _may_lead(name, document)
        ),
    }


def _may_lead(name: str, document: Document) -> bool:
    """Whether an entry may be b_m; of a system, only the derivation knows."""
    b = document.get("plant", {}).get("b")
    if "joint" in document:
        return name == "b0"
    return name in (f"b{len(b) - 1}", str(b[0]).strip()) if b else True


def structure_hash(document: Document) -> str:
    """Hash of :func:`structure`."""
    return canonical_hash(structure(document))
