"""What every format of a trajectory writes: columns with their units, and the run that they come from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """One quantity over time.

    Attributes:
        name: as in the header of ``trajectory.csv``.
        unit: physical unit, as in the model file; ``1`` for a pure number.
        about: its meaning in one line.
        group: the part of the loop that it belongs to, such as ``plant``.
        values: shape (rows,), in `unit`.
    """

    name: str
    unit: str
    about: str
    group: str
    values: Array

    __repr__ = brief


@dataclass(frozen=True)
class Trajectory:
    """A run as formats write it.

    Attributes:
        columns: in the order of ``trajectory.csv``; the first is the time t, in s, ascending.
        model: its name.
        title: of the model, one line for people.
        model_hash: of everything in the model file.
        version: of this package.
        parameters: values by name, in the units of the model file.
        summary: ``summary.json`` without what differs from run to run, such as its duration.
    """

    columns: tuple[Column, ...]
    model: str
    title: str
    model_hash: str
    version: str
    parameters: Mapping[str, float]
    summary: Mapping[str, Any]

    __repr__ = brief

    @property
    def t(self) -> Array:
        """The instants, s, shape (rows,)."""
        return self.columns[0].values

    @property
    def groups(self) -> dict[str, tuple[Column, ...]]:
        """The columns but t by group, in the order in which the groups first occur."""
        found: dict[str, tuple[Column, ...]] = {}
        for column in self.columns[1:]:
            found[column.group] = (*found.get(column.group, ()), column)
        return found

    def metadata(self) -> dict[str, str]:
        """The run as text by key, for formats with a metadata block: parameters and summary are JSON."""
        return {
            "model": self.model,
            "title": self.title,
            "model_hash": self.model_hash,
            "pmjoint_version": self.version,
            "parameters": as_json(self.parameters),
            "summary": as_json(self.summary),
        }


def as_json(value: object) -> str:
    """JSON text in one line, in ASCII, which every reader of a metadata block takes."""
    return json.dumps(value, allow_nan=False)
