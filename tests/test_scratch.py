"""Files and folders of processes that are gone are removed, those of all others are not."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pmjoint_codegen import scratch
from pmjoint_codegen.scratch import clear, owned
from pmjoint_codegen.storage import ensure_file, ensure_folder, write_text

OLD = time.time() - 2 * scratch.ABANDONED_S
KILLED = "import os; from pmjoint_codegen.{module} import {name}; {code}; os.kill(os.getpid(), 9)"


def killed_in(code: str, cwd: Path, module: str, name: str) -> None:
    """Run some code in a process that is killed at its end."""
    line = KILLED.format(code=code, module=module, name=name)
    assert subprocess.run([sys.executable, "-c", line], cwd=cwd, check=False).returncode == -9


def test_a_folder_is_private_and_gone_after_the_block(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), scratch.scratch("kind", tmp_path) as folder:
        assert folder.parent == tmp_path and folder.stat().st_mode & 0o777 == 0o700
        (folder / "file").touch()
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_killed_process_leaves_a_folder_until_the_next_one(tmp_path: Path) -> None:
    code = "w = scratch('kind', __import__('pathlib').Path()); (w.__enter__() / 'file').touch()"
    killed_in(code, tmp_path, "scratch", "scratch")
    (left,) = tmp_path.iterdir()
    assert (left / "file").is_file()
    with scratch.scratch("other", tmp_path):
        assert left.exists()
    with scratch.scratch("kind", tmp_path) as folder:
        assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("use", [ensure_folder, lambda path: write_text(path / "file", "")])
def test_a_killed_process_leaves_half_a_file_until_the_next_one(use: object, tmp_path: Path) -> None:
    code = "from pathlib import Path; w = writing(Path('file')); w.__enter__().write(b'half')"
    killed_in(code, tmp_path, "storage", "writing")
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".")
    assert callable(use)
    use(tmp_path)
    assert not left.exists()


def test_what_somebody_works_on_stays(tmp_path: Path) -> None:
    alive = tmp_path / f"{owned('kind')}abc"
    elsewhere = tmp_path / "kind-00000000-1-abc"
    unknown, foreign = tmp_path / "kind-abc", tmp_path / "something"
    for path in (alive, elsewhere, unknown, foreign):
        path.touch()
    os.utime(alive, (OLD, OLD))
    os.utime(foreign, (OLD, OLD))
    clear(tmp_path, "kind")
    assert {*tmp_path.iterdir()} == {alive, elsewhere, unknown, foreign}
    os.utime(elsewhere, (OLD, OLD))
    os.utime(unknown, (OLD, OLD))
    clear(tmp_path, "kind")
    assert {*tmp_path.iterdir()} == {alive, foreign}


def test_a_link_is_removed_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "target").mkdir()
    (tmp_path / "target" / "file").touch()
    link = tmp_path / "kind-abc"
    link.symlink_to("target")
    os.utime(link, (OLD, OLD), follow_symlinks=False)
    clear(tmp_path, "kind")
    assert not link.is_symlink() and (tmp_path / "target" / "file").exists()


def test_a_folder_that_cannot_be_listed_is_left(tmp_path: Path) -> None:
    clear(tmp_path / "nowhere", "kind")
    with pytest.raises(Exception, match="cannot be written"):
        ensure_file(tmp_path / "nowhere" / "file")
