"""The sampled controller: time of one step of one trajectory, alone and in a batch."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.clock import interleaved
from benchmarks.paper import HORIZON, X0, Array
from benchmarks.peers import by_hand
from benchmarks.peers.ours import ALL_STEPS, constants
from benchmarks.reference import ROOT
from benchmarks.report import Row, Section
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.problem import Progress, make_memory
from pmjoint_codegen.loops.select import make_loop
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.start import initial_state
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs

SAMPLE_TIME: Final = 1e-3  # s
SAMPLES: Final = round(HORIZON / SAMPLE_TIME)
AGREEMENT: Final = 1e-9  # contestants whose final states differ by more do not do the same work
RUNS: Final = 32

Contest = dict[str, tuple[Callable[[], Array], int]]  # name -> call that returns X(20 s), trajectories in it


def run(quick: bool, folder: Path) -> Section:
    """Measure; build the hand-written C in `folder`."""
    section = Section(
        "Sampled controller, per step of a trajectory",
        f"The paper's example, {SAMPLES} samples of 1 ms, one core. By hand: C written for this one "
        "model, with five Taylor terms for the plant and the same reported quantities; scalar, and "
        "in vectors with libmvec; built with -O3 -march=native and contraction. Ours is built "
        "without contraction: its results do not depend on the machine. numba: the same step with "
        "RK4 for the plant.",
    )
    contest = _contestants(section, folder)
    times = _measure(contest, 3 if quick else 21)
    for what, ours, peer, bound in (
        ("one run", "ours", "C by hand, scalar", 1.15),
        ("one run", "ours", "numba, RK4", None),
        ("batch, per core", "ours, batch", "C by hand, scalar", 1 / 4),
        ("batch, per core", "ours, batch", "C by hand, vectors", 1.5),
        ("batch, per core", "ours, batch", "ours", None),
    ):
        if ours in times and peer in times:
            section.add(Row(what, times[ours], peer, times[peer], bound))
    return section


def _contestants(section: Section, folder: Path) -> Contest:
    loop = ClosedLoop.load("paper", evaluator="compiled")
    library = library_of(make_inputs(ROOT / "generated" / "paper"), os.environ)
    p = make_settings(loop.manifest).p
    hold = hold_matrices(loop.evaluator, p, SAMPLE_TIME)
    found: Contest = {"ours": (one_run(loop), 1), "ours, batch": (_batch(library, p, hold), RUNS)}
    for name, width, runs in (("C by hand, scalar", 1, 1), ("C by hand, vectors", library.width, RUNS)):
        try:
            found[name] = (_hand(by_hand.build(folder, width), hold, runs), runs)
        except OSError as error:
            section.absent.append(f"{name}: {error}")
    try:
        found["numba, RK4"] = (_numba(by_hand.numba_march(), hold), 1)
    except ImportError as error:
        section.absent.append(f"numba: no {error.name}")
    return found


def one_run(loop: ClosedLoop) -> Callable[[], Array]:
    """Return a call of our C loop over the whole horizon."""
    settings = make_settings(
        loop.manifest, controller="sampled", sample_time=SAMPLE_TIME, output_step=HORIZON
    )
    problem = constants(loop, settings, whole=True)

    def call() -> Array:
        memory = make_memory(problem, initial_state(loop.evaluator, settings))
        make_loop(loop.evaluator, problem, Progress(), memory)(ALL_STEPS)
        last: Array = memory.rows[-1]
        return last

    return call


def _batch(library: BatchLibrary, p: Array, hold: Array) -> Callable[[], Array]:
    runs = Runs(
        x0=np.tile(np.array(X0), (RUNS, 1)),
        p=np.tile(p, (RUNS, 1)),
        horizon=HORIZON,
        tolerance=1e-10,
        sample_time=SAMPLE_TIME,
        hold=hold[np.newaxis],
        times=np.empty(0),
        divergence=1e9,
        max_steps=ALL_STEPS,
    )
    return lambda: library.simulate(runs).final[0]


def _hand(hand: by_hand.ByHand, hold: Array, runs: int) -> Callable[[], Array]:
    x0, p = np.tile(np.array(X0), (runs, 1)), by_hand.parameters(runs)
    return lambda: hand.run(x0, p, hold, SAMPLE_TIME, SAMPLES)[0][0]


def _numba(march: Callable[..., Array], hold: Array) -> Callable[[], Array]:
    x0, p = np.array(X0), by_hand.parameters(1)[0]
    return lambda: march(x0, p, hold, SAMPLE_TIME, SAMPLES)[:10]


def _measure(contest: Contest, rounds: int) -> dict[str, float]:
    """Return the time of one step of one trajectory, s, by name; all must arrive at the same state."""
    expected = contest["ours"][0]()
    for name, (call, _) in contest.items():
        if not np.abs(call() - expected).max() <= AGREEMENT:
            raise SystemExit(f"benchmarks: {name} simulates something else: {call() - expected}")
    times = interleaved({name: call for name, (call, _) in contest.items()}, rounds)
    return {name: times[name] / (runs * SAMPLES) for name, (_, runs) in contest.items()}
