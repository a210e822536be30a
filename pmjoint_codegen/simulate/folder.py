"""The folder of a run: its own record, from which it can be read, redrawn, compared and repeated.

``trajectory.csv`` and ``summary.json`` are for everyone. ``run.json`` says what made them: the command, all
settings, versions, hashes of the files beside it. ``transient.csv`` has the saturated transient on a fine
grid, ``against.csv`` a recorded run that was compared, ``frozen.csv`` the error that an adaptive controller
makes without adaptation. Only ``summary.json`` differs between two equal runs: it has their duration.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.logs.formats import FORMATS
from pmjoint_codegen.simulate.against import Log
from pmjoint_codegen.simulate.estimates import FrozenError
from pmjoint_codegen.simulate.recorded import SCHEMA, contents_of, run_from, tables, versions_of
from pmjoint_codegen.simulate.style import KINDS
from pmjoint_codegen.simulate.trajectory import csv_columns
from pmjoint_codegen.storage import explained, sha256, sha256_file, write_text, writing

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record
    from pmjoint_codegen.simulate.run import Run

RECORD: Final = "run.json"
SUMMARY: Final = "summary.json"
TRAJECTORY: Final = "trajectory.csv"
TRANSIENT: Final = "transient.csv"
AGAINST: Final = "against.csv"
FROZEN: Final = "frozen.csv"
DRAWN: Final = ("figure[0-9]*_*", "overview", "signals_*", "comparison")  # figures of `simulate` and `plot`


@dataclass(frozen=True)
class Origin:
    """What made a run.

    Attributes:
        command: the command line, quoted for a shell; empty for a run from Python.
        model: name or path of the model, as it was given.
        notes: changes that the run itself cannot recognise as such, for captions.
    """

    command: str = ""
    model: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class RunFolder:
    """A run read from its folder.

    Attributes:
        path: of the folder, as it was given.
        run: as it was when it was written.
        detail: its saturated transient on a fine grid; None if there is none.
        log: the recorded run that it was compared with; None if there is none.
        frozen: the error of the same run without adaptation; None if there is none.
        origin: what made it.
        versions: of the packages that made it.
    """

    path: Path
    run: Run
    detail: Run | None
    log: Log | None
    frozen: FrozenError | None
    origin: Origin
    versions: Mapping[str, str]


def write_run(
    run: Run,
    folder: Path,
    origin: Origin,
    *,
    formats: Sequence[str] = (),
    detail: Record | None = None,
    log: Log | None = None,
    frozen: FrozenError | None = None,
) -> tuple[Path, ...]:
    """Write a run, each file whole or not at all, and return the files for a reader.

    Figures of an earlier run are removed, and its trajectories in formats that this one does not write: they
    would stand beside data that they do not show. The record is removed first and written last: a folder with
    a record is complete.

    Args:
        run: to write.
        folder: an existing one.
        origin: what made the run.
        formats: of the trajectory, besides ``csv``.
        detail: its saturated transient on a fine grid.
        log: a recorded run that it was compared with.
        frozen: the error of the same run without adaptation.

    Raises:
        UsageError: a file cannot be written.
    """
    chosen = [item.name for item in FORMATS if item.name == "csv" or item.name in formats]
    trajectories = tuple(folder / f"trajectory.{name}" for name in chosen)
    for path in (folder / RECORD, *(set(_leftovers(folder)) - set(trajectories))):
        with explained(path):
            path.unlink(missing_ok=True)
    for path in trajectories:
        run.save(path)
    write_text(folder / SUMMARY, _json({**run.summary}, indent=2))
    beside = [folder / TRAJECTORY]
    if detail is not None:
        beside.append(folder / TRANSIENT)
        replace(run, t=detail.t, states=detail.states, signals=detail.signals).to_csv(beside[-1])
    if log is not None:
        beside.append(folder / AGAINST)
        _write_columns({"t": log.t, **log.columns}, beside[-1])
    if frozen is not None:
        beside.append(folder / FROZEN)
        _write_columns({"t": frozen.t, "e": frozen.e}, beside[-1])
    contents = {
        "schema": SCHEMA,
        "command": origin.command,
        "model": {"given": origin.model, "name": run.manifest.name, "hash": run.manifest.model_hash},
        "versions": versions_of(run),
        "notes": list(origin.notes),
        "files": {path.name: sha256_file(path) for path in beside},
        "against": None
        if log is None
        else {"file": log.file, "sha256": log.sha256, "names": dict(log.names)},
        **contents_of(run),
    }
    write_text(folder / RECORD, _json(contents, indent=1))
    return (*trajectories, *beside[1:], folder / SUMMARY, folder / RECORD)


def recorded_model(folder: Path) -> str | None:
    """The model of the run in a folder, as it was given; None without a record that says so."""
    try:
        given = json.loads((folder / RECORD).read_text(encoding="utf-8"))["model"]["given"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return given if isinstance(given, str) and given else None


def open_run(folder: str | Path) -> Run:
    """Read a run from its folder: columns, settings, summary and figures as they were; no model is needed.

    Raises:
        UsageError: the folder holds no run, the run of another version, or changed files.
    """
    return read_folder(folder).run


def read_folder(folder: str | Path) -> RunFolder:
    """Read all of a run's folder; see `open_run`."""
    path = Path(folder)
    contents = _record(path)
    again = f"repeat the run: {contents['command']}" if contents.get("command") else "repeat the run"
    if contents.get("schema") != SCHEMA:
        raise UsageError("was written by another version", where=str(path / RECORD), remedy=again)
    try:
        files = contents["files"]
        read = {name: _columns(path / name, digest, again) for name, digest in files.items()}
        summary = json.loads((path / SUMMARY).read_text(encoding="utf-8"))
        wall = summary["wall_s"]
        run = run_from(contents, read[TRAJECTORY], math.nan if wall is None else wall)
        if tuple(read[TRAJECTORY]) != csv_columns(run.manifest):
            raise UsageError("has other columns than its record", where=str(path / TRAJECTORY), remedy=again)
        found = RunFolder(
            path,
            run,
            replace(run, **tables(run.manifest, read[TRANSIENT])) if TRANSIENT in read else None,
            _log(contents["against"], read[AGAINST]) if AGAINST in read else None,
            FrozenError(read[FROZEN]["t"], read[FROZEN]["e"]) if FROZEN in read else None,
            Origin(contents["command"], contents["model"]["given"], tuple(contents["notes"])),
            contents["versions"],
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(
            "is not a whole record of a run, or of another version", where=str(path / RECORD), remedy=again
        ) from None
    run.__dict__["summary"] = summary  # as written, with what the command added to it
    return found


def _record(folder: Path) -> dict[str, Any]:
    """The contents of ``run.json``."""
    path = folder / RECORD
    try:
        contents = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise _no_run(folder) from None
    except (OSError, ValueError):
        contents = None
    if not isinstance(contents, dict):
        raise UsageError("is not the record of a run", where=str(path), remedy="repeat the run")
    return contents


def _no_run(folder: Path) -> UsageError:
    """The error of a folder without a record."""
    if (folder / TRAJECTORY).is_file() and (folder / SUMMARY).is_file():
        return UsageError(
            f"has no {RECORD}: an earlier version wrote it, or it is incomplete",
            where=str(folder),
            remedy="repeat the run",
        )
    guess = Path("runs") / folder
    near = f"did you mean {guess}? " if (guess / RECORD).is_file() else ""
    what = "is not the folder of a run" if folder.is_dir() else "is not a folder"
    return UsageError(what, where=str(folder), remedy=f"{near}allowed: a folder that pmjoint simulate wrote")


def _leftovers(folder: Path) -> Iterator[Path]:
    """Whatever an earlier run, or a figure drawn of it, may have left."""
    yield from (folder / f"trajectory.{item.name}" for item in FORMATS)
    yield from (folder / name for name in (TRANSIENT, AGAINST, FROZEN))
    for kind in KINDS:
        for stem in DRAWN:
            yield from folder.glob(f"{stem}.{kind}")


def _columns(path: Path, digest: str, again: str) -> dict[str, Array]:
    """The columns of a file of numbers below a header, if it is the one that was written."""
    try:
        data = path.read_bytes()
    except OSError:
        raise UsageError("is missing", where=str(path), remedy=again) from None
    if sha256(data) != digest:
        raise UsageError(f"has changed since {RECORD} was written", where=str(path), remedy=again)
    header, _, body = data.decode().partition("\n")
    names = header.split(",")
    values = np.loadtxt(body.splitlines(), delimiter=",", ndmin=2) if body else np.empty((0, len(names)))
    return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(names)}


def _write_columns(columns: Mapping[str, Array], path: Path) -> None:
    """Write columns as a file of numbers below a header, as `_columns` reads it."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    with writing(path) as stream:
        stream.write((",".join(columns) + "\n").encode())
        for row in rows:
            stream.write((",".join(map(repr, row)) + "\n").encode())


def _log(contents: Mapping[str, Any], columns: Mapping[str, Array]) -> Log:
    values = {name: column for name, column in columns.items() if name != "t"}
    return Log(contents["file"], contents["sha256"], columns["t"], values, contents["names"])


def _json(value: Mapping[str, Any], indent: int) -> str:
    text = json.dumps(_strict(value), indent=indent, allow_nan=False, ensure_ascii=False) + "\n"
    return text.encode("utf-8", "backslashreplace").decode()  # JSON's own escape for a path's bytes


def _strict(value: Any) -> Any:
    """The same with null for numbers that JSON does not have: a failed run may end in them."""
    if isinstance(value, Mapping):
        return {name: _strict(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
