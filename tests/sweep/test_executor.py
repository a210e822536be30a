"""A sweep from end to end: threads, a kill, a cluster that loses a worker; always the same bytes."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from pmjoint_codegen.errors import MissingToolError, SimulationError, UsageError
from pmjoint_codegen.sweep.executor import AHEAD, execute, farm_out
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import Store

from .conftest import Case, files, sweep

pytest.importorskip("xarray")
pytest.importorskip("zarr")

from pmjoint_codegen.sweep import dataset


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
    execute(store, case.inputs, threads=1, scheduler=None, tell=told.append)
    assert told[0] == 0
    assert told[-1] == case.request.plan.runs
    chunks = sorted((tmp_path / "chunks").glob("*.npy"))
    kept = chunks[0].stat().st_mtime_ns
    chunks[1].unlink()
    chunks[2].write_bytes(chunks[2].read_bytes()[:100])  # cut off
    assert store.missing() == [store.starts()[1], store.starts()[2]]
    execute(store, case.inputs, threads=1, scheduler=None, tell=told.append)
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


@dataclass
class Cluster:
    """Client, scheduler and library of a cluster that has one worker, and later ten."""

    workers: int = 1
    loop: None = None
    flying: list[SimpleNamespace] = field(default_factory=list)
    most: int = 0

    def scatter(self, inputs: object, broadcast: bool) -> object:
        if not self.workers:
            raise TimeoutError("No valid workers found")
        return inputs

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
    for start, _ in farm_out(cluster, cluster, store, case.inputs, store.missing()):
        made.append(start)
        if len(made) == 1:
            assert cluster.most == 1 + AHEAD
            cluster.workers = 10
    assert cluster.most == 10 * (1 + AHEAD)
    assert made == [*store.starts()]


def test_a_scheduler_without_workers_is_said_so(case: Case, tmp_path: Path) -> None:
    store, cluster = Store(tmp_path, case.request, case.manifest.nX), Cluster(workers=0)
    with pytest.raises(UsageError, match="no workers"):
        next(farm_out(cluster, cluster, store, case.inputs, [0]))


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (
            ModuleNotFoundError("No module named 'pmjoint_codegen'"),
            MissingToolError,
            "a worker failed .*codegen",
        ),
        (MissingToolError("a sweep needs a C compiler"), MissingToolError, "on a worker: a sweep needs a C"),
        (CancelledError("scheduler-connection-lost"), SimulationError, "the connection was lost"),
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
        next(farm_out(cluster, cluster, store, case.inputs, [0]))


@pytest.mark.parametrize("address", ["", "foo", "http://127.0.0.1:80"])
def test_what_is_no_address_is_refused_before_anybody_is_asked(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("distributed.Client", None)
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    with pytest.raises(UsageError, match="is not an address"):
        execute(store, case.inputs, threads=1, scheduler=address, tell=lambda done: None)


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

    execute(store, case.inputs, threads=1, scheduler=address, tell=kill_one_worker)
    assert processes[-1].wait(10) == -signal.SIGKILL
    assert processes[-2].poll() is None
    dataset.assemble(store, case.manifest)
    assert files(store.dataset) == reference


def test_a_scheduler_that_does_not_answer_is_said_so(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("pmjoint_codegen.sweep.executor.PATIENCE_S", 0.2)
    store = Store(tmp_path, case.request, case.manifest.nX)
    store.open()
    with pytest.raises(UsageError, match="does not answer"):
        execute(store, case.inputs, threads=1, scheduler=f"tcp://127.0.0.1:{port()}", tell=lambda done: None)
