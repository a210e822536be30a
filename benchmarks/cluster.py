"""A Dask cluster on loopback that stands still while others are timed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from benchmarks.reference import ROOT

START_S: Final = 20  # patience with a cluster that starts
PATIENT: Final = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "None"}  # with workers that stood still


@dataclass(frozen=True)
class Cluster:
    """A scheduler and its workers.

    Attributes:
        address: of the scheduler.
        processes: all of them.
    """

    address: str
    processes: tuple[subprocess.Popen[bytes], ...]

    def signal(self, number: int) -> None:
        """Send every process a signal."""
        for process in self.processes:
            process.send_signal(number)

    def awake(self, call: Callable[[], object]) -> Callable[[], object]:
        """Return a call for which the processes run: idle, a worker takes 4 % of a core from the others."""

        def timed() -> None:
            self.signal(signal.SIGCONT)
            try:
                call()
            finally:
                self.signal(signal.SIGSTOP)

        return timed


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """Run a scheduler and workers of one thread each, halted; `folder` is theirs to write to."""
    address = f"tcp://127.0.0.1:{_free_port()}"
    folder.mkdir(exist_ok=True)
    started: list[subprocess.Popen[bytes]] = []
    try:
        host, port = address.removeprefix("tcp://").split(":")
        started.append(_start(folder, "scheduler", "--host", host, "--port", port, "--no-dashboard"))
        for _ in range(workers):
            options = ("--nthreads", "1", "--no-dashboard", "--no-nanny")
            started.append(_start(folder, "worker", address, *options))
        _wait(address, workers)
        made = Cluster(address, tuple(started))
        made.signal(signal.SIGSTOP)
        yield made
    finally:
        for child in reversed(started):  # nothing is lost with them: no need to take leave
            child.kill()
        for child in started:
            child.wait()


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    return port


def _start(folder: Path, role: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{role}", *arguments],
        cwd=folder,
        env=os.environ | PATIENT | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _wait(address: str, workers: int) -> None:
    distributed: Any = import_module("distributed")  # untyped
    begun = time.monotonic()
    while time.monotonic() - begun < START_S:
        try:
            with distributed.Client(address, timeout=START_S, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=START_S)
                return
        except OSError:
            time.sleep(0.2)
    raise SystemExit("benchmarks: the cluster does not start")
