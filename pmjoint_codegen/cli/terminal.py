"""Output of the command line: results to standard output, messages to standard error.

result    text for standard output; a reader that has closed the pipe is no error
document  exactly one JSON document for standard output, with null for what JSON cannot hold
message   one line for standard error
table     aligned columns, the same on a terminal and in a file
activity  the current stage, once it has taken a second: a live bar on a terminal, else a line
"""

from __future__ import annotations

import json
import math
import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Protocol

import click

from pmjoint_codegen.cli.streams import discard
from pmjoint_codegen.errors import ResourceError

_PATIENCE_S = 1.0  # shorter work needs no bar, and no import of the library that draws it


def result(text: str) -> None:
    """Write text and a newline to standard output; characters outside its encoding are escaped.

    Raises:
        ResourceError: it cannot be written, as on a full disk.
    """
    if sys.stdout is None:
        return
    try:
        click.echo(_sayable(text, sys.stdout.encoding))
        sys.stdout.flush()
    except BrokenPipeError:
        discard(sys.stdout)
    except OSError as error:
        discard(sys.stdout)
        raise ResourceError(
            f"cannot be written ({(error.strerror or str(error)).lower()})",
            where="standard output",
            remedy="redirect it elsewhere",
        ) from error


def _sayable(text: str, encoding: str | None) -> str:
    """Escape what an encoding cannot represent, such as bytes of a path that are not text."""
    name = encoding or "utf-8"
    return text.encode(name, "backslashreplace").decode(name)


def message(text: str) -> None:
    """Write text and a newline to standard error; a failure to write there is ignored."""
    if sys.stderr is None:
        return
    try:
        click.echo(text, err=True)
    except OSError:
        discard(sys.stderr)


def document(value: object) -> None:
    """Write one JSON document to standard output; characters outside its encoding are escaped."""
    text = as_json(value)
    encoding = (sys.stdout and sys.stdout.encoding) or "utf-8"
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        text = as_json(value, ascii_only=True)
    result(text)


def as_json(value: object, *, ascii_only: bool = False) -> str:
    """Give strict JSON: NaN and infinities, which it does not have, become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False, ensure_ascii=ascii_only)


def _plain(value: Any) -> Any:
    """Turn mappings, sequences, arrays, numpy numbers and paths into types of JSON."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, bool | int | str) or value is None:
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):  # a numpy number or array, without importing numpy here
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value)


def table(rows: Sequence[Sequence[str]], *, indent: int = 2, gap: int = 2) -> str:
    """Align rows of cells into columns; the last column is not padded."""
    columns = max((len(row) for row in rows), default=0)
    widths = [max((len(row[k]) for row in rows if k < len(row) - 1), default=0) for k in range(columns)]
    lines = (
        (" " * gap).join(cell if k == len(row) - 1 else cell.ljust(widths[k]) for k, cell in enumerate(row))
        for row in rows
    )
    return "\n".join((" " * indent + line).rstrip() for line in lines)


@contextmanager
def activity(label: str, *, total: int = 0, unit: str = "") -> Iterator[Shown]:
    """Show work that takes longer than a second: on a terminal a progress bar, elsewhere a line per stage.

    ``PMJOINT_PROGRESS=0`` shows neither.

    Args:
        label: what is being done.
        total: number of items done at the end, to show how many per second; 0 shows none.
        unit: what they are called.

    Yields:
        the object to call with the fraction completed, 0 to 1, and with stages; until then, the bar only
        shows that time passes.
    """
    if os.environ.get("PMJOINT_PROGRESS") == "0":
        yield _Silent()
        return
    if sys.stderr is None or not sys.stderr.isatty():
        lines = _Lines(label)
        try:
            yield lines
        finally:
            lines.close()
        return
    bar = _Bar(label, total, unit)
    waiting = threading.Timer(_PATIENCE_S, bar.show)
    waiting.daemon = True
    waiting.start()
    try:
        yield bar
    finally:
        waiting.cancel()
        bar.close()


class Shown(Protocol):
    """How work reports its progress."""

    def __call__(self, fraction: float) -> None:
        """Record the fraction completed, 0 to 1."""

    def stage(self, name: str, done: float) -> None:
        """Record the current stage and the fraction of it completed; 0 if unknown."""


