"""A sweep from end to end: threads, a kill, a cluster that loses a worker; always the same bytes."""

from __future__ import annotations

import errno
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pmjoint_codegen.errors import MissingToolError, UsageError
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.drive import AHEAD, drive, farm_out
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import MADE_OF_IT, Store

from .conftest import Case

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.sweep import dataset


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def sweep(case: Case, folder: Path, *, threads: int = 1, scheduler: str | None = None) -> Store:
    store = Store(folder, case.request, case.manifest.nX)
    store.open()
    drive(store, case.kit, threads=threads, scheduler=scheduler, tell=lambda done: None)
    dataset.assemble(store, case.manifest)
    return store


@pytest.fixture(scope="module")
def reference(case: Case, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The dataset, made in one thread without interruption."""
    store = sweep(case, tmp_path_factory.mktemp("reference"))
    assert len(store.starts()) > 2
    return files(store.dataset)


def test_two_threads_write_the_same_bytes(case: Case, tmp_path: Path, reference: dict[str, bytes]) -> None:
    store = sweep(case, tmp_path, threads=2)
    assert files(store.dataset) == reference
    assert not (tmp_path / "chunks").exists()


def test_what_is_done_is_not_done_again_and_what_is_broken_is(
    case: Case, tmp_path: Path, reference: dict[str, bytes]
) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    told: list[int] = []
    drive(store, case.kit, threads=1, scheduler=None, tell=told.append)
    assert told[0] == 0
    assert told[-1] == case.request.plan.runs
    chunks = sorted((tmp_path / "chunks").iterdir())
    kept = chunks[0].stat().st_mtime_ns
    chunks[1].unlink()
    chunks[2].write_bytes(chunks[2].read_bytes()[:100])  # cut off
    assert store.missing() == [store.starts()[1], store.starts()[2]]
    drive(store, case.kit, threads=1, scheduler=None, tell=told.append)
    assert chunks[0].stat().st_mtime_ns == kept
    dataset.assemble(store, case.manifest)
    assert files(store.dataset) == reference


def test_a_sweep_killed_without_warning_goes_on_and_ends_the_same(tmp_path: Path, root: Path) -> None:
    arguments = [
        "sweep",
        "paper",
        "--grid",
        "x1=-90:90:80001",
        "--horizon",
        "5",
        "--threads",
        "1",
        "--no-figures",
        "--json",
    ]
    command = [sys.executable, "-m", "pmjoint_codegen", *arguments]
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen([*command, "--out", str(killed)], cwd=root, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while (
        len(list(killed.glob("chunks/*.npy"))) < 2 and time.monotonic() < deadline and process.poll() is None
    ):
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (killed / "sweep.zarr").exists(), "the sweep was over before it could be killed"
    done = {path.name: path.stat().st_mtime_ns for path in killed.glob("chunks/*.npy")}
    assert done
    for folder in (killed, whole):
        subprocess.run([*command, "--out", str(folder)], cwd=root, stdout=subprocess.DEVNULL, check=True)
    assert files(killed) == files(whole)


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
    names = [*MADE_OF_IT, "notes.txt"]
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
    with one.alone(), pytest.raises(UsageError, match="another sweep is at work"), other.alone():
        pass
    with other.alone():
        pass


def test_chunks_that_a_kill_left_beside_the_dataset_go(case: Case, tmp_path: Path) -> None:
    store = sweep(case, tmp_path)
    (tmp_path / "chunks").mkdir()
    store.open()
    assert {path.name for path in tmp_path.iterdir()} == {"request.json", "sweep.zarr"}


def test_chunks_go_when_the_dataset_is_on_the_disk_and_stay_when_it_cannot_be(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reference: dict[str, bytes]
) -> None:
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    drive(store, case.kit, threads=2, scheduler=None, tell=lambda done: None)

    def full(folder: Path) -> None:
        assert files(folder) == reference
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(dataset, "settle", full)
        with pytest.raises(UsageError, match=r"sweep\.zarr: cannot be written \(no space left on device\)"):
            dataset.assemble(store, case.manifest)
    assert {path.name for path in tmp_path.iterdir()} == {"request.json", "chunks"}
    assert not store.missing()


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


@dataclass
class Cluster:
    """Client, scheduler and library of a cluster that has one worker, and later ten."""

    workers: int = 1
    loop: None = None
    flying: list[SimpleNamespace] = field(default_factory=list)
    most: int = 0

    def scatter(self, kit: object, broadcast: bool) -> object:
        if not self.workers:
            raise TimeoutError("No valid workers found")
        return kit

    def nthreads(self) -> dict[int, int]:
        return dict.fromkeys(range(self.workers), 1)

    def submit(self, work: object, *arguments: object, key: str) -> SimpleNamespace:
        return SimpleNamespace(key=key, result=lambda: None)

    def as_completed(self, loop: None) -> Cluster:
        return self

    def add(self, future: SimpleNamespace) -> None:
        self.flying.append(future)
        self.most = max(self.most, len(self.flying))

    def __iter__(self) -> Iterator[SimpleNamespace]:
        while self.flying:
            yield self.flying.pop(0)


def test_workers_that_join_later_are_given_work(case: Case, tmp_path: Path) -> None:
    plan = make_plan(("x1=0:1:100000",), (), None, 0, "sobol")
    store = Store(tmp_path, make_request(case.manifest, plan), case.manifest.nX)
    cluster, made = Cluster(), []
    for start, _ in farm_out(cluster, cluster, store, case.kit, store.missing()):
        made.append(start)
        if len(made) == 1:
            assert cluster.most == 1 + AHEAD
            cluster.workers = 10
    assert cluster.most == 10 * (1 + AHEAD)
    assert made == [*store.starts()]


def test_a_scheduler_without_workers_is_said_so(case: Case, tmp_path: Path) -> None:
    store, cluster = Store(tmp_path, case.request, case.manifest.nX), Cluster(workers=0)
    with pytest.raises(UsageError, match="no workers"):
        next(farm_out(cluster, cluster, store, case.kit, [0]))


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (
            ModuleNotFoundError("No module named 'pmjoint_codegen'"),
            MissingToolError,
            "a worker failed .*codegen",
        ),
        (MissingToolError("a sweep needs a C compiler"), MissingToolError, "on a worker: a sweep needs a C"),
        (UsageError("is full", where="/cache"), UsageError, "/cache: is full"),
    ],
)
def test_what_a_worker_lacks_is_said_to_be_the_worker_s(
    case: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    kind: type[Exception],
    words: str,
) -> None:
    def fail() -> None:
        raise error

    store, cluster = Store(tmp_path, case.request, case.manifest.nX), Cluster()
    monkeypatch.setattr(
        cluster, "submit", lambda *arguments, key: SimpleNamespace(key=key, result=fail), raising=True
    )
    with pytest.raises(kind, match=words):
        next(farm_out(cluster, cluster, store, case.kit, [0]))


@pytest.mark.parametrize("address", ["", "foo", "http://127.0.0.1:80"])
def test_what_is_no_address_is_refused_before_anybody_is_asked(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("distributed.Client", None)
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    with pytest.raises(UsageError, match="is no address"):
        drive(store, case.kit, threads=1, scheduler=address, tell=lambda done: None)


def port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def dask(role: str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a process of a cluster, as ``dask scheduler`` and ``dask worker`` do."""
    program = f"import sys; from distributed.cli.dask_{role} import main; sys.exit(main())"
    command = [sys.executable, "-c", program, *arguments, "--no-dashboard"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A Dask scheduler and two workers, each a process of its own, on loopback."""
    pytest.importorskip("distributed")
    number = str(port())
    address = f"tcp://127.0.0.1:{number}"
    processes = [dask("scheduler", "--host", "127.0.0.1", "--port", number)]
    processes += [dask("worker", address, "--nthreads", "1", "--no-nanny") for _ in range(2)]
    yield address, processes
    for process in processes:
        process.kill()
        process.wait()


def wait_for_workers(address: str, count: int) -> None:
    with import_module("distributed").Client(address, timeout=30, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=60)


@pytest.mark.filterwarnings("ignore")  # of asyncio and sockets that a killed worker leaves behind
def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(
    case: Case,
    tmp_path: Path,
    reference: dict[str, bytes],
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    address, processes = cluster
    wait_for_workers(address, 2)
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()

    def kill_one_worker(done: int) -> None:
        if done and processes[-1].poll() is None:
            processes[-1].send_signal(signal.SIGKILL)

    drive(store, case.kit, threads=1, scheduler=address, tell=kill_one_worker)
    assert processes[-1].wait(10) == -signal.SIGKILL
    assert processes[-2].poll() is None
    dataset.assemble(store, case.manifest)
    assert files(store.dataset) == reference


def test_a_scheduler_that_does_not_answer_is_said_so(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("pmjoint_codegen.sweep.drive.PATIENCE_S", 0.2)
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    with pytest.raises(UsageError, match="does not answer"):
        drive(store, case.kit, threads=1, scheduler=f"tcp://127.0.0.1:{port()}", tell=lambda done: None)


def test_an_absent_extra_is_named_with_the_line_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingToolError, match=r"pip install 'pmjoint-codegen\[sweep\]'"):
        dataset.require(())


def test_the_dataset_says_what_it_is(case: Case, tmp_path: Path) -> None:
    store = sweep(case, tmp_path, threads=2)
    data = dataset.read(store.dataset)
    assert dict(data["ise"].sizes) == case.request.plan.dimensions
    assert data["ise"].attrs["units"] == "rad^2 s"
    assert data["x1"].attrs["units"] == "rad"
    assert data["b0"].dims == ("draw",)
    assert data.attrs["model_hash"] == case.manifest.model_hash
    assert data.attrs["request_hash"] == case.request.hash
    assert data.attrs["seed"] == 3
    columns = case.request.plan.columns(0, case.request.plan.runs)
    flat = data.stack(run=tuple(case.request.plan.dimensions))
    assert np.array_equal(flat["x1"].values, columns["x1"])
    assert np.array_equal(flat["b0"].values, columns["b0"])
    flags = dict(
        zip(data["status"].attrs["flag_values"], data["status"].attrs["flag_meanings"].split(), strict=True)
    )
    assert {flags[int(value)] for value in np.unique(data["status"].values)} == {
        "done",
        "diverged",
        "not_simulated",
    }


@pytest.mark.parametrize("kind", ["netcdf", "parquet"])
def test_other_formats_hold_the_same_numbers(case: Case, tmp_path: Path, kind: str) -> None:
    pytest.importorskip({"netcdf": "h5py", "parquet": "pyarrow"}[kind])
    store = sweep(case, tmp_path, threads=2)
    data = dataset.read(store.dataset)
    path = dataset.export(data, tmp_path, kind)
    if kind == "netcdf":
        import xarray as xr

        with xr.open_dataset(path, engine="h5netcdf") as again:
            assert np.array_equal(again["ise"].values, data["ise"].values, equal_nan=True)
            assert again["ise"].attrs["units"] == "rad^2 s"
    else:
        frame = import_module("pandas").read_parquet(path)
        assert len(frame) == case.request.plan.runs
        assert np.array_equal(frame["ise"].values, data["ise"].values.ravel(), equal_nan=True)
        assert frame.attrs["units"]["ise"] == "rad^2 s"
        assert frame.attrs["units"]["x1"] == "rad"


@pytest.mark.parametrize("kind", ["netcdf", "parquet"])
def test_an_export_that_finds_no_room_is_said_so_and_leaves_nothing(
    case: Case, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip({"netcdf": "h5py", "parquet": "pyarrow"}[kind])
    data = dataset.read(sweep(case, tmp_path, threads=2).dataset)
    there = set(tmp_path.iterdir())
    if kind == "netcdf":  # HDF5 itself crashes where a disk is full
        monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=data.nbytes - 1))
        words = "sweep.nc: cannot be written .no space left"
    else:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        words = r"sweep.parquet: cannot be written \(.*file too large"
    try:
        with pytest.raises(UsageError, match=words):
            dataset.export(data, tmp_path, kind)
    finally:
        if kind == "parquet":
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert set(tmp_path.iterdir()) == there


def test_trajectories_are_kept_when_asked_for(case: Case, tmp_path: Path) -> None:
    plan = make_plan(("x1=-2:2:5", "c1=-1,15"), (), None, 0, "sobol")
    request = make_request(case.manifest, plan, horizon=1.0, output_step=0.25)
    store = sweep(replace(case, request=request), tmp_path)
    data = dataset.read(store.dataset)
    assert data["trajectory_v"].attrs["units"] == "V"
    assert dict(data["trajectory_x1"].sizes) == {"x1": 5, "c1": 2, "t": 5}
    assert np.all(np.isnan(data["trajectory_x1"].sel(c1=-1.0).values))
    good = data.sel(c1=15.0)
    assert np.array_equal(good["trajectory_x1"].isel(t=0).values, data["x1"].values)
    assert np.array_equal(good["trajectory_x2"].isel(t=-1).values, good["final_x2"].values)
    miss = (
        good["trajectory_e"].isel(t=-1).values - good["final_e"].values
    )  # the polynomial's end, and a new one's start
    assert np.max(np.abs(miss)) <= 64 * request.tolerance  # the defect that a step may have
