"""A continuous sweep over random initial states and parameters: runs per second and core."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

import numpy as np

from benchmarks.clock import interleaved
from benchmarks.drawn import Draw, draw, library, requests
from benchmarks.paper import HORIZON, Array
from benchmarks.peers import heyoka_loop, jax_loop, scipy_loop
from benchmarks.peers.solver import load
from benchmarks.report import Row, Section
from pmjoint_codegen import ClosedLoop

ACCURACY: Final = 1e-6  # largest error in any state at any of the instants below
INSTANTS: Final = (0.5, 2.0, HORIZON)  # s: in the transient and after it
CHECKED: Final = 128  # runs whose errors are looked at
RUNS: Final = 100_000
SLOW: Final = {
    "SciPy": 64,
    "SciPy, Python": 8,
    "ours, one by one": 256,
    "diffrax": 64,
    "heyoka, one by one": 2048,
}
AGAINST_HEYOKA: Final = 3  # ours, ours one by one, heyoka's batch
HALVES: Final = tuple(10.0**-k for k in np.arange(4.0, 10.1, 0.5))

Integrate = Callable[[float, int, float], Array]  # tolerance, number of runs, horizon -> final states


@dataclass(frozen=True)
class Contestant:
    """A way to make the runs.

    Attributes:
        label: its name.
        tolerances: to choose from, the loosest first.
        integrate: makes the first so many runs.
        runs: how many in one timing.
    """

    label: str
    tolerances: Sequence[float]
    integrate: Integrate
    runs: int


def run(quick: bool, first: int | None = None) -> Section:
    """Measure everybody on one core, at the loosest tolerance that reaches the accuracy.

    Args:
        quick: fewer runs and rounds.
        first: how many contestants take part, ours first; None: all.
    """
    runs = 8000 if quick else RUNS
    drawn = draw(runs)
    instants = ", ".join(f"{t:g}" for t in INSTANTS)
    section = Section(
        f"Continuous sweep, {runs} random runs of 20 s",
        "Time of one run on one core. x1(0) within 20 rad, x2(0) within 10 rad/s, d1 in 0.1 to 0.3, b0 in"
        f" 1.6 to 2.4; error at most {ACCURACY:g} in every state at {instants} s of {CHECKED} runs, against"
        " heyoka at 1e-15 (without it: ours, one by one, at 1e-13). Ours reports status, integral of e^2,"
        " largest |e| and |v|, settling and saturated time; the peers final states. Slow peers make fewer"
        " runs.",
    )
    expected = _expected(drawn)
    chosen = []
    for contestant in islice(_contestants(drawn, runs, section.absent), first):
        tolerance, worst = _loosest(contestant, expected)
        if worst <= ACCURACY:
            chosen.append((contestant, tolerance, worst))
        else:
            section.notes.append(f"{contestant.label} does not reach {ACCURACY:g}: {worst:.1e}")
    times = _measure(chosen, quick)
    for contestant, tolerance, worst in chosen[1:]:
        bound = _bound(contestant.label)
        note = f"errors: ours {chosen[0][2]:.1e} at {chosen[0][1]:.0e}, theirs {worst:.1e} at {tolerance:.0e}"
        section.add(
            Row("one run of a sweep", times["ours"], contestant.label, times[contestant.label], bound, note)
        )
    section.notes.append(f"trajectories per second and core, ours: {1 / times['ours']:.3g}")
    return section


def _bound(label: str) -> float | None:
    return next((b for start, b in (("heyoka", 1 / 2), ("SciPy", 1 / 1000)) if label.startswith(start)), None)


def _measure(chosen: Sequence[tuple[Contestant, float, float]], quick: bool) -> dict[str, float]:
    """Return medians of the time of one run, s; the two fast ones meet more often."""
    calls = {
        item.label: (lambda item=item, tolerance=tolerance: item.integrate(tolerance, item.runs, HORIZON))
        for item, tolerance, _ in chosen
    }
    sizes = {item.label: item.runs for item, _, _ in chosen}
    fast = {name: call for name, call in calls.items() if sizes[name] > max(SLOW.values())}
    slow = {name: call for name, call in calls.items() if name not in fast}
    times = interleaved(fast, 1 if quick else 5) | interleaved(slow, 1 if quick else 3)
    return {name: taken / sizes[name] for name, taken in times.items()}


def _loosest(contestant: Contestant, expected: Sequence[Array]) -> tuple[float, float]:
    """Return the loosest tolerance that reaches the accuracy, or the tightest; and its error."""
    worst = float("inf")
    for tolerance in contestant.tolerances:
        count = min(len(expected[0]), contestant.runs)
        found = [contestant.integrate(tolerance, count, t) for t in INSTANTS]
        worst = max(
            float(np.abs(a[: len(b)] - b[: len(a)]).max()) for a, b in zip(found, expected, strict=True)
        )
        if worst <= ACCURACY:
            return tolerance, worst
    return contestant.tolerances[-1], worst


def _expected(drawn: Draw) -> list[Array]:
    """Return final states of the checked runs at the instants."""
    try:
        integrate = _heyoka_single(drawn)
        return [integrate(1e-15, CHECKED, t) for t in INSTANTS]
    except ImportError:
        own = _one_by_one(drawn)
        return [own(1e-13, CHECKED, t) for t in INSTANTS]


def _contestants(drawn: Draw, runs: int, absent: list[str]) -> Iterator[Contestant]:
    batch = library()
    request = requests(batch, drawn)
    yield Contestant(
        "ours", HALVES, lambda tol, n, t: batch.simulate(request(tol, slice(0, n), t)).final, runs
    )
    yield Contestant("ours, one by one", HALVES, _one_by_one(drawn), SLOW["ours, one by one"])
    name = "heyoka"
    try:
        yield Contestant("heyoka, batch of 8", HALVES, _heyoka_batch(drawn), min(runs, 20_000) // 8 * 8)
        yield Contestant("heyoka, one by one", HALVES, _heyoka_single(drawn), SLOW["heyoka, one by one"])
    except ImportError as error:
        absent.append(f"{name}: no {error.name}")
    yield from _scipy(drawn)
    try:
        yield Contestant("diffrax Dopri8, vmap", jax_loop.SETTINGS, _diffrax(drawn), SLOW["diffrax"])
    except ImportError as error:
        absent.append(f"diffrax: no {error.name}")


def _one_by_one(drawn: Draw) -> Integrate:
    loop = ClosedLoop.load("paper", evaluator="compiled")

    def integrate(tolerance: float, n: int, horizon: float) -> Array:
        return np.array([
            loop.simulate(
                parameters={"d1": drawn.d1[i], "b0": drawn.b0[i]},
                x0=drawn.x0[i, :2],
                horizon=horizon,
                output_step=horizon,
                tolerance=tolerance,
            ).states[-1]
            for i in range(n)
        ])  # fmt: skip

    return integrate


def _heyoka_single(drawn: Draw) -> Integrate:
    load("heyoka")

    pars = heyoka_loop.initial_modes(drawn.x0, drawn.d1, drawn.b0)
    made: dict[float, Any] = {}

    def integrate(tolerance: float, n: int, horizon: float) -> Array:
        ta = made[tolerance] = made.get(tolerance) or heyoka_loop.single(tolerance)
        return heyoka_loop.run_single(ta, drawn.x0[:n], pars[:n], horizon)

    return integrate


def _heyoka_batch(drawn: Draw) -> Integrate:
    load("heyoka")

    pars = heyoka_loop.initial_modes(drawn.x0, drawn.d1, drawn.b0)
    made: dict[float, Any] = {}

    def integrate(tolerance: float, n: int, horizon: float) -> Array:
        ta = made[tolerance] = made.get(tolerance) or heyoka_loop.batch(tolerance)
        return heyoka_loop.run_batch(ta, drawn.x0[:n], pars[:n], horizon)

    return integrate


def _scipy(drawn: Draw) -> Iterator[Contestant]:
    right, compiled_by = scipy_loop.field()

    def loop(one: Callable[[Array, tuple[float, ...], Array, float], Array]) -> Integrate:
        def integrate(tolerance: float, n: int, horizon: float) -> Array:
            grid = np.array([0.0, horizon])
            plants = zip(drawn.d1.tolist(), drawn.b0.tolist(), strict=True)
            rows = zip(drawn.x0[:n], plants, strict=False)
            return np.array([one(x0, (*plant, heyoka_loop.LIMIT), grid, tolerance)[-1] for x0, plant in rows])

        return integrate

    compiled = loop(lambda x0, plant, grid, tol: scipy_loop.odeint_run(right, x0, plant, grid, tol))
    yield Contestant(f"SciPy LSODA (odeint), {compiled_by}", HALVES, compiled, SLOW["SciPy"])
    yield Contestant(
        "SciPy LSODA (solve_ivp), Python", HALVES, loop(scipy_loop.solve_ivp_run), SLOW["SciPy, Python"]
    )


def _diffrax(drawn: Draw) -> Integrate:
    jax_loop.many()

    def integrate(tolerance: float, n: int, horizon: float) -> Array:
        n = min(n, SLOW["diffrax"])  # one compiled shape
        return jax_loop.run_many(drawn.x0[:n], drawn.d1[:n], drawn.b0[:n], horizon, tolerance)

    return integrate
