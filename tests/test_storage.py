"""Files and folders appear whole or not at all, whatever happens on the way."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pmjoint_codegen import storage
from pmjoint_codegen.errors import UsageError

OLD = {"a": b"old a", "b": b"old b"}
NEW = {"a": b"new a", "c": b"new c"}


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def test_sha256_is_that_of_the_bytes(tmp_path: Path) -> None:
    (tmp_path / "f").write_bytes(b"abc")
    assert storage.sha256(b"abc") == storage.sha256_file(tmp_path / "f") == hashlib.sha256(b"abc").hexdigest()


def test_text_is_written_as_it_is(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "f", "ξ\r\nλ\n")
    assert (tmp_path / "f").read_bytes() == "ξ\r\nλ\n".encode()
    assert names(tmp_path) == {"f"}


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "f", "old")
    with pytest.raises(RuntimeError), storage.writing(tmp_path / "f") as stream:
        stream.write(b"half of the n")
        raise RuntimeError
    assert (tmp_path / "f").read_text() == "old"
    assert names(tmp_path) == {"f"}


def test_a_symbolic_link_is_written_through(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    storage.write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_new_files_have_ordinary_permissions(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "ours", "")
    (tmp_path / "plain").touch()
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize(
    "act",
    [
        lambda path: storage.write_text(path, "x"),
        lambda path: storage.replace_folder(path, NEW),
        lambda path: storage.ensure_folder(path),
        lambda path: storage.ensure_file(path),
    ],
)
def test_what_cannot_be_written_is_said_with_path_and_remedy(act: object, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    path = tmp_path / "file" / "below"
    with pytest.raises(UsageError) as caught:
        act(path)  # type: ignore[operator]
    assert caught.value.where == str(path)
    assert "not a directory" in caught.value.what or "a file is in the way" in caught.value.what
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (errno.ENOSPC, 3),
        (errno.EDQUOT, 3),
        (errno.EFBIG, 3),
        (errno.EIO, 3),
        (errno.EACCES, 2),
        (errno.EROFS, 2),
    ],
)
def test_the_machines_limits_are_told_from_the_users_mistakes(tmp_path: Path, number: int, code: int) -> None:
    with pytest.raises(UsageError) as caught, storage.explained(tmp_path):
        raise OSError(number, os.strerror(number))
    assert caught.value.exit_code == code
    assert os.strerror(number).lower() in str(caught.value) and caught.value.remedy


def test_a_full_disk_is_the_users_to_mend(tmp_path: Path) -> None:
    if not os.path.exists("/dev/full"):
        pytest.skip("this system has no /dev/full")
    with (
        pytest.raises(UsageError, match="no space left"),
        storage.writing(tmp_path / "f"),
        open("/dev/full", "wb", buffering=0) as full,
    ):
        full.write(b"x")
    assert names(tmp_path) == set()


def test_ensure_folder_makes_parents_and_leaves_nothing_in_it(tmp_path: Path) -> None:
    storage.ensure_folder(tmp_path / "a" / "b")
    assert names(tmp_path / "a" / "b") == set()


def test_ensure_file_leaves_everything_as_it_is(tmp_path: Path) -> None:
    storage.ensure_file(tmp_path / "new")
    assert names(tmp_path) == set()
    (tmp_path / "old").write_text("precious")
    storage.ensure_file(tmp_path / "old")
    assert (tmp_path / "old").read_text() == "precious" and names(tmp_path) == {"old"}
    with pytest.raises(UsageError, match="is a directory"):
        storage.ensure_file(tmp_path)


def test_a_folder_holds_exactly_the_new_files(tmp_path: Path) -> None:
    for files in (OLD, NEW):
        storage.replace_folder(tmp_path / "deep" / "g", files)
        assert contents(tmp_path / "deep" / "g") == files
        assert names(tmp_path / "deep") == {"g"}


def test_a_file_in_the_folders_place_is_not_destroyed(tmp_path: Path) -> None:
    (tmp_path / "g").write_text("precious")
    with pytest.raises(UsageError, match="not a directory"):
        storage.replace_folder(tmp_path / "g", NEW)
    assert (tmp_path / "g").read_text() == "precious"


def test_a_file_that_cannot_be_made_leaves_the_old_folder(tmp_path: Path) -> None:
    storage.replace_folder(tmp_path / "g", OLD)
    with pytest.raises(UsageError):
        storage.replace_folder(tmp_path / "g", {**NEW, "no/such/folder": b""})
    assert contents(tmp_path / "g") == OLD
    assert names(tmp_path) == {"g"}


DIE_AT_RENAME = """
import os, sys
from pathlib import Path
from pmjoint_codegen import storage
rename, calls = Path.rename, 0
def counted(self, target):
    global calls
    calls += 1
    if calls == int(sys.argv[2]):
        os._exit(9)
    return rename(self, target)
