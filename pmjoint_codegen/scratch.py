"""Temporary files and folders that are removed however the process ends.

They are removed at the end of a block, also by Ctrl-C and SIGTERM. A killed process removes nothing. So each
name contains the machine and the process that it belongs to, and the next call removes those whose process is
gone.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

ABANDONED_S: Final = 24 * 3600.0  # no working process leaves a file unchanged for a day
_OWNER: Final = re.compile(r"-([0-9a-f]{8})-(\d{1,9})-[^-]*$")


@contextmanager
def scratch(kind: str, parent: Path | None = None) -> Iterator[Path]:
    """Make a folder for this process alone, mode 0700; it is gone after the block.

    Args:
        kind: beginning of its name; leftovers of the same kind are removed first.
        parent: where; by default the temporary folder.

    Raises:
        OSError: it cannot be made.
    """
    place = Path(tempfile.gettempdir()) if parent is None else parent
    clear(place, kind)
    with tempfile.TemporaryDirectory(prefix=owned(kind), dir=place, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


def owned(kind: str) -> str:
    """Prefix of a name that identifies its process; anything without a hyphen may follow."""
    return f"{kind}-{_machine()}-{os.getpid()}-"


def clear(place: Path, kind: str) -> None:
    """Remove files and folders of a kind whose processes are gone; what cannot be removed is left."""
    with suppress(OSError):
        for name in os.listdir(place):
            if name.startswith(kind) and _abandoned(place / name):
                _remove(place / name)


def _machine() -> str:
    """Distinguish machines that share a disk, and containers with their own process numbers."""
    try:
        space = str(os.stat("/proc/self/ns/pid").st_ino)
    except OSError:
        space = ""
    return hashlib.sha256(f"{os.uname().nodename} {space}".encode()).hexdigest()[:8]


def _abandoned(path: Path) -> bool:
    """Whether an entry is this user's and its process is gone: by its number, or on other machines by age."""
    try:
        found = path.lstat()
    except OSError:
        return False
    owner = _OWNER.search(path.name)
    if found.st_uid != os.getuid():
        return False
    if owner is not None and owner.group(1) == _machine():
        return not _lives(int(owner.group(2)))
    return found.st_mtime < time.time() - ABANDONED_S


def _lives(process: int) -> bool:
    """Whether a process with this number runs here."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        return True
    return True


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()
