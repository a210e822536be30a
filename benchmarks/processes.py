"""Whole processes: the start of one, regeneration, sweeps to disk, workers of a cluster."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from benchmarks.clock import interleaved
from benchmarks.cluster import Cluster, cluster
from benchmarks.reference import ROOT
from benchmarks.report import Row, Section

GIB: Final = 2.0**30
PATIENCE_S: Final = 120  # with one process
SAMPLED: Final = ("--controller", "sampled")
SIDE: Final = 280  # of the grid: long enough that the start of a process does not matter


def process(*arguments: str, cwd: Path = ROOT) -> Callable[[], object]:
    """Return a call that runs this interpreter once, silently, and fails if it does."""
    command = [sys.executable, *arguments]
    return lambda: subprocess.run(
        command,
        cwd=cwd,
        check=True,
        timeout=PATIENCE_S,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def run(quick: bool, folder: Path) -> Section:
    """Measure whole processes; results go into `folder`."""
    section = Section("Processes", "Start, run and end of whole processes, the caches of builds being warm.")
    numpy = 'python -c "import numpy"'
    calls = {"peer": process("-c", "import numpy"), "ours": _command("simulate", folder)}
    if find_spec("zarr") is not None:
        two = ("--grid", "x1=0,1", "--horizon", "0.1", "--restart")
        calls["sweep"] = _command("sweep", folder, *two)
    times = interleaved(calls, 3 if quick else 11)
    what = "pmjoint simulate paper --no-figures"
    section.add(Row(what, times["ours"], numpy, times["peer"], 4.0))
    if "sweep" in times:
        section.add(
            Row("pmjoint sweep paper --no-figures, two short runs", times["sweep"], numpy, times["peer"])
        )
    shutil.copytree(ROOT / "models", folder / "models")
    call = process("-m", "pmjoint_codegen", "regenerate", "paper", cwd=folder)
    taken = interleaved({"ours": call}, 1 if quick else 3)["ours"]
    section.add(Row("pmjoint regenerate paper", taken, "a clock", 5.0, 1.0))
    return section


def _command(name: str, folder: Path, *more: str) -> Callable[[], object]:
    """Return a call that runs a command of ours on the paper's model, without figures."""
    return process("-m", "pmjoint_codegen", name, "paper", *more, "--no-figures", "--out", str(folder / name))


def sweeps(quick: bool, folder: Path) -> Section:
    """Measure sweeps from end to end: memory with the number of runs, threads, workers."""
    section = Section(
        "Sweeps from end to end",
        "`pmjoint sweep paper` over a grid of x1 and x2, dataset written, no figures, process start included."
        " Memory: largest resident set of the process, continuous controller. Threads and workers: sampled"
        " controller, 20000 samples a run; a worker has one thread, on loopback, and a cluster stands still"
        " while others are timed. The yardstick is two `pmjoint sweep` of one thread and half the grid each,"
        " started together: what this machine gave two at once in the same rounds.",
    )
    if missing := [name for name in ("xarray", "zarr") if find_spec(name) is None]:
        section.absent.append(f"sweeps: no {', '.join(missing)}")
        return section
    sizes = ((20, 20), (40, 40)) if quick else ((100, 100), (1000, 1000), (4000, 2500))
    for x1, x2 in sizes:
        peak = _memory(folder / f"memory-{x1}", x1, x2)
        section.lines.append(
            (f"{x1 * x2} runs, memory", f"{peak / 2**20:.0f} MiB", "1 GiB", "1024 MiB",
             f"{peak / GIB:.3g}", "<= 1 " + ("holds" if peak <= GIB else "MISSED"))
        )  # fmt: skip
    side, rounds = (20, 1) if quick else (SIDE, 3)
    times = _at_once(folder, side, rounds, section.absent)
    runs = f"{side**2} runs,"
    section.add(Row(f"{runs} two threads", times["2"], "one thread", times["1"], 1 / 1.7))
    section.add(Row(f"{runs} two commands apart", times["apart"], "one thread", times["1"]))
    section.add(Row(f"{runs} two threads", times["2"], "two commands apart", times["apart"]))
    if "workers 2" in times:
        one, two = times["workers 1"], times["workers 2"]
        section.add(Row(f"{runs} two Dask workers", two, "one Dask worker", one, 1 / 1.7))
        section.add(Row(f"{runs} one Dask worker", one, "one thread", times["1"]))
    return section


def _at_once(folder: Path, side: int, rounds: int, absent: list[str]) -> dict[str, float]:
    """Return the time of a sweep in one thread and two, in two commands, and with workers, s."""

    def calls(side: int, clusters: Mapping[str, Cluster]) -> dict[str, Callable[[], object]]:
        threads = {
            str(n): _sweep(folder / f"threads-{n}", side, *SAMPLED, "--threads", str(n)) for n in (1, 2)
        }
        workers = {
            name: made.awake(_sweep(folder / name, side, *SAMPLED, "--scheduler", made.address))
            for name, made in clusters.items()
        }
        return threads | {"apart": lambda: _apart(folder, side)} | workers

    with ExitStack() as stack:
        clusters: dict[str, Cluster] = {}
        if find_spec("distributed") is None:
            absent.append("workers: no distributed")
        else:
            for n in (1, 2):
                clusters[f"workers {n}"] = stack.enter_context(cluster(folder / "cluster", n))
        for call in calls(20, clusters).values():  # builds, and the workers' imports
            call()
        return interleaved(calls(side, clusters), rounds, warm=True)


def _apart(folder: Path, side: int) -> None:
    """Run two commands at once, each with half the grid and one thread."""
    started = []
    for name, span in (("low", "-60:0"), ("high", "0:60")):
        grid = ("--grid", f"x1={span}:{side // 2}", "--grid", f"x2=-30:30:{side}")
        common = ("--no-figures", "--restart", "--threads", "1", "--out", str(folder / f"apart-{name}"))
        command = [sys.executable, "-m", "pmjoint_codegen", "sweep", "paper", *grid, *common, *SAMPLED]
        started.append(
            subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )
    if any([child.wait(PATIENCE_S) for child in started]):
        raise SystemExit("benchmarks: a sweep of half the grid has failed")


def _sweep(folder: Path, side: int, *options: str) -> Callable[[], object]:
    grid = ("--grid", f"x1=-60:60:{side}", "--grid", f"x2=-30:30:{side}")
    common = ("--no-figures", "--restart", "--out", str(folder))
    return process("-m", "pmjoint_codegen", "sweep", "paper", *grid, *common, *options)


def _memory(folder: Path, x1: int, x2: int) -> float:
    """Return the largest resident set of a sweep's process, bytes."""
    watch = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, "
        "stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    grid = ("--grid", f"x1=-60:60:{x1}", "--grid", f"x2=-30:30:{x2}")
    sweep = (
        "-m",
        "pmjoint_codegen",
        "sweep",
        "paper",
        *grid,
        "--no-figures",
        "--restart",
        "--out",
        str(folder),
    )
    command = [sys.executable, "-c", watch, sys.executable, *sweep]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    scale = 1 if sys.platform == "darwin" else 1024
    return float(done.stdout) * scale
