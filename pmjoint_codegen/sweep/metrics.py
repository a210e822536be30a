"""Every variable of a sweep's dataset with one value per run, with its unit in the model."""

from __future__ import annotations

from dataclasses import dataclass

from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest

INVALID = 8  # status of a run that was not computed: its values break a rule of the design


@dataclass(frozen=True)
class Quantity:
    """One variable of the dataset.

    Attributes:
        name: in the dataset.
        unit: physical unit.
        about: one line for the reader.
        integer: whether it is a whole number.
    """

    name: str
    unit: str
    about: str
    integer: bool = False


def columns_of(manifest: Manifest) -> tuple[int, ...]:
    """The columns of a chunk's table that a model's dataset has: metrics that it can have, final states."""
    metrics = (int(item) for item in Column if manifest.can_hold or not item.row.of_kinks)
    return (*metrics, *range(len(Column), len(Column) + manifest.nX))


def quantities(manifest: Manifest) -> tuple[Quantity, ...]:
    """Every variable with one value per run: the metrics, then the final states."""
    units = {item.name: item.unit for item in manifest.signals}
    metrics = (
        Quantity(item.variable, item.row.unit.format(**units), item.row.about, item.row.integer)
        for item in Column
        if manifest.can_hold or not item.row.of_kinks
    )
    states = (
        Quantity(f"final_{item.name}", item.unit, f"{item.name} at the end") for item in manifest.states
    )
    return (*metrics, *states)


def status_meanings() -> dict[int, str]:
    """Every value of the status, in words."""
    names = {status.value: status.name.lower() for status in Status if status is not Status.RUNNING}
    return {**names, INVALID: "not_simulated"}