class _Silent:
    """No output: for a script that reads every line of standard error."""

    def __call__(self, fraction: float) -> None:
        """Print nothing."""

    def stage(self, name: str, done: float) -> None:
        """Print nothing."""


class _Lines:
    """A line when a stage has lasted a second, and again at twice that time from ten seconds on."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._watcher: threading.Thread | None = None
        self._name, self._done = "", 0.0
        self._begun, self._due = 0.0, math.inf

    def __call__(self, fraction: float) -> None:
        """Print nothing: a log has no bar."""

    def stage(self, name: str, done: float) -> None:
        """Record the stage; the first one starts the thread that watches the clock."""
        with self._lock:
            if name != self._name:
                self._name, self._begun, self._due = name, time.monotonic(), _PATIENCE_S
            self._done = done
            if self._watcher is None:
                self._watcher = threading.Thread(target=self._watch, daemon=True)
                self._watcher.start()

    def _watch(self) -> None:
        while not self._closed.wait(_PATIENCE_S / 5):
            with self._lock:
                lasted = time.monotonic() - self._begun
                if lasted < self._due:
                    continue
                self._due = max(10 * _PATIENCE_S, 2 * self._due)
                line = f"pmjoint: {self._label}: {self._name} ({_spent(lasted, self._done)})"
            with suppress(OSError, ValueError):  # standard error was closed
                message(line)

    def close(self) -> None:
        """Stop; a line that is being written is finished first."""
        self._closed.set()
        if self._watcher is not None:
            self._watcher.join(_PATIENCE_S)


def _spent(seconds: float, done: float) -> str:
    """State how long a stage has lasted and, if its fraction completed is known, the time left."""
    left = f", about {seconds * (1 - done) / done:.0f} s left" if done > 0 else ""
    return f"{seconds:.0f} s{left}"


class _Bar:
    """A bar that is created when it is first shown, and records progress before that too."""

    def __init__(self, label: str, total: int = 0, unit: str = "") -> None:
        self._label, self._stage = label, ""
        self._total = total
        self._unit = unit
        self._first: tuple[float, float] | None = None  # when the first fraction came, and which
        self._lock = threading.Lock()
        self._closed = False
        self._fraction: float | None = None
        self._progress: Any = None

    def show(self) -> None:
        """Draw the bar; runs in the timer's thread."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        rate = TextColumn("{task.fields[rate]}")
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            rate,
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with self._lock:
            if self._closed:
                return
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.add_task(self._described(), total=None, rate="")
            self._progress.start()
            self._update()

    def stage(self, name: str, done: float) -> None:
        """Record the current stage and the fraction of it completed; 0 is shown as unknown."""
        with self._lock:
            self._stage, self._fraction = name, done or None
            if self._progress is not None:
                task = self._progress.task_ids[0]
                self._progress.update(task, description=self._described(), completed=done)
                self._progress.tasks[0].total = 1.0 if done else None  # `update` takes None for "as it was"

    def _described(self) -> str:
        return f"{self._label}: {self._stage}" if self._stage else self._label

    def __call__(self, fraction: float) -> None:
        """Record the fraction completed, 0 to 1."""
        with self._lock:
            self._fraction = fraction
            self._first = self._first or (time.monotonic(), fraction)
            self._update()

    def _update(self) -> None:
        if self._progress is not None and self._fraction is not None:
            task = self._progress.task_ids[0]
            self._progress.update(task, total=1.0, completed=self._fraction, rate=self._rate())

    def _rate(self) -> str:
        """Items per second since the first report; work of an earlier command does not count."""
        if not self._total or self._first is None or self._fraction is None:
            return ""
        seconds = time.monotonic() - self._first[0]
        done = (self._fraction - self._first[1]) * self._total
        return f"{done / seconds:,.0f} {self._unit}/s" if seconds > 0 else ""

    def close(self) -> None:
        """Remove the bar; one that has not appeared yet never will."""
        with self._lock:
            self._closed = True
            if self._progress is not None:
                with suppress(OSError):  # a terminal that was closed
                    self._progress.stop()
