"""What is done of a sweep, on disk, so that a killed one goes on where it was.

    <folder>/request.json         what the sweep is
    <folder>/chunks/<start>.npy   table of the runs from <start> on; <start>.trajectories.npy, if kept
    <folder>/sweep.zarr           the dataset, made from all chunks, which are then removed

Every file appears whole or not at all.
"""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.batch import METRICS
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.storage import ensure_folder, write_text, writing
from pmjoint_codegen.sweep.chunks import Result
from pmjoint_codegen.sweep.request import Request

REQUEST: Final = "request.json"
DATASET: Final = "sweep.zarr"
CHUNKS: Final = "chunks"
CHUNK_RUNS: Final = 2048
MOST_CHUNKS: Final = 4096
TAIL: Final = 4  # chunks at the end that are cut into `PARTS`
PARTS: Final = 8


@dataclass(frozen=True)
class Store:
    """The folder of one sweep.

    Attributes:
        folder: results.
        request: the sweep.
        size: nX.
    """

    folder: Path
    request: Request
    size: int

    @property
    def dataset(self) -> Path:
        """Where the finished dataset stands."""
        return self.folder / DATASET

    @property
    def step(self) -> int:
        """Runs in a chunk: a power of two times `CHUNK_RUNS`, so that there are not too many files."""
        step = CHUNK_RUNS
        while self.request.plan.runs > step * (MOST_CHUNKS - TAIL * PARTS):
            step *= 2
        return step

    def starts(self) -> tuple[int, ...]:
        """First run of every chunk; the last are short, so that all workers end at about the same time."""
        return (
            *range(0, self._tail, self.step),
            *range(self._tail, self.request.plan.runs, self.step // PARTS),
        )

    def length(self, start: int) -> int:
        """Number of runs in the chunk that begins there."""
        step = self.step if start < self._tail else self.step // PARTS
        return min(step, self.request.plan.runs - start)

    @property
    def _tail(self) -> int:
        """The run from which on chunks are short."""
        return max(0, self.request.plan.runs // self.step - TAIL) * self.step

    def open(self, *, restart: bool = False) -> None:
        """Make the folder this sweep's.

        Args:
            restart: forget what is there.

        Raises:
            UsageError: it holds another sweep, or cannot be written.
        """
        ensure_folder(self.folder)
        path = self.folder / REQUEST
        if path.exists() and not restart and _recorded(path) != self.request.hash:
            raise UsageError(
                "holds another sweep",
                where=str(self.folder),
                remedy="give another --out, or --restart to replace it",
            )
        if restart:
            self.clear_chunks()
            shutil.rmtree(self.dataset, ignore_errors=True)
        write_text(path, json.dumps({"hash": self.request.hash, **self.request.document}, indent=1) + "\n")
        ensure_folder(self.folder / CHUNKS)

    def missing(self) -> list[int]:
        """First runs of the chunks that are still to be made."""
        return [start for start in self.starts() if not self._sound(start)]

    def keep(self, start: int, result: Result) -> None:
        """Write a chunk; the table last, since its presence says that the chunk is whole.

        Raises:
            UsageError: the folder cannot be written.
        """
        if result.trajectories.size:
            _write(self._trajectories(start), result.trajectories)
        _write(self._table(start), result.table)

    def columns(self, first: int, count: int) -> Array:
        """Some neighbouring columns of all chunks' tables, shape (count, runs)."""
        result = np.empty((count, self.request.plan.runs))
        for start in self.starts():
            table = np.load(self._table(start))
            result[:, start : start + len(table)] = table[:, first : first + count].T
        return result

    def trajectories(self) -> Array:
        """All trajectories, shape (runs, instants, nX + 2)."""
        return np.concatenate([np.load(self._trajectories(start)) for start in self.starts()])

    def clear_chunks(self) -> None:
        """Remove the chunks."""
        shutil.rmtree(self.folder / CHUNKS, ignore_errors=True)

    def _table(self, start: int) -> Path:
        return self.folder / CHUNKS / f"{start:010d}.npy"

    def _trajectories(self, start: int) -> Path:
        return self.folder / CHUNKS / f"{start:010d}.trajectories.npy"

    def _sound(self, start: int) -> bool:
        try:
            table = np.load(self._table(start), mmap_mode="r")
        except (OSError, ValueError, EOFError):
            return False
        return bool(table.shape == (self.length(start), METRICS + self.size))


def _write(path: Path, array: Array) -> None:
    """Write an array down to the disk before it gets its name, so that a power cut leaves no hollow file."""
    with writing(path) as stream:
        np.save(stream, array)
        stream.flush()
        os.fsync(stream.fileno())


def _recorded(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8")).get("hash")
    except (OSError, ValueError, AttributeError):
        return None
