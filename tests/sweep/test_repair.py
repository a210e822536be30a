"""Files of a sweep that are removed, replaced or cut off: said, and computed anew alone."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import Store

from .conftest import Case, files, sweep

pytest.importorskip("zarr")

from pmjoint_codegen.sweep import blocks, dataset, repair


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def _alter(path: Path) -> None:
    """Another number, in a file of the same length."""
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)


def _fifo(path: Path) -> None:
    """What blocks a reader for ever."""
    path.unlink()
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGE = [Path.unlink, _cut, _alter, _fifo, _folder]


@pytest.fixture(scope="module")
def small(case: Case) -> Case:
    """500 runs in two chunks, with trajectories."""
    plan = make_plan(("x1=-2:2:250", "c1=-1,15"), (), None, 0, "sobol")
    return replace(case, request=make_request(case.manifest, plan, horizon=0.2, output_step=0.1))


@pytest.mark.parametrize("harm", DAMAGE)
@pytest.mark.parametrize("name", ["0000000256.npy", "0000000256.trajectories.npy"])
def test_a_damaged_chunk_is_made_again_alone(
    small: Case, tmp_path: Path, whole: dict[str, bytes], harm: Callable[[Path], None], name: str
) -> None:
    store = Store(tmp_path / "harmed", small.request, small.manifest.nX)
    store.open()
    execute(store, small.inputs, threads=1, scheduler=None, tell=lambda done: None)
    assert not store.missing()
    harm(store.folder / "chunks" / name)
    assert store.missing() == [256]
    assert store.damaged(store.missing()) == [store.folder / "chunks" / name]
    if harm is _folder:
        (store.folder / "chunks" / name).rmdir()  # what no file can take the place of
    with pytest.raises(UsageError, match="removed or altered"):
        dataset.assemble(store, small.manifest)
    told: list[int] = []
    execute(store, small.inputs, threads=1, scheduler=None, tell=told.append)
    assert told == [256, 500]
    dataset.assemble(store, small.manifest)
    assert files(store.dataset) == whole


def test_a_chunk_that_was_never_finished_is_not_called_damaged(small: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, small.request, small.manifest.nX)
    store.open()
    execute(store, small.inputs, threads=1, scheduler=None, tell=lambda done: None)
    assert store.done() == 500
    (tmp_path / "chunks" / "0000000256.sha256").unlink()
    assert store.missing() == [256]
    assert store.damaged(store.missing()) == []
    assert store.done() == 256


@pytest.fixture(scope="module")
def cut(small: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its folder, the dataset in more files than one a variable."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "BLOCK", 200)
        return sweep(small, tmp_path_factory.mktemp("cut")).folder


@pytest.fixture(scope="module")
def whole(small: Case, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of its dataset."""
    return files(sweep(small, tmp_path_factory.mktemp("whole")).dataset)


@pytest.mark.parametrize("harm", DAMAGE)
@pytest.mark.parametrize(
    ("name", "starts"),
    [
        ("ise/c/0/0", (0,)),
        ("trajectory_v/c/7/0/0", (256,)),
        ("status/zarr.json", ()),
        ("zarr.json", ()),
        ("x1/c/0", ()),
    ],
)
def test_a_damaged_file_of_the_dataset_is_written_again_alone(
    small: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cut: Path,
    harm: Callable[[Path], None],
    name: str,
    starts: tuple[int, ...],
) -> None:
    monkeypatch.setattr(blocks, "BLOCK", 200)  # numbers a file: 100 points of x1, or 33 with trajectories
    store = Store(tmp_path / "harmed", small.request, small.manifest.nX)
    shutil.copytree(cut, store.folder)
    whole, sums = files(store.dataset), store.sums.read_bytes()
    times = {path: path.stat().st_mtime_ns for path in store.dataset.rglob("*") if path.is_file()}
    assert repair.find_damage(store, small.manifest) == repair.Damage((), ())
    harm(store.dataset / name)
    damage = repair.find_damage(store, small.manifest)
    assert damage == repair.Damage((name,), starts)
    execute(store, small.inputs, threads=1, scheduler=None, tell=lambda done: None, starts=damage.starts)
    repair.mend(store, small.manifest, damage)
    assert files(store.dataset) == whole
    assert store.sums.read_bytes() == sums
    changed = {path for path, before in times.items() if path.stat().st_mtime_ns != before}
    assert changed == {store.dataset / name}
    assert {path.name for path in store.folder.iterdir()} == {"request.json", "sweep.sha256", "sweep.zarr"}


def test_a_variable_that_is_gone_comes_back_and_what_was_put_beside_it_goes(
    small: Case, tmp_path: Path
) -> None:
    store = sweep(small, tmp_path)
    whole = files(store.dataset)
    shutil.rmtree(store.dataset / "ise")
    planted = store.dataset / "status" / "c" / "7" / "0"
    planted.parent.mkdir()
    planted.write_bytes(b"")
    damage = repair.find_damage(store, small.manifest)
    assert damage == repair.Damage(("ise/c/0/0", "ise/zarr.json", "status/c/7/0"), (0, 256))
    execute(store, small.inputs, threads=1, scheduler=None, tell=lambda done: None, starts=damage.starts)
    repair.mend(store, small.manifest, damage)
    assert files(store.dataset) == whole


def test_without_hashes_nothing_is_taken_for_sound(small: Case, tmp_path: Path) -> None:
    store = sweep(small, tmp_path)
    for text in (None, b"", b"nothing of the kind\n", b"\xff"):
        store.sums.unlink(missing_ok=True)
        if text is not None:
            store.sums.write_bytes(text)
        with pytest.raises(UsageError, match=r"sweep\.sha256: .*--restart"):
            repair.find_damage(store, small.manifest)


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="a tool of the GNU system")
def test_the_hashes_can_be_checked_without_this_package(small: Case, tmp_path: Path) -> None:
    store = sweep(small, tmp_path)
    command = ["sha256sum", "--check", "--strict", "--quiet", store.sums.name]
    subprocess.run(command, cwd=tmp_path, check=True)
    _alter(store.dataset / "zarr.json")
    assert subprocess.run(command, cwd=tmp_path, capture_output=True).returncode == 1
