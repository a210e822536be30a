"""A recorded run beside a simulated one: columns by name, and how far the two are apart."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError, did_you_mean, quoted
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.reference.columns import factor, read_table
from pmjoint_codegen.simulate.summary import units_of

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

_HEADER: Final = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*")  # name [unit], or name (unit)


@dataclass(frozen=True)
class Log:
    """A recorded run.

    Attributes:
        file: its name.
        sha256: of the file.
        t: instants, s, ascending.
        columns: by the run's names, in the run's units, each of the shape of `t`.
        names: the file's name of each.
    """

    file: str
    sha256: str
    t: Array
    columns: Mapping[str, Array]
    names: Mapping[str, str]

    __repr__ = brief


def read_log(path: Path, run: Record, chosen: Sequence[str] = ()) -> Log:
    """Read a recorded run.

    The first column is the time. Every other one whose name is a column of the run is compared with it; a
    header such as ``y [deg]`` states a unit, else it is the run's.

    Args:
        path: of a file with a header line.
        run: to compare with.
        chosen: further columns, ``NAME=COLUMN``: the run's name, then the file's without its unit.

    Raises:
        UsageError: a file that cannot be read, a column that is not there, or nothing to compare.
    """
    table, units = read_table(path), units_of(run, ())
    headers = {_split(header)[0]: header for header in table.names}
    time = table.names[0]
    t = table.instants(time) * factor(_split(time)[1] or "s", "s", f"{path}: column {time}")
    pairs = {name: name for name in headers if name in run.columns and headers[name] != time}
    for text in chosen:
        name, sign, column = text.partition("=")
        known, what = (run.columns, "the run") if name not in run.columns else (headers, str(path))
        wrong = name if name not in run.columns else column
        if not sign or wrong not in known:
            raise UsageError(
                f"is {quoted(text)}: {what} has no column {quoted(wrong)}",
                where="--against-column",
                remedy=f"{did_you_mean(wrong, known, str)}allowed: NAME=COLUMN; columns: {', '.join(known)}",
            )
        pairs[name] = column
    if not pairs:
        raise UsageError(
            f"has no column of the run ({', '.join(headers)})",
            where=str(path),
            remedy="name one: --against-column y=COLUMN",
        )
    columns = {}
    for name, column in pairs.items():
        header = headers[column]
        scale = factor(_split(header)[1] or units[name], units[name], f"{path}: column {header}")
        columns[name] = table.numbers(header) * scale
    return Log(path.name, table.sha256, t, columns, pairs)


def _split(header: str) -> tuple[str, str]:
    """Name and unit of a column."""
    match = _HEADER.fullmatch(header)
    return (match[1], match[2]) if match else (header, "")


def differences(run: Record, log: Log) -> dict[str, Any]:
    """The distances of the run from the log, for ``summary.json``.

    At the log's instants within the run. Between output rows the run is interpolated linearly, so a finer
    output step is more exact.

    Raises:
        UsageError: no instant of the log lies within the run.
    """
    inside = (log.t >= 0.0) & (log.t <= run.t[-1] if run.t.size else False)
    if not np.any(inside):
        raise UsageError(
            f"is from t = {log.t[0]:g} to {log.t[-1]:g} s, outside the run",
            where=f"--against {log.file}",
            remedy="allowed: times of the run, from 0",
        )
    t, units = log.t[inside], units_of(run, ())
    found = {}
    for name, values in log.columns.items():
        gap = np.interp(t, run.t, run[name]) - values[inside]
        worst = int(np.argmax(np.abs(gap)))
        found[name] = {
            "column": log.names[name],
            "unit": units[name],
            "rms": float(np.sqrt(np.mean(gap**2))),
            "max": float(np.abs(gap[worst])),
            "at": float(t[worst]),
        }
    return {"file": log.file, "sha256": log.sha256, "instants": int(np.sum(inside)), "columns": found}
