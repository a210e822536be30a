"""Handles standard streams of the process that are closed, full, or read by nobody."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # see `main`

if TYPE_CHECKING:
    from typing import TextIO


def open_missing() -> None:
    """Open the null device for closed streams: else a compiler would write its output to the next file."""
    for stream in (0, 1, 2):
        try:
            os.fstat(stream)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def settle() -> None:
    """Flush what is buffered; a failure, as on a full disk, has been reported already."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except OSError:
            discard(stream)


def discard(stream: TextIO) -> None:
    """Discard what is still buffered, so that the interpreter's last flush does not fail as well."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, stream.fileno())
    os.close(sink)


def reader_left() -> bool:
    """Whether standard output is a pipe without a reader; what is buffered for it is dropped."""
    import select

    asked = select.poll()
    try:
        asked.register(sys.stdout.fileno(), 0)
    except (AttributeError, ValueError):  # closed, or not a file
        return False
    left = any(event & select.POLLERR for _, event in asked.poll(0))
    if left:
        discard(sys.stdout)
    return left