Path.rename = counted
storage.replace_folder(Path(sys.argv[1]), {"a": b"new a", "c": b"new c"})
"""


@pytest.mark.parametrize(("death", "left"), [(1, OLD), (2, None), (3, NEW)])
def test_a_kill_before_between_and_after_the_renames_leaves_no_mixture(
    death: int, left: dict[str, bytes] | None, tmp_path: Path
) -> None:
    folder = tmp_path / "g"
    storage.replace_folder(folder, OLD)
    subprocess.run([sys.executable, "-c", DIE_AT_RENAME, str(folder), str(death)], check=False)
    assert (contents(folder) if folder.exists() else None) == left
    storage.replace_folder(folder, NEW)
    assert contents(folder) == NEW
    assert names(tmp_path) == {"g"}


@pytest.mark.parametrize("failing", [1, 2])
def test_a_rename_that_fails_leaves_the_old_folder(
    failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    storage.replace_folder(tmp_path / "g", OLD)
    rename, calls = Path.rename, iter(range(1, 10))

    def refused(path: Path, target: Path) -> Path:
        if next(calls) == failing:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(UsageError):
        storage.replace_folder(tmp_path / "g", NEW)
    assert contents(tmp_path / "g") == OLD
    assert names(tmp_path) == {"g"}


def test_a_private_folder_that_holds_the_files_is_left_to_its_readers(tmp_path: Path) -> None:
    folder = tmp_path / "key"
    storage.replace_folder(folder, OLD, private=True)
    before = folder.stat().st_ino
    storage.replace_folder(folder, OLD, private=True)
    assert folder.stat().st_ino == before
    storage.replace_folder(folder, NEW, private=True)
    assert contents(folder) == NEW


REPLACE_FOR_EVER = """
import sys
from pathlib import Path
from pmjoint_codegen.storage import replace_folder
while True:
    for text in (b"0", b"1"):
        replace_folder(Path(sys.argv[1]), {f"file{i}": text * 1000 for i in range(5)})
        print(flush=True)
"""


def test_a_kill_at_any_moment_leaves_no_mixture(tmp_path: Path) -> None:
    folder = tmp_path / "g"
    for delay_ms in range(12):
        with subprocess.Popen(
            [sys.executable, "-c", REPLACE_FOR_EVER, str(folder)], stdout=subprocess.PIPE
        ) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()  # the first folder stands
            time.sleep(delay_ms * 1e-3 * 0.7)
            writer.kill()
        if folder.exists():  # not so for a moment between two renames
            found = contents(folder)
            assert set(found) == {f"file{i}" for i in range(5)}
            assert len(set(found.values())) == 1
    storage.replace_folder(folder, NEW)
    assert names(tmp_path) == {"g"}  # what the killed ones staged is swept away


def test_replacements_at_once_end_with_one_of_them(tmp_path: Path) -> None:
    folder = tmp_path / "g"
    versions = [{"a": bytes([i]), "b": bytes([i])} for i in range(8)]
    threads = [threading.Thread(target=storage.replace_folder, args=(folder, files)) for files in versions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert contents(folder) in versions
    assert names(tmp_path) == {"g"}


def test_a_named_pipe_is_written_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        storage.ensure_file(pipe)
        storage.write_text(pipe, "text")
        assert pipe.is_fifo()
        assert os.read(reader, 10) == b"text"
    finally:
        os.close(reader)
    assert names(tmp_path) == {"pipe"}


def test_a_link_in_place_of_a_private_folder_is_not_followed(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.mkdir()
    (target / "precious").write_text("kept")
    (tmp_path / "key").symlink_to(target)
    storage.replace_folder(tmp_path / "key", NEW, private=True)
    assert contents(target) == {"precious": b"kept"}
    assert contents(tmp_path / "key") == NEW and not (tmp_path / "key").is_symlink()


def test_private_folders_are_private_under_any_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        storage.replace_folder(tmp_path / "models" / "key", NEW, private=True)
    finally:
        os.umask(before)
    found = tmp_path / "models" / "key"
    assert [folder.stat().st_mode & 0o777 for folder in (found, found.parent)] == [0o700, 0o700]
