"""``trajectory.csv``: one row an output instant, 17 significant digits, so that every double survives."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pmjoint_codegen import storage
from pmjoint_codegen.manifest import Manifest

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record


def csv_columns(manifest: Manifest) -> tuple[str, ...]:
    """Names and order of the columns: t, y, y_r, e, states, errors, virtual controls, v, u, physics."""
    signals = [item.name for item in manifest.signals]
    first = signals.index("e") + 1
    errors = signals[first : signals.index("v")]
    physics = signals[signals.index(f"D{manifest.n}") + 1 :]
    return ("t", "y", "y_r", "e", *(item.name for item in manifest.states), *errors, "v", "u", *physics)


def csv_text(run: Record) -> str:
    """The file's text."""
    columns = csv_columns(run.manifest)
    form = ",".join(["%.17g"] * len(columns))
    table = np.column_stack([run[name] for name in columns])
    return "\n".join([",".join(columns), *(form % tuple(row) for row in table.tolist()), ""])


def write_csv(run: Record, path: Path) -> None:
    """Write a run's trajectory, atomically.

    Raises:
        UsageError: the file cannot be written.
    """
    storage.write_text(path, csv_text(run))
