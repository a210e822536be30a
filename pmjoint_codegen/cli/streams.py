"""The standard streams of the process where they are closed, full, or read by nobody."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # see `main`

if TYPE_CHECKING:
    from typing import TextIO


def open_missing() -> None:
    """Open nothing for what the caller has closed: the next file would be standard output to a compiler."""
    for stream in (0, 1, 2):
        try:
            os.fstat(stream)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def settle() -> None:
    """Write out what is buffered; where that fails, as on a full disk, it has been said already."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except OSError:
            discard(stream)


def discard(stream: TextIO) -> None:
    """Send what is still buffered nowhere, so that the interpreter's last flush does not fail as well."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, stream.fileno())
    os.close(sink)


def reader_left() -> bool:
    """Whether standard output is a pipe that nobody reads any more; what is buffered for it is dropped."""
    import select

    asked = select.poll()
    try:
        asked.register(sys.stdout.fileno(), 0)
    except (AttributeError, ValueError):  # closed, or no file at all
        return False
    left = any(event & select.POLLERR for _, event in asked.poll(0))
    if left:
        discard(sys.stdout)
    return left
