"""``trajectory.csv``: one row per output instant, 17 significant digits, so that doubles round-trip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen import storage
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.record import COMMAND

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record


_BLOCK: Final = 4096  # rows formatted at a time: a long run's text is several times as large as its numbers


def csv_columns(manifest: Manifest) -> tuple[str, ...]:
    """Names and order: t, y, y_r, e, states, errors, virtual controls, v, u, estimate, D, physics.

    After y_r comes y_cmd where the reference is data.
    """
    signals = [item.name for item in manifest.signals]
    first = signals.index("e") + 1
    errors = signals[first : signals.index("v")]
    rest = signals[signals.index("u") + 1 :]  # x_hat, D, then a joint's physical signals
    command = [COMMAND] if manifest.segment else []
    return (
        "t",
        "y",
        "y_r",
        *command,
        "e",
        *(item.name for item in manifest.states),
        *errors,
        "v",
        "u",
        *rest,
    )


def csv_blocks(run: Record) -> Iterator[str]:
    """The file's text, a block of rows at a time."""
    names = csv_columns(run.manifest)
    form = ",".join(["%.17g"] * len(names)) + "\n"
    columns = [run[name] for name in names]
    yield ",".join(names) + "\n"
    for start in range(0, len(columns[0]), _BLOCK):
        table = np.column_stack([values[start : start + _BLOCK] for values in columns])
        yield "".join(form % tuple(row) for row in table.tolist())


def write_csv(run: Record, path: Path) -> None:
    """Write a run's trajectory, atomically.

    Raises:
        UsageError: the file cannot be written.
    """
    with storage.writing(path) as stream:
        for text in csv_blocks(run):
            stream.write(text.encode())
