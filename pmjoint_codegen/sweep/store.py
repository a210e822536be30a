"""The progress of a sweep, on disk, so that a killed sweep can resume.

    <folder>/request.json         the definition of the sweep
    <folder>/chunks/<start>.npy   table of the runs from <start> on; <start>.trajectories.npy, if kept;
                                  <start>.sha256, written last, has the hashes of both
    <folder>/sweep.zarr           the dataset, made from all chunks, which are then removed
    <folder>/sweep.sha256         hashes of its files, for ``sha256sum --check`` too

Every file appears whole or not at all, and is on the disk before something else relies on it. One process at
a time works in a folder. A file counts only if its hash is the recorded one.
"""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.metrics import REPORTED, Column
from pmjoint_codegen.storage import ensure_folder, lock, sha256_view, writing
from pmjoint_codegen.sweep.chunks import Result
from pmjoint_codegen.sweep.request import Request
from pmjoint_codegen.sweep.sums import as_text, is_sound, recorded

REQUEST: Final = "request.json"
DATASET: Final = "sweep.zarr"
SUMS: Final = "sweep.sha256"
CHUNKS: Final = "chunks"
DERIVED_FILES: Final = (  # figures and exports beside the dataset, which could be taken for a new sweep's
    *("region.png", "curves.png", "histograms.png", "sweep.nc", "sweep.parquet"),
    *(f"map_{name}.png" for name, column in REPORTED.items() if column.row.mapped),
)
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

    __repr__ = brief

    @property
    def dataset(self) -> Path:
        """Path of the finished dataset."""
        return self.folder / DATASET

    @property
    def sums(self) -> Path:
        """Path of the hashes of its files."""
        return self.folder / SUMS

    @property
    def step(self) -> int:
        """Runs in a chunk: a power of two times `CHUNK_RUNS`, to limit the number of files."""
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
        """The run from which chunks are short."""
        return max(0, self.request.plan.runs // self.step - TAIL) * self.step

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Lock the folder against other processes; the lock ends with the process.

        Raises:
            UsageError: another process uses the folder, or it cannot be written.
        """
        ensure_folder(self.folder)
        handle = os.open(self.folder, os.O_RDONLY)
        try:
            if not lock(handle, wait=False):
                raise UsageError(
                    "another sweep is running there",
                    where=str(self.folder),
                    remedy="wait until it ends, or give another --out",
                )
            yield
        finally:
            os.close(handle)  # releases the lock

    def open(self, *, restart: bool = False) -> None:
        """Claim the folder for this sweep.

        Args:
            restart: discard its contents.

        Raises:
            UsageError: it holds another sweep, or cannot be written.
        """
        ensure_folder(self.folder)
        path, chunks = self.folder / REQUEST, self.folder / CHUNKS
        if restart:
            self._clear()
        elif _recorded(path) != self.request.hash and any(
            item.exists() for item in (path, chunks, self.dataset)
        ):
            raise UsageError(
                "holds another sweep",
                where=str(self.folder),
                remedy="give another --out, or --restart to replace it",
            )
        text = json.dumps({"hash": self.request.hash, **self.request.document}, indent=1) + "\n"
        _write(path, text.encode())
        if self.dataset.exists():
            self.clear_chunks()  # leftovers of a killed process
        else:
            ensure_folder(chunks)

    def _clear(self) -> None:
        """Delete the sweep in the folder, its request first: a partial sweep must never count as whole."""
        (self.folder / REQUEST).unlink(missing_ok=True)
        self.clear_chunks()
        shutil.rmtree(self.dataset, ignore_errors=True)
        self.sums.unlink(missing_ok=True)
        for name in DERIVED_FILES:
            (self.folder / name).unlink(missing_ok=True)

    def missing(self) -> list[int]:
        """First runs of the chunks that are missing or damaged; reads all of them."""
        return [start for start in self.starts() if self._faults(start)]

    def damaged(self, starts: Iterable[int]) -> list[Path]:
        """Files of these chunks that were finished and have since been removed or altered."""
        return [path for start in starts if self._record(start).exists() for path in self._faults(start)]

    def done(self) -> int:
        """Number of runs whose chunks were finished, by their records only."""
        return sum(self.length(start) for start in self.starts() if self._record(start).exists())

    def renew(self, starts: Iterable[int]) -> None:
        """Prepare for chunks that will be computed, and delete their records.

        Raises:
            UsageError: the folder cannot be written.
        """
        ensure_folder(self.folder / CHUNKS)
        for start in starts:
            self._record(start).unlink(missing_ok=True)

    def keep(self, start: int, result: Result) -> None:
        """Write a chunk; the hashes last, since they mark the chunk as whole.

        Raises:
            UsageError: the folder cannot be written.
        """
        sums = {}
        for path, array in zip(self._files(start), (result.table, result.trajectories), strict=False):
            data = _npy(array)
            sums[path.name] = sha256_view(data)
            _write(path, data)
        _write(self._record(start), as_text(sums).encode())

    def table(self, start: int, stop: int) -> Array:
        """Tables of the runs start..stop-1, shape (stop - start, metrics + nX)."""
        return self._rows(self._table, 1, len(Column) + self.size, start, stop)

    def trajectories(self, start: int, stop: int) -> Array:
        """Some rows of all trajectories, one after another: run i has rows i*instants..(i+1)*instants-1.

        Returns:
            Shape (stop - start, nX + 2): X, v, e.
        """
        return self._rows(self._trajectories, self.request.instants, self.size + 2, start, stop)

    def _rows(self, path: Callable[[int], Path], each: int, width: int, start: int, stop: int) -> Array:
        """Rows start..stop-1 of all chunks, `each` rows per run; no more of a file is read."""
        result = np.empty((stop - start, width))
        for first in self.starts():
            low, high = first * each, (first + self.length(first)) * each
            if low < stop and high > start:
                rows = np.load(path(first), mmap_mode="r").reshape(-1, width)
                some = rows[max(start - low, 0) : stop - low]
                at = max(low - start, 0)
                result[at : at + len(some)] = some
        return result

    def clear_chunks(self) -> None:
        """Remove the chunks."""
        shutil.rmtree(self.folder / CHUNKS, ignore_errors=True)

    def _table(self, start: int) -> Path:
        return self.folder / CHUNKS / f"{start:010d}.npy"

    def _trajectories(self, start: int) -> Path:
        return self.folder / CHUNKS / f"{start:010d}.trajectories.npy"

    def _record(self, start: int) -> Path:
        return self.folder / CHUNKS / f"{start:010d}.sha256"

    def _files(self, start: int) -> tuple[Path, ...]:
        """The files of a chunk."""
        table = (self._table(start),)
        return (*table, self._trajectories(start)) if self.request.output_step else table

    def _faults(self, start: int) -> tuple[Path, ...]:
        """Files of a chunk that differ from its record; all files of an unfinished chunk.

        A sound table of another width, as with other metrics, is from another version and counts as well.
        """
        sums = recorded(self._record(start)) or {}
        bad = tuple(path for path in self._files(start) if not is_sound(path, sums.get(path.name)))
        wanted = (self.length(start), len(Column) + self.size)
        if not bad and np.load(self._table(start), mmap_mode="r").shape != wanted:
            return self._files(start)
        return bad


def _npy(array: Array) -> memoryview:
    """An array as the bytes of an .npy file: NumPy's own writing to a file hides the cause of a failure."""
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getbuffer()


def _write(path: Path, data: bytes | memoryview) -> None:
    """Flush a file to the disk before it gets its name, so that a power cut leaves no empty file.

    The folder belongs to the sweep: anything there that is not a file, such as a named pipe, is replaced.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        path.unlink()
    with writing(path) as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _recorded(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8")).get("hash")
    except (OSError, ValueError, AttributeError):
        return None
