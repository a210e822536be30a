"""The command behind a reference that is data: points in time, and what holds between them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief

Array = npt.NDArray[np.float64]
Shape = Literal["hold", "linear", "spline"]

DATA: Final = "<data>"  # in place of an expression, which it can never be
KINDS: Final[Mapping[str, Shape]] = MappingProxyType(
    {"steps": "hold", "ramps": "linear", "trapezoid": "linear", "table": "spline", "file": "spline"}
)


@dataclass(frozen=True)
class Command:
    """What y_r should be, before a filter.

    Before the first point the command has its value, after the last point that one's.

    Attributes:
        kind: key of `KINDS`.
        t: instants of the points, s, ascending.
        y: values there, in y's unit.
        filter: rate a of the filter (a/(s + a))^(rho + 1), 1/s; None for none.
        origin: where the numbers come from, such as a file's name, for summaries.
    """

    kind: str
    t: tuple[float, ...]
    y: tuple[float, ...]
    filter: float | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    __repr__ = brief

    @property
    def shape(self) -> Shape:
        """What holds between the points: a filter smooths, so a filtered table needs no spline."""
        shape = KINDS[self.kind]
        return "linear" if shape == "spline" and self.filter is not None else shape

    @cached_property
    def hash(self) -> str:
        """SHA-256 of kind, filter and numbers."""
        head = f"{self.kind} {self.filter!r} {len(self.t)}\n".encode()
        return hashlib.sha256(head + np.array([self.t, self.y], dtype="<f8").tobytes()).hexdigest()

    @property
    def text(self) -> str:
        """One line for people."""
        origin = dict(self.origin)
        name = f"{origin['file']}, {origin['column']}" if "file" in origin else self.kind
        parts = [name, f"{len(self.t)} points"]
        return ", ".join([*parts, *([] if self.filter is None else [f"filter {self.filter:g} 1/s"])])

    @property
    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` says of it."""
        ends = {"points": len(self.t), "from": self.t[0], "to": self.t[-1]}
        return {"kind": self.kind, **self.origin, "filter": self.filter, **ends, "sha256": self.hash}
