"""SHA-256 of files beside them, as ``sha256sum`` writes and checks it: one line per file, hash and name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from pmjoint_codegen.storage import sha256_file

_HEXADECIMAL = frozenset("0123456789abcdef")
_LENGTH = 64  # hexadecimal digits of SHA-256


def as_text(sums: Mapping[str, str]) -> str:
    """Format the file's text for some names and their hashes, ordered by name."""
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))


def recorded(path: Path) -> dict[str, str] | None:
    """Read a file of sums: hash by name; None if there is no such file, or it names files elsewhere."""
    if not path.is_file():  # nor a FIFO, which would block
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return None
    pairs = [line.partition("  ") for line in lines]
    if not pairs or not all(
        len(digest) == _LENGTH and _HEXADECIMAL.issuperset(digest) and _lies_below(name)
        for digest, _, name in pairs
    ):
        return None
    return {name: digest for digest, _, name in pairs}


def _lies_below(name: str) -> bool:
    """Whether a name is below the folder: files elsewhere are never read."""
    path = PurePosixPath(name)
    return bool(name) and not path.is_absolute() and ".." not in path.parts


def is_sound(path: Path, digest: str | None) -> bool:
    """Whether the path is a regular file with this hash; a FIFO or a device is never opened."""
    try:
        return path.is_file() and sha256_file(path) == digest
    except OSError:
        return False


def sums_of(folder: Path) -> dict[str, str]:
    """Hash of every regular file below a folder, by its relative name.

    Raises:
        OSError: one cannot be read.
    """
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): sha256_file(path) for path in files}
