"""Files and folders that appear whole or not at all.

A file is written beside its place under another name and renamed onto it. A folder is staged beside its
place; the old one is renamed away and the new one onto its place. A process killed at any moment leaves the
old folder, the new one or, between the two renames, none: never a mixture. The next `replace_folder` removes
the leftovers.

If something cannot be written, every function raises `UsageError` with the path and a remedy. It is a
`ResourceError` if the machine rather than the path is at fault, as when a disk is full.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from pmjoint_codegen.errors import ResourceError, UsageError
from pmjoint_codegen.scratch import clear, owned

_EXHAUSTED = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})  # not the path's fault
_STAGED = ".pmjoint-new"  # prefix of a file's name until the file is whole
_FOLDER = "pmjoint"  # in the hidden name of a folder until it is whole, or when it is replaced


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256 of some bytes."""
    return hashlib.sha256(data).hexdigest()


def sha256_view(data: memoryview) -> str:
    """Hexadecimal SHA-256 of the contents of a view, without a copy."""
    return hashlib.sha256(data).hexdigest()


def sha256_file(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's content; raises `OSError` if it cannot be read."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def ensure_folder(path: Path) -> None:
    """Make a folder with its parents and prove that files can be made in it.

    Called before long work, so that a bad ``--out`` is reported at once.

    Raises:
        UsageError: the folder cannot be made, is a file, or is not writable.
    """
    with explained(path):
        path.mkdir(parents=True, exist_ok=True)
        probe = _staged(path)
        probe.touch(exist_ok=False)
        probe.unlink()


def make_private(path: Path) -> None:
    """Make a folder with its parents; new ones are for this user only, whatever the umask.

    Raises:
        OSError: it cannot be made, or a file is in the way.
    """
    for folder in (*reversed(path.parents), path):
        if not folder.is_dir():
            folder.mkdir(mode=0o700, exist_ok=True)


def ensure_file(path: Path) -> None:
    """Prove that a file can be written at its place, before long work; an existing file stays as it is.

    Raises:
        UsageError: its folder is missing or not writable, or the path is a folder.
    """
    with explained(path):
        target = Path(os.path.realpath(path))
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if _special(path):
            return  # opening it could block until there is a reader, or be seen by one
        probe = _staged(target.parent)
        probe.touch(exist_ok=False)
        probe.unlink()


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing; it appears atomically when the block ends without an exception.

    A device or a named pipe is written in place: renaming onto it would remove it for all its users.

    Raises:
        UsageError: the file cannot be written; an existing file is unchanged.
    """
    with explained(path):
        if _special(path):  # test the path itself: the target of /dev/stdout may have no other name
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
    """Flush a folder's files and names to the disk, so that it survives a later power cut.

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
    """Write a whole file atomically; raises `UsageError` if that is impossible."""
    with writing(path) as stream:
        stream.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a whole UTF-8 file atomically, line ends unchanged; raises `UsageError` if it cannot."""
    write_bytes(path, text.encode("utf-8"))


def replace_folder(path: Path, files: Mapping[str, bytes], *, private: bool = False) -> None:
    """Make a folder hold exactly these files (name -> content), all at once; other files in it are removed.

    Args:
        path: the folder; a symbolic link is followed unless `private`.
        files: what it holds afterwards.
        private: only this user may write the folder, whatever the umask, and a symbolic link in its place is
            removed, not followed. A folder that already holds these files stays: others may be reading it.

    Raises:
        UsageError: the folder cannot be written; an existing folder is unchanged.
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
            for leftover in path.parent.glob(f".{path.name}.{_FOLDER}-*"):  # from killed processes
                shutil.rmtree(leftover, ignore_errors=True)
            if not (private and _holds(path, files)):
                _put(path, files, 0o700 if private else 0o777)


def drop_link(path: Path) -> None:
    """Remove a symbolic link in the place of a cache folder; its target stays.

    Raises:
        UsageError: the link cannot be removed.
    """
    if path.is_symlink():
        with explained(path):
            path.unlink(missing_ok=True)


def _special(path: Path) -> bool:
    """Whether a path is something other than a regular file or a folder."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _staged(folder: Path) -> Path:
    """Name a hidden file in a folder for this process, and remove leftovers of killed ones."""
    clear(folder, _STAGED)
    return folder / f"{owned(_STAGED)}{uuid.uuid4().hex}"


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


def lock(handle: int, *, wait: bool) -> bool:
    """Lock an open folder for this process; closing it, or the end of the process, unlocks it.

    Args:
        handle: of the folder.
        wait: whether to wait for another process that has the lock.

    Returns:
        False if another process has it; True also where there are no locks, as on some network drives.
    """
    with suppress(ImportError):
        import fcntl  # absent outside POSIX

        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:
            return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let one process at a time replace folders in `folder`."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        lock(handle, wait=True)
        yield
    finally:
        os.close(handle)


def _holds(folder: Path, files: Mapping[str, bytes]) -> bool:
    """Whether a folder holds exactly these files."""
    with suppress(OSError):
        return {path.name: path.read_bytes() for path in folder.iterdir()} == files
    return False


def _put(path: Path, files: Mapping[str, bytes], mode: int) -> None:
    """Under the lock: fill a new folder and put it in its place; if that fails, the old one stays."""
    staged, old = (path.with_name(f".{path.name}.{_FOLDER}-{uuid.uuid4().hex}") for _ in range(2))
    try:
        staged.mkdir(mode)
        for name, data in files.items():
            (staged / name).write_bytes(data)
        settle(staged)  # it survives a power cut after the renames
        if path.exists():
            path.rename(old)
        staged.rename(path)
    finally:
        if old.exists() and not path.exists():
            old.rename(path)
        for folder in (staged, old):
            shutil.rmtree(folder, ignore_errors=True)
