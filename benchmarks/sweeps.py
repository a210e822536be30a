"""Sweeps against their peers: ratios of medians of calls that take turns, on one core unless it says so."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.by_hand import ByHand
from benchmarks.clock import interleaved
from benchmarks.cvodes import Array
from benchmarks.peers import Heyoka, Scipy, heyoka_present
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.kernels.batch import BatchLibrary, Runs
from pmjoint_codegen.kernels.tape import FILE_NAME, read_tapes
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.hold import hold_matrices
from pmjoint_codegen.sweep.drive import drive
from pmjoint_codegen.sweep.kit import library_of, make_kit
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.store import Store

ACCURACY = 1e-6  # largest error in any state at the horizon, over all runs


@dataclass(frozen=True)
class Comparison:
    """Ours may take at most `bound` times what the peer takes; times are medians a unit of work, s."""

    what: str
    ours: float
    peer: str
    theirs: float
    bound: float


@dataclass(frozen=True)
class Field:
    """The paper's model with its library, and what every contest needs."""

    folder: Path
    manifest: Manifest
    library: BatchLibrary
    loop: ClosedLoop

    @property
    def p(self) -> Array:
        """The model's own parameters."""
        return np.array([item.value for item in self.manifest.parameters])


def field(root: Path) -> Field:
    """Load the paper's model."""
    folder = root / "generated" / "paper"
    return Field(
        folder, Manifest.read(folder), library_of(make_kit(folder), os.environ), ClosedLoop.load("paper")
    )


def random_runs(paper: Field, count: int, tolerance: float = 1e-6) -> Runs:
    """Random initial states, plants and gains; run 0 is the paper's."""
    generator = np.random.default_rng(0)
    p = np.tile(paper.p, (count, 1))
    names = paper.manifest.parameter_names
    spreads = {"d1": (0.1, 0.3), "b0": (1.5, 2.5), "u_max": (8, 12), "c1": (10, 20), "c2": (10, 20)}
    for name, (low, high) in spreads.items():
        p[1:, names.index(name)] = generator.uniform(low, high, count - 1)
    x0 = np.zeros((count, paper.manifest.nX))
    x0[:, :2] = generator.uniform((-10, -5), (10, 5), (count, 2))  # inside every region of attraction
    x0[0, :2] = paper.manifest.simulation.x0
    return Runs(x0, p, 20.0, tolerance, 0.0, np.empty((0, 0)), np.empty(0), 1e6, 1_000_000)


