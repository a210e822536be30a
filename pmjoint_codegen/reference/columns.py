"""Columns of a text file with a header line, by name and in a wanted unit."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import MissingToolError, UsageError, did_you_mean, installing, quoted

Array = npt.NDArray[np.float64]

MOST_BYTES: Final = 2**30
_DELIMITERS: Final = (",", ";", "\t")


@dataclass(frozen=True)
class Table:
    """A file's columns as text, with the line of each row.

    Attributes:
        path: of the file, as in messages.
        names: of its columns.
        rows: cells.
        lines: the line of every row, counted from 1.
        sha256: of the file.
    """

    path: str
    names: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    lines: Sequence[int]
    sha256: str

    __repr__ = brief

    def numbers(self, name: str) -> Array:
        """One column as numbers, shape (rows,).

        Raises:
            UsageError: there is no such column, or a cell is no finite number.
        """
        if name not in self.names:
            raise UsageError(
                f"has no column {quoted(name)}",
                where=self.path,
                remedy=f"{did_you_mean(name, self.names, str)}columns: {', '.join(self.names)}",
            )
        place = self.names.index(name)
        try:
            values = np.array([float(row[place]) for row in self.rows])
        except (ValueError, IndexError):
            values = np.array([_number(row, place) for row in self.rows])
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values)))
            cells = self.rows[row]
            raise UsageError(
                f"line {self.lines[row]}, column {name}: "
                f"{quoted(cells[place]) if place < len(cells) else 'nothing'} is not a finite number",
                where=self.path,
                remedy="allowed: a number in every row",
            )
        return values

    def instants(self, name: str) -> Array:
        """The column of time, in s: as `numbers`, and ascending."""
        t = self.numbers(name)
        if np.any(np.diff(t) <= 0):
            row = int(np.argmax(np.diff(t) <= 0)) + 1
            raise UsageError(
                f"line {self.lines[row]}, column {name}: {t[row]:g} does not follow {t[row - 1]:g}",
                where=self.path,
                remedy="allowed: ascending times",
            )
        return t


def _number(row: Sequence[str], place: int) -> float:
    try:
        return float(row[place])
    except (ValueError, IndexError):
        return float("nan")


def read_table(path: Path) -> Table:
    """Read a file of numbers: a header line, then one row a line; commas, semicolons or tabs between.

    Empty lines and lines that begin with ``#`` are skipped.

    Raises:
        UsageError: the file is missing, unreadable, not UTF-8, or has no rows.
    """
    where = str(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UsageError("is too large", where=where, remedy=f"allowed: {MOST_BYTES} bytes")
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(
            f"cannot be read ({error.strerror})", where=where, remedy="give the path of a .csv file"
        ) from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise UsageError("is not UTF-8", where=where, remedy="save the file as UTF-8") from None
    numbered = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(numbered) < 2:
        raise UsageError("has no rows", where=where, remedy="a header line, then one row a line")
    header = numbered[0][1]
    delimiter = max(_DELIMITERS, key=header.count)
    cells = list(csv.reader((line for _, line in numbered), delimiter=delimiter, skipinitialspace=True))
    names = tuple(name.strip() for name in cells[0])
    lines = [number for number, _ in numbered[1:]]
    return Table(where, names, cells[1:], lines, hashlib.sha256(data).hexdigest())


_KNOWN: Final[Mapping[tuple[str, str], float]] = {
    ("deg", "rad"): float(np.pi) / 180.0,
    ("rad", "deg"): 180.0 / float(np.pi),
    ("mm", "m"): 1e-3,
    ("ms", "s"): 1e-3,
}


def factor(unit: str, wanted: str, where: str) -> float:
    """How many of the wanted unit one of a unit is; pint is loaded for pairs that are not known here.

    Args:
        unit: of the data.
        wanted: of the signal.
        where: the place in messages.

    Raises:
        UsageError: the units do not convert.
        MissingToolError: pint is needed and not installed.
    """
    if unit == wanted:
        return 1.0
    if (unit, wanted) in _KNOWN:
        return _KNOWN[unit, wanted]
    refused = UsageError(
        f"{quoted(unit)} does not convert to {quoted(wanted)}",
        where=where,
        remedy="allowed: units of one dimension, such as deg and rad",
    )
    try:
        import pint  # a quarter of a second
    except ModuleNotFoundError:
        raise MissingToolError(
            f"pint is needed to convert {quoted(unit)} to {quoted(wanted)}",
            where=where,
            remedy=f"install it: {installing('pmjoint-codegen[derive]')}",
        ) from None
    if max(len(unit), len(wanted)) > 60 or "**" in unit + wanted:
        raise refused
    registry: Any = pint.UnitRegistry()
    try:
        zero, one = (registry.Quantity(n, unit).to(wanted).magnitude for n in (0.0, 1.0))
    except Exception as error:  # pint raises what its parser and arithmetic happen to raise
        raise refused from error
    if zero != 0.0 or not (one > 0.0 and np.isfinite(one)):
        raise refused
    return float(one)
