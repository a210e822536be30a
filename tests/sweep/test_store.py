"""The folder of a sweep: one sweep's and one process's at a time, whatever was killed in it."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import DERIVED_FILES, Store

from .conftest import Case, sweep

pytest.importorskip("zarr")


def test_a_folder_keeps_to_its_sweep(case: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    plan = make_plan(("x1=0,1",), (), None, 0, "sobol")
    other = Store(tmp_path, make_request(case.manifest, plan), case.manifest.nX)
    with pytest.raises(UsageError, match="holds another sweep"):
        other.open()
    other.open(restart=True)
    assert other.missing() == [0]


def test_what_stands_there_without_a_request_is_nobodys_result(case: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    for name in ("sweep.zarr", "chunks"):
        (tmp_path / name).mkdir()
        with pytest.raises(UsageError, match="holds another sweep"):
            store.open()
        (tmp_path / name).rmdir()
    store.open()


def test_a_restart_leaves_no_figure_and_no_export_of_the_sweep_before(case: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    names = [*DERIVED_FILES, "notes.txt"]
    for name in names:
        (tmp_path / name).touch()
    store.open()
    assert all((tmp_path / name).exists() for name in names)
    store.open(restart=True)
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "request.json", "chunks"}


def test_half_of_what_a_restart_removes_is_not_taken_for_whole(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = sweep(case, tmp_path)

    def killed(path: Path, ignore_errors: bool) -> None:
        if path == store.dataset:
            raise KeyboardInterrupt

    monkeypatch.setattr("pmjoint_codegen.sweep.store.shutil.rmtree", killed)
    with pytest.raises(KeyboardInterrupt):
        store.open(restart=True)
    with pytest.raises(UsageError, match="holds another sweep"):
        store.open()


def test_one_process_at_a_time_works_in_a_folder(case: Case, tmp_path: Path) -> None:
    one, other = (Store(tmp_path / "new", case.request, case.manifest.nX) for _ in range(2))
    with one.alone(), pytest.raises(UsageError, match="another sweep is running"), other.alone():
        pass
    with other.alone():
        pass


def test_chunks_that_a_kill_left_beside_the_dataset_go(case: Case, tmp_path: Path) -> None:
    store = sweep(case, tmp_path)
    (tmp_path / "chunks").mkdir()
    store.open()
    assert {path.name for path in tmp_path.iterdir()} == {"request.json", "sweep.sha256", "sweep.zarr"}


def test_a_chunk_that_cannot_be_written_says_why(case: Case, tmp_path: Path) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    result = simulate_chunk(case.library, case.request, case.request.plan.columns(0, store.length(0)))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (result.table.nbytes // 2, before[1]))
    try:
        with pytest.raises(UsageError, match=r"\(file too large\)"):
            store.keep(0, result)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list((tmp_path / "chunks").iterdir())


@pytest.mark.parametrize("runs", [1, 255, 256, 257, 8192, 8193, 10_239, 100_000, 12_345_000])
def test_chunks_follow_each_other_end_short_and_are_not_too_many(
    case: Case, tmp_path: Path, runs: int
) -> None:
    axes = (f"x1=0:1:{runs}",) if runs < 10_000 else (f"x1=0:1:{runs // 1000}", "x2=0:1:1000")
    plan = make_plan(axes, (), None, 0, "sobol")
    runs = plan.runs
    store = Store(tmp_path, make_request(case.manifest, plan), case.manifest.nX)
    starts = store.starts()
    assert len(starts) <= 4096
    assert [0, *(start + store.length(start) for start in starts)] == [*starts, runs]
    lengths = [store.length(start) for start in starts]
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] <= store.step // 8
