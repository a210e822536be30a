"""Files and folders that appear whole or not at all.

A file is written beside its place under another name and renamed onto it. A folder is staged beside its place
and exchanged with it in one system call: a process killed at any moment leaves the old folder or the new,
never a mixture. Where the file system knows no exchange, two renames do it, and the next `replace_folder` or
`recover_folder` undoes what a kill between them left.

What cannot be written is the user's to mend: every function raises `UsageError` with the path and a remedy,
of the kind `ResourceError` where not the path but the machine is at fault, as when a disk is full.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import shutil
import sys
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from pmjoint_codegen.errors import ResourceError, UsageError
from pmjoint_codegen.scratch import clear, owned

_EXHAUSTED = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})  # no fault of the path's
_STAGED = ".pmjoint-new"  # beginning of the name of a file until it is whole
_AT_FDCWD = -100  # Linux <fcntl.h>: paths are relative to the current directory
_EXCHANGE = 2  # RENAME_EXCHANGE of Linux and RENAME_SWAP of macOS


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256 of some bytes."""
    return hashlib.sha256(data).hexdigest()


def sha256_view(data: memoryview) -> str:
    """Hexadecimal SHA-256 of what a view shows, without a copy."""
    return hashlib.sha256(data).hexdigest()


def sha256_file(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's content; raises `OSError` where it cannot be read."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def ensure_folder(path: Path) -> None:
    """Make a folder with its parents and prove that files can be made in it.

    Called before long work, so that a bad ``--out`` is said at once.

    Raises:
        UsageError: the folder cannot be made, is a file, or is not writable.
    """
    with explained(path):
        path.mkdir(parents=True, exist_ok=True)
        probe = _staged(path)
        probe.touch(exist_ok=False)
        probe.unlink()


def make_private(path: Path) -> None:
    """Make a folder with its parents, those that are new for this user alone, whatever the umask.

    Raises:
        OSError: it cannot be made, or a file is in the way.
    """
    for folder in (*reversed(path.parents), path):
        if not folder.is_dir():
            folder.mkdir(mode=0o700, exist_ok=True)


def ensure_file(path: Path) -> None:
    """Prove that a file can be written at its place, before long work; what stands there stays as it is.

    Raises:
        UsageError: its folder is missing or not writable, or the path is a folder.
    """
    with explained(path):
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if _special(path):
            return  # opening it could wait for a reader, or be seen by one
        probe = _staged(target.parent)
        probe.touch(exist_ok=False)
        probe.unlink()


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing that takes its place, atomically, when the block ends without an exception.

    A device or a named pipe is written in place: renaming onto it would take it from everyone who uses it.

    Raises:
        UsageError: the file cannot be written; whatever stood there before still stands.
    """
    with explained(path):
        if _special(path):  # asked of the path itself: what /dev/stdout stands for may have no other name
            with path.open("wb") as stream:
                yield stream
            return
        target = Path(os.path.realpath(path))  # a symbolic link is written through, not replaced
        staged = _staged(target.parent)
        try:
            with staged.open("xb") as stream:
                yield stream
            staged.replace(target)
        finally:
            staged.unlink(missing_ok=True)


def settle(folder: Path) -> None:
    """Write a folder's files and names down to the disk, so that a power cut later on finds it filled.

    Raises:
        OSError: a file cannot be written.
    """
    for path in (*folder.rglob("*"), folder):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file atomically; raises `UsageError` where that is impossible."""
    with writing(path) as stream:
        stream.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a whole UTF-8 file atomically, line ends as they are; raises `UsageError` where it cannot."""
    write_bytes(path, text.encode("utf-8"))


def replace_folder(path: Path, files: Mapping[str, bytes], *, private: bool = False) -> None:
    """Make a folder hold exactly these files (name -> content), all at once; other files in it are gone.

    Args:
        path: the folder; a symbolic link is followed unless `private`.
        files: what it holds afterwards.
        private: only this user may write the folder, whatever the umask, and a symbolic link in its place is
            removed, not followed.

    Raises:
        UsageError: the folder cannot be written; whatever stood there before still stands.
    """
    with explained(path):
        if private:
            make_private(path.parent)
            drop_link(path)
        path = Path(os.path.realpath(path))
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with _locked(path.parent):
            _recover(path)
            _sweep(path)
            staged = _sibling(path, "new")
            try:
                _fill(staged, files, 0o700 if private else 0o777)
                _put(staged, path)
            finally:
                shutil.rmtree(staged, ignore_errors=True)


def drop_link(path: Path) -> None:
    """Remove a symbolic link that stands where a folder of the cache belongs; what it points to stays.

    Raises:
        UsageError: the link cannot be removed.
    """
    if path.is_symlink():
        with explained(path):
            path.unlink(missing_ok=True)


def recover_folder(path: Path) -> None:
    """Bring back a folder whose replacement was killed between two renames; does nothing otherwise.

    Raises:
        UsageError: the old folder stands aside but cannot be moved back.
    """
    if not path.exists() and _aside(path).exists():
        with explained(path), _locked(path.parent):
            _recover(path)


def _special(path: Path) -> bool:
    """Whether something other than a regular file or a folder stands at a path."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _sibling(path: Path, kind: str) -> Path:
    """Name a hidden neighbour that no other process uses."""
    return path.with_name(f".{path.name}.{kind}-{uuid.uuid4().hex}")


def _staged(folder: Path) -> Path:
    """Name a hidden file in a folder for this process, and remove what killed ones left there."""
    clear(folder, _STAGED)
    return folder / f"{owned(_STAGED)}{uuid.uuid4().hex}"


def _aside(path: Path) -> Path:
    """Name the one place where the old folder waits during a replacement by two renames."""
    return path.with_name(f".{path.name}.old")


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn a failed system call into the one line that a user needs."""
    try:
        yield
    except OSError as error:
        words = error.strerror or " ".join(str(error).split())
        reason = "a file is in the way" if isinstance(error, FileExistsError) else words.lower()
        if error.errno in _EXHAUSTED:
            raise ResourceError(
                f"cannot be written ({reason})", where=str(path), remedy="make room, or choose another disk"
            ) from error
        raise UsageError(
            f"cannot be written ({reason})", where=str(path), remedy="choose a folder that you can write to"
        ) from error


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let one process at a time replace folders in `folder`; without locks, as on some networks, go on."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(ImportError, OSError):
            import fcntl  # absent outside POSIX

            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)  # releases the lock


def _recover(path: Path) -> None:
    """Under the lock: undo half a replacement, or drop what a whole one left behind."""
    aside = _aside(path)
    if path.exists():
        shutil.rmtree(aside, ignore_errors=True)
    elif aside.exists():
        aside.rename(path)


def _sweep(path: Path) -> None:
    """Under the lock: remove what killed replacements staged and never used."""
    for leftover in path.parent.glob(f".{path.name}.new-*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _fill(folder: Path, files: Mapping[str, bytes], mode: int) -> None:
    """Write a new folder down to the disk, so that a power cut after the exchange finds it filled."""
    folder.mkdir(mode)
    for name, data in files.items():
        with (folder / name).open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())


def _put(staged: Path, path: Path) -> None:
    """Move a filled folder to its place; what stood there ends up in `staged` or nowhere."""
    if not path.exists():
        staged.rename(path)
    elif not _exchange(staged, path):
        aside = _aside(path)
        path.rename(aside)
        staged.rename(path)
        shutil.rmtree(aside, ignore_errors=True)


def _exchange(one: Path, other: Path) -> bool:
    """Swap two folders in one system call; False where the system or the file system cannot."""
    paths = os.fsencode(one), os.fsencode(other)
    libc = ctypes.CDLL(None)
    try:
        if sys.platform == "darwin":
            return bool(libc.renamex_np(*paths, _EXCHANGE) == 0)
        return bool(libc.renameat2(_AT_FDCWD, paths[0], _AT_FDCWD, paths[1], _EXCHANGE) == 0)
    except AttributeError:  # a C library without that call
        return False
