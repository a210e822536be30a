"""``trajectory.csv``: one row per output instant, 17 significant digits, so that doubles round-trip.

Instants are multiples of a step that people chose, so they are written as short as a double allows: 0.3 and
not 0.29999999999999999, which is the same number.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, Final

import numpy as np

from pmjoint_codegen.logs.trajectory import Trajectory

_BLOCK: Final = 4096  # rows formatted at a time: a long run's text is several times as large as its numbers


def write(trajectory: Trajectory, stream: BinaryIO) -> None:
    """Write the header and the rows. Units are not in this file: ``summary.json`` beside it has them."""
    for text in _blocks(trajectory):
        stream.write(text.encode())


def _blocks(trajectory: Trajectory) -> Iterator[str]:
    """The file's text, a block of rows at a time."""
    columns = trajectory.columns
    form = ",".join(["%s", *["%.17g"] * (len(columns) - 1)]) + "\n"
    yield ",".join(column.name for column in columns) + "\n"
    for start in range(0, len(trajectory.t), _BLOCK):
        table = np.column_stack([column.values[start : start + _BLOCK] for column in columns])
        yield "".join(form % (repr(row[0]).removesuffix(".0"), *row[1:]) for row in table.tolist())
