"""How a study reports its stages to whoever started it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

Notify = Callable[[str], None]
Report = Callable[[float], None]


class Watch(Protocol):
    """Shows one stage while it lasts; yields a function that takes the fraction completed, 0 to 1."""

    def __call__(self, label: str, *, total: int = 0, unit: str = "") -> AbstractContextManager[Report]:
        """Begin a stage of `total` items, called `unit`."""


@contextmanager
def unwatched(label: str, *, total: int = 0, unit: str = "") -> Iterator[Report]:
    """Show nothing."""
    yield lambda fraction: None


def counting(progress: Report | None) -> Watch:
    """Show the progress of the stage that takes long, the one that counts items, by a function."""

    @contextmanager
    def watch(label: str, *, total: int = 0, unit: str = "") -> Iterator[Report]:
        yield progress if progress is not None and total else lambda fraction: None

    return watch


def to_stderr(line: str) -> None:
    """Print a message."""
    if sys.stderr is not None:  # `print` would take None as standard output
        print(line, file=sys.stderr)


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
