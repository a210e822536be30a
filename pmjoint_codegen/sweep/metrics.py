"""What a sweep reports of each run: the columns of the batch library, with their meaning.

As ``summary.json`` has them, but that ``max_abs_e`` and ``settling_s`` are taken on the dense output instead
of the output instants.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest


class Column(IntEnum):
    """Columns of `Outcome.metrics`, as in ``pmjoint_batch.h``."""

    STATUS = 0
    T_END = 1
    STEPS = 2
    SWITCHES = 3
    ISE = 4
    MAX_ABS_E = 5
    SETTLING_S = 6
    SATURATED_S = 7
    MAX_ABS_V = 8
    FINAL_E = 9
    FINAL_SATURATED = 10


INVALID = 8  # status of a run that was not made: its values break a rule of the design


@dataclass(frozen=True)
class Quantity:
    """One variable of the dataset.

    Attributes:
        name: in the dataset.
        unit: physical unit.
        about: one line for the reader.
    """

    name: str
    unit: str
    about: str


def quantities(manifest: Manifest) -> tuple[Quantity, ...]:
    """Every variable that a run has one value of: the metrics, then the final states."""
    y = next(item.unit for item in manifest.signals if item.name == "e")
    v = next(item.unit for item in manifest.signals if item.name == "v")
    metrics = (
        Quantity("status", "1", "how the run ended"),
        Quantity("t_end", "s", "time reached"),
        Quantity("steps", "1", "integration steps"),
        Quantity("switches", "1", "times that u entered or left a limit"),
        Quantity("ise", f"{y}^2 s", "integral of e^2"),
        Quantity("max_abs_e", y, "largest |e|"),
        Quantity("settling_s", "s", "last instant at which |e| exceeds 2 % of |e(0)|"),
        Quantity("saturated_s", "s", "time that u spends at a limit"),
        Quantity("max_abs_v", v, "largest |v|"),
        Quantity("final_e", y, "e at the end"),
        Quantity("final_saturated", "1", "1 where u is at a limit at the end"),
    )
    states = (
        Quantity(f"final_{item.name}", item.unit, f"{item.name} at the end") for item in manifest.states
    )
    return (*metrics, *states)


def status_meanings() -> dict[int, str]:
    """Every value of the status, in words."""
    names = {status.value: status.name.lower() for status in Status if status is not Status.RUNNING}
    return {**names, INVALID: "not_simulated"}
