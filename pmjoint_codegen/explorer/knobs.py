"""A model with knobs: parameters that scale and shift its reference and its disturbance.

A page cannot derive and compile, so expressions that a reader wants to change need parameters. At the values
of `Knob` the model is the one in the file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pmjoint_codegen.manifest import Manifest

REFERENCE, DISTURBANCE = "reference", "disturbance"
GAIN, RATE, OFFSET, LOAD = "reference_gain", "reference_rate", "reference_offset", "load"
DISTURBANCE_GAIN: Final = "disturbance_gain"
_TIME: Final = re.compile(r"\bt\b")
TORQUE: Final = "N m"  # unit of a joint's disturbance


@dataclass(frozen=True)
class Knob:
    """One added parameter.

    Attributes:
        name: of the parameter.
        value: that leaves the model as it is.
        unit: as in the model file.
        about: one line for the reader.
        turns: `REFERENCE` or `DISTURBANCE`.
    """

    name: str
    value: float
    unit: str
    about: str
    turns: str


@dataclass(frozen=True)
class Knobbed:
    """A model file with knobs.

    Attributes:
        document: its contents.
        knobs: those that it has; a name that the model uses itself is left out.
        patterns: the expressions that the knobs turn, such as ``reference_gain*(sin(reference_rate*t))``: the
            reference, then the disturbance's entries.
    """

    document: dict[str, Any]
    knobs: tuple[Knob, ...]
    patterns: Mapping[str, tuple[str, ...]]


def with_knobs(document: Mapping[str, Any], manifest: Manifest) -> Knobbed:
    """Add knobs to a model file.

    Args:
        document: its contents.
        manifest: what was generated from it, for units.
    """
    taken = {item.name for item in manifest.parameters}
    units = {item.name: item.unit for item in manifest.signals}
    changed = dict(document)
    knobs: list[Knob] = []
    patterns: dict[str, tuple[str, ...]] = {}

    expression = document["simulation"].get("reference")
    if isinstance(expression, str):
        found = [knob for knob in _of_reference(expression, units["y_r"]) if knob.name not in taken]
        knobs += found
        turned = _turned_reference(expression, {knob.name for knob in found})
        changed["simulation"] = {**document["simulation"], "reference": turned}
        patterns[REFERENCE] = (turned,)

    table = next(name for name in ("joint", "system", "plant") if name in document)
    entries = _entries(document[table].get("disturbance"), 1 if table == "joint" else manifest.nx)
    place = 0 if table == "joint" else manifest.rho - 1
    unit = TORQUE if table == "joint" else units[f"D{place + 1}"]
    if table != "system":  # whose order of states says nothing of where the input enters
        found = [knob for knob in _of_disturbance(entries, unit) if knob.name not in taken]
        knobs += found
        forced = _turned_disturbance(entries, place, {knob.name for knob in found})
        changed[table] = {**document[table], "disturbance": forced[0] if table == "joint" else forced}
        patterns[DISTURBANCE] = tuple(forced)
    added = {knob.name: {"value": knob.value, "unit": knob.unit, "about": knob.about} for knob in knobs}
    changed["parameters"] = {**document.get("parameters", {}), **added}
    return Knobbed(changed, tuple(knobs), patterns)


def _of_reference(expression: str, unit: str) -> list[Knob]:
    rate = Knob(RATE, 1.0, "1", "how fast the model's reference runs", REFERENCE)
    return [
        Knob(GAIN, 1.0, "1", "multiple of the model's reference", REFERENCE),
        *([rate] if _TIME.search(expression) else []),
        Knob(OFFSET, 0.0, unit, "added to the reference", REFERENCE),
    ]


def _of_disturbance(entries: Sequence[str], unit: str) -> list[Knob]:
    gain = Knob(DISTURBANCE_GAIN, 1.0, "1", "multiple of the model's disturbance", DISTURBANCE)
    load = Knob(LOAD, 0.0, unit, "constant disturbance where the input acts", DISTURBANCE)
    return [*([gain] if any(_acts(entry) for entry in entries) else []), load]


def _turned_reference(expression: str, names: set[str]) -> str:
    turned = _TIME.sub(f"({RATE}*t)", expression) if RATE in names else expression
    turned = f"{GAIN}*({turned})" if GAIN in names else f"({turned})"
    return f"{turned} + {OFFSET}" if OFFSET in names else turned


def _turned_disturbance(entries: Sequence[str], place: int, names: set[str]) -> list[str]:
    turned = [
        f"{DISTURBANCE_GAIN}*({entry})" if DISTURBANCE_GAIN in names and _acts(entry) else entry
        for entry in entries
    ]
    if LOAD in names:
        turned[place] = f"{turned[place]} + {LOAD}" if _acts(entries[place]) else LOAD
    return turned


def _entries(given: Any, count: int) -> list[str]:
    """The entries of a disturbance, as text; a model without one has zeros."""
    if given is None:
        return ["0"] * count
    return [str(entry) for entry in (given if isinstance(given, list) else [given])]


def _acts(entry: str) -> bool:
    """Whether an entry is more than the number 0."""
    try:
        return float(entry) != 0.0
    except ValueError:
        return True
