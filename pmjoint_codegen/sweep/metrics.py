"""Every variable of a sweep's dataset with one value per run, with its unit in the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.logits import reported_states
from pmjoint_codegen.loops.metrics import Column, last_exit
from pmjoint_codegen.loops.status import Status, holds
from pmjoint_codegen.manifest import Manifest

HELD: Final = "held"  # variable of the dataset: whether the joint stays bounded
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


def values_of(manifest: Manifest, table: Array, horizon: float) -> Array:
    """The values of every variable, from a chunk's table.

    Args:
        manifest: the model.
        table: shape (runs, metrics + nX).
        horizon: of the runs, s.

    Returns:
        Shape (runs, variables), in the order of `quantities`.
    """
    shown = table.copy()
    shown[:, Column.SETTLING_S] = settled(table, horizon)
    metrics = [int(item) for item in Column if manifest.can_hold or not item.row.of_kinks]
    kept = held_rows(table)[:, np.newaxis].astype(np.float64)
    return np.concatenate([shown[:, metrics], kept, shown[:, len(Column) :]], axis=1)


def settled(metrics: Array, horizon: float) -> Array:
    """Settling times of runs, s: NaN where |e| is outside its band to the end, or there is none.

    Args:
        metrics: shape (..., columns), as the loops give them: there such a run has its horizon.
        horizon: of the runs, s.
    """
    times = metrics[..., Column.SETTLING_S]
    return np.asarray(np.where(times < last_exit(horizon), times, np.nan))


def held_rows(table: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Which runs of a table keep the joint bounded; see `holds`."""
    ends = (table[:, column] for column in (Column.FINAL_E, Column.MAX_ABS_E, Column.FINAL_SATURATED))
    return holds(table[:, Column.STATUS], *ends)


def quantities(manifest: Manifest) -> tuple[Quantity, ...]:
    """Every variable with one value per run: the metrics, whether the joint is held, the final states."""
    units = {item.name: item.unit for item in manifest.signals}
    known = {item.name: item.unit for item in manifest.states} | units
    metrics = (
        Quantity(item.variable, item.row.unit.format(**units), item.row.about, item.row.integer)
        for item in Column
        if manifest.can_hold or not item.row.of_kinks
    )
    states = (
        Quantity(f"final_{name}", known[name], f"{name} at the end") for name in reported_states(manifest)
    )
    held = Quantity(HELD, "1", "1 where the joint stays bounded, 0 where it diverges or the run failed", True)
    return (*metrics, held, *states)


def status_meanings() -> dict[int, str]:
    """Every value of the status, in words."""
    names = {status.value: status.name.lower() for status in Status if status is not Status.RUNNING}
    return {**names, INVALID: "not_simulated"}
