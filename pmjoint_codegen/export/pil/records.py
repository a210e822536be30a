"""The files that the program of a processor reads and writes, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.pil.chips import BLOCK, Chip
from pmjoint_codegen.export.pil.folder import Columns
from pmjoint_codegen.export.tree import Precision

Array = npt.NDArray[np.float64]

HEADER: Final = np.dtype(
    [
        (name, "<u4")
        for name in (
            *("self_test", "init", "between", "nothing"),
            *("block", "init_ticks", "init_stack", "self_test_stack"),
        )
    ]
)
TRAILER: Final = np.dtype("<u4")


@dataclass(frozen=True)
class Layout:
    """The records of one controller.

    Attributes:
        columns: what stands in them.
        real: type of their numbers.
    """

    columns: Columns
    real: np.dtype[Any]

    @classmethod
    def of(cls, columns: Columns, precision: Precision) -> Layout:
        """The records in a precision."""
        return cls(columns, np.dtype("<f4" if precision.suffix else "<f8"))

    @property
    def record(self) -> np.dtype[Any]:
        """A record of ``output.bin``."""
        shape = (len(self.columns.values),)
        return np.dtype([("values", self.real, shape), ("flags", "<u4"), ("ticks", "<u4")])

    def given(self, samples: Array) -> bytes:
        """``input.bin`` of some samples, shape (samples, inputs)."""
        return samples.astype(self.real).tobytes()


@dataclass(frozen=True)
class Answer:
    """What a program answered.

    Attributes:
        layout: of its records.
        header: as in pil.c.
        records: shape (samples,).
        step_stack: bytes that step uses.
    """

    layout: Layout
    header: dict[str, int]
    records: npt.NDArray[Any]
    step_stack: int

    @classmethod
    def read(cls, data: bytes, layout: Layout, where: str) -> Answer:
        """Read ``output.bin``; raises `CheckFailed` if it is no whole one, or tells of a fault."""
        rows, rest = divmod(len(data) - HEADER.itemsize - TRAILER.itemsize, layout.record.itemsize)
        if rows < 1 or rest:
            raise CheckFailed("the controller's answers are cut off", where=where)
        header = header_of(data, where)
        records = np.frombuffer(data, layout.record, rows, HEADER.itemsize)
        (stack,) = np.frombuffer(data[-TRAILER.itemsize :], TRAILER)
        found = cls(layout, header, records, int(stack))
        (flagged,) = np.nonzero(records["flags"])
        if len(flagged):
            flags = int(records["flags"][flagged[0]])
            raise CheckFailed(f"step returns flags {flags} at sample {flagged[0]}", where=where)
        return found

    def column(self, name: str) -> Array:
        """One column in double, shape (samples,)."""
        place = self.layout.columns.values.index(name)
        return self.records["values"][:, place].astype(np.float64)

    def instructions(self, chip: Chip) -> Array:
        """Instructions of each step, its call included, shape (samples,)."""
        return counted(self.records["ticks"], self.header, chip)

    def init_instructions(self, chip: Chip) -> int:
        """Instructions of init."""
        return int(counted(np.array([self.header["init_ticks"]]), self.header, chip)[0])


def header_of(data: bytes, where: str) -> dict[str, int]:
    """The header of ``output.bin``; raises `CheckFailed` if self_test or init failed."""
    (row,) = np.frombuffer(data, HEADER, 1)
    header = {name: int(row[name]) for name in HEADER.names or ()}
    if header["self_test"]:
        raise CheckFailed(f"self_test: row {header['self_test']} differs from the recorded data", where=where)
    if header["init"]:
        raise CheckFailed("init refuses the model's own parameters", where=where)
    return header


def counted(ticks: npt.NDArray[Any], header: dict[str, int], chip: Chip) -> Array:
    """Instructions between two readings of the counter, from its ticks; the readings do not count."""
    return np.rint((ticks.astype(np.float64) - header["between"]) / chip.rate)


def check_counter(header: dict[str, int], chip: Chip) -> None:
    """Raise `CheckFailed` unless the counter counts a block of known length, to a tick at either end."""
    found = header["block"] - header["nothing"]
    if abs(found - BLOCK * chip.rate) > 2.0:
        told = f"{found} ticks for {BLOCK} instructions instead of {BLOCK * chip.rate:g}"
        raise CheckFailed(f"the emulator's clock does not count instructions: {told}", where=chip.name)


def other_bits(a: Answer, b: Answer) -> npt.NDArray[np.bool_]:
    """Where the values of two answers differ in any bit, shape (samples, values)."""
    whole = np.dtype(f"<i{a.layout.real.itemsize}")
    bits = (np.ascontiguousarray(item.records["values"]).view(whole) for item in (a, b))
    return np.asarray(np.not_equal(*bits), dtype=np.bool_)