def cpu_times(contestants: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the median processor time of one call, s, of contestants that take turns in one thread.

    Processor time, as other work on the machine would count as wall time; each has one call that does not
    count.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for index in range(rounds + 1):
        for name, call in contestants.items():
            begun = time.thread_time()
            call()
            if index:
                times[name].append(time.thread_time() - begun)
    return {name: statistics.median(taken) for name, taken in times.items()}


def worst(found: Array, exact: Array) -> float:
    """Largest error over all runs and states."""
    return float(np.max(np.abs(found - exact)))


def sampled(paper: Field, folder: Path, rounds: int) -> list[Comparison]:
    """The sampled controller at 1 ms against the same loop written by hand, scalar and in vectors."""
    count, samples, T = 64, 20_000, 1e-3
    runs = random_runs(paper, count, 1e-8)
    runs.p[:] = np.where(
        np.isin(np.arange(len(paper.p)), (0, 1, 2)), runs.p, paper.p
    )  # gains shared, so one hold
    hold = hold_matrices(paper.loop.evaluator, paper.p, T)
    ours = replace(runs, sample_time=T, hold=hold[np.newaxis])
    one = replace(ours, x0=ours.x0[:1].copy(), p=ours.p[:1].copy())
    scalar, vector = ByHand(folder, 1), ByHand(folder, paper.library.width)
    exact = paper.library.simulate(replace(ours, tolerance=1e-12)).final
    arguments = (runs.x0, runs.p, hold, T, samples)
    for name, final in (
        ("ours", paper.library.simulate(ours).final),
        ("by hand", scalar.simulate(*arguments)),
        ("by hand in vectors", vector.simulate(*arguments)),
    ):
        print(f"sampled, {name}: largest error {worst(final, exact):.1e}")
    times = cpu_times(
        {
            "ours": lambda: paper.library.simulate(ours),
            "scalar": lambda: scalar.simulate(*arguments),
            "vector": lambda: vector.simulate(*arguments),
            "one": lambda: paper.library.simulate(one),
            "single": lambda: paper.loop.simulate(controller="sampled"),
        },
        rounds,
    )
    steps = count * samples
    by_hand = times["scalar"] / steps
    return [
        Comparison("sampled, batch, a step", times["ours"] / steps, "C by hand", by_hand, 1 / 4),
        Comparison(
            "sampled, batch, a step",
            times["ours"] / steps,
            "C by hand, vectors",
            times["vector"] / steps,
            1.5,
        ),
        Comparison(
            "sampled, one run in the batch loop, a step", times["one"] / samples, "C by hand", by_hand, 1.15
        ),
        Comparison(
            "sampled, pmjoint simulate, a step", times["single"] / samples, "C by hand", by_hand, 1.15
        ),
    ]


def one_run(paper: Field, rounds: int) -> list[Comparison]:
    """The paper's own run to its horizon with located switches, no output between, at 1e-9 in all states."""
    if not heyoka_present():
        return []
    run = random_runs(paper, 1)
    tapes = read_tapes((paper.folder / FILE_NAME).read_text(encoding="utf-8"))
    exact = paper.library.simulate(replace(run, tolerance=1e-13)).final
    v0 = paper.loop.evaluator.call("signals", np.zeros((1, 1)), run.x0, run.p)[0]
    v0 = v0[:, [item.name for item in paper.manifest.signals].index("v")]

    def heyoka(tol: float) -> Array:
        return Heyoka(paper.manifest, tapes, tol, 1).simulate(run.x0, run.p, v0, run.horizon)

    peer = Heyoka(paper.manifest, tapes, loosest("heyoka, one run", heyoka, exact, 1e-9), 1)
    best = replace(run, tolerance=loosest("ours, one run", lambda tol: ours_at(paper, run, tol), exact, 1e-9))
    settings = {"output_step": run.horizon, "tolerance": best.tolerance}
    times = cpu_times(
        {
            "batch": lambda: paper.library.simulate(best),
            "peer": lambda: peer.simulate(run.x0, run.p, v0, run.horizon),
            "simulate": lambda: paper.loop.simulate(**settings),  # type: ignore[arg-type]
        },
        rounds,
    )
    return [
        Comparison("one run at 1e-9, batch loop", times["batch"], "heyoka, events", times["peer"], 1.0),
        Comparison("one run at 1e-9, from Python", times["simulate"], "heyoka, events", times["peer"], 1.0),
    ]


def loosest(name: str, at: Callable[[float], Array], exact: Array, accuracy: float = ACCURACY) -> float:
    """Return the loosest tolerance, decade by decade, at which a contestant is as accurate as asked."""
    for exponent in range(4, 14):
        found = worst(at(10.0**-exponent), exact)
        if found <= accuracy:
            print(f"continuous, {name}: largest error {found:.1e} at tolerance 1e-{exponent}")
            return 10.0**-exponent
    raise SystemExit(f"{name} does not reach {accuracy:g}")


def continuous(paper: Field, rounds: int) -> list[Comparison]:
    """The continuous controller over random initial states and parameters, all as accurate as asked."""
    count, few = 1024, 8
    runs = random_runs(paper, count)
    tapes = read_tapes((paper.folder / FILE_NAME).read_text(encoding="utf-8"))
    exact = paper.library.simulate(replace(runs, tolerance=1e-13)).final
    best = replace(runs, tolerance=loosest("ours", lambda tol: ours_at(paper, runs, tol), exact))
    contestants: dict[str, Callable[[], object]] = {"ours": lambda: paper.library.simulate(best)}
    v0 = paper.loop.evaluator.call("signals", np.zeros((count, 1)), runs.x0, runs.p)[0]
    v0 = v0[:, [item.name for item in paper.manifest.signals].index("v")]
    for width in (1, 2, 4, 8) if heyoka_present() else ():

        def heyoka(tol: float, width: int = width) -> Array:
            return Heyoka(paper.manifest, tapes, tol, width).simulate(runs.x0, runs.p, v0, runs.horizon)

        peer = Heyoka(paper.manifest, tapes, loosest(f"heyoka x {width}", heyoka, exact), width)
        contestants[f"heyoka x {width}"] = partial(peer.simulate, runs.x0, runs.p, v0, runs.horizon)
    times = cpu_times(contestants, rounds)
    ours = times.pop("ours") / count
    rows = []
    if times:
        name = min(times, key=lambda name: times[name])
        rows.append(
            Comparison("continuous sweep, a run", ours, f"{name}, events", times[name] / count, 1 / 2)
        )
    else:
        print("heyoka is not installed (pip install heyoka): its row is left out")
    for method in ("LSODA", "DOP853"):

        def scipy(tol: float, method: str = method) -> Array:
            return Scipy(paper.manifest, tapes, method, tol).simulate(
                runs.x0[:few], runs.p[:few], runs.horizon
            )

        tolerance = loosest(f"SciPy {method}", scipy, exact[:few])
        taken = cpu_times({"scipy": partial(scipy, tolerance)}, 3)["scipy"] / few
        rows.append(Comparison("continuous sweep, a run", ours, f"SciPy {method}", taken, 1e-3))
    return rows


def ours_at(paper: Field, runs: Runs, tolerance: float) -> Array:
    """Return X at the horizon."""
    return paper.library.simulate(replace(runs, tolerance=tolerance)).final


def threads(paper: Field, folder: Path, rounds: int) -> list[Comparison]:
    """Two threads against one, and the same of C by hand: what the machine has to give."""
    runs = random_runs(paper, 8192)
    halves = [
        replace(runs, x0=runs.x0[part].copy(), p=runs.p[part].copy())
        for part in (slice(0, 4096), slice(4096, 8192))
    ]
    with ThreadPoolExecutor(2) as pool:
        times = interleaved(
            {
                "two": lambda: list(pool.map(paper.library.simulate, halves)),
                "one": lambda: [paper.library.simulate(half) for half in halves],
            },
            rounds,
        )
        scalar = ByHand(folder, 1)
        x0, p = np.tile(runs.x0[0], (2, 1)), np.tile(paper.p, (2, 1))
        hold = hold_matrices(paper.loop.evaluator, paper.p, 1e-3)

        def by_hand(_: int) -> Array:
            return scalar.simulate(x0, p, hold, 1e-3, 100_000)

        yard = interleaved(
            {"two": lambda: list(pool.map(by_hand, (0, 1))), "one": lambda: [by_hand(0), by_hand(1)]}, 5
        )
        print(
            f"C by hand in two threads: {yard['one'] / yard['two']:.2f} times one; the machine gives no more"
        )
    return [Comparison("continuous sweep, two threads", times["two"], "one thread", times["one"], 1 / 1.9)]


def workers(paper: Field, folder: Path) -> list[Comparison]:
    """Two Dask workers against one, processes of one thread on loopback; wall time of driving alone."""
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError:
        print("Dask is not installed (pip install 'pmjoint-codegen[sweep]'): its row is left out")
        return []
    plan = make_plan(("x1=-60:60:400", "x2=-20:20:400"), (), None, 0, "sobol")
    request = make_request(paper.manifest, plan)
    kit = make_kit(paper.folder)
    times = {}
    for count in (1, 2):
        with distributed.LocalCluster(
            n_workers=count, threads_per_worker=1, dashboard_address=None
        ) as cluster:
            taken = []
            for turn in range(3):
                store = Store(folder / f"workers-{count}-{turn}", request, paper.manifest.nX)
                store.open()
                begun = time.perf_counter()
                drive(store, kit, threads=1, scheduler=cluster.scheduler_address, tell=lambda done: None)
                taken.append(time.perf_counter() - begun)
            times[count] = min(taken[1:])  # the first builds and loads
    return [Comparison("continuous sweep, two Dask workers", times[2], "one worker", times[1], 1 / 1.7)]


def memory(folder: Path) -> str:
    """Peak memory of a whole `pmjoint sweep` over a million runs, and how long it takes."""
    grid = [
        "--grid",
        "x1=-60:60:1000",
        "--grid",
        "x2=-20:20:1000",
        "--no-figures",
        "--out",
        str(folder / "million"),
    ]
    program = (
        "import resource, subprocess, sys, time; a = time.perf_counter();"
        "subprocess.run(sys.argv[1:], check=True);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, time.perf_counter() - a)"
    )
    command = [
        sys.executable,
        "-c",
        program,
        sys.executable,
        "-m",
        "pmjoint_codegen",
        "sweep",
        "paper",
        *grid,
    ]
    done = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1].split()
    return f"10^6 runs: {float(done[0]) / 2**20:.2f} GiB at most, {float(done[1]):.1f} s in all"
