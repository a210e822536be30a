"""How a sweep in memory scales: with the number of runs, and with threads beside what the machine gives."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from benchmarks.clock import interleaved
from benchmarks.drawn import Request, chunks, draw, library, make_chunk, requests
from benchmarks.halves import apart
from benchmarks.paper import HORIZON
from benchmarks.report import Row, Section
from benchmarks.sweeps import RUNS
from pmjoint_codegen.loops.batch import BatchLibrary


def run(quick: bool) -> Section:
    """Measure ours with the number of runs, and with two threads; and what the machine itself can do."""
    batch = library()
    most = 8000 if quick else RUNS
    request = requests(batch, draw(most))
    section = Section(
        "Scaling of a sweep in memory",
        "The same sweep at 1e-6: time of one run with the number of runs, and of the whole with two threads"
        " against one, cut into chunks as `pmjoint sweep` cuts it. Bound: two threads take at most 1/1.9 of"
        " the time of one. The yardstick for it is the row of two processes that make half the runs each and"
        " share nothing: what this machine gave two at once in the same rounds.",
    )
    sizes = [size for size in (1000, 10_000, 100_000) if size <= most]
    calls = {str(n): partial(_make, batch, request, n) for n in sizes}
    times = interleaved(calls, 1 if quick else 5)
    for size in sizes[1:]:
        section.add(
            Row(f"{size} runs, each", times[str(size)] / size, "1000 runs, each", times["1000"] / 1000)
        )
    taken = _two_at_once(batch, request, most, 3 if quick else 9)
    section.add(Row(f"{most} runs, two threads", taken["2"], "one thread", taken["1"], 1 / 1.9))
    section.add(Row(f"{most} runs, two processes apart", taken["apart"], "one thread", taken["1"]))
    section.add(Row(f"{most} runs, two threads", taken["2"], "two processes apart", taken["apart"]))
    return section


def _make(batch: BatchLibrary, request: Request, runs: int) -> None:
    batch.simulate(request(1e-6, slice(0, runs), HORIZON))


def _two_at_once(batch: BatchLibrary, request: Request, runs: int, rounds: int) -> dict[str, float]:
    """Return times with one thread, with two, and with two processes that share nothing, s."""

    def with_threads(count: int) -> None:
        with ThreadPoolExecutor(count) as pool:
            list(pool.map(lambda which: make_chunk(batch, request, which), chunks(runs)))

    with apart(runs, 2) as halves:
        calls: dict[str, Callable[[], object]] = {
            "1": partial(with_threads, 1),
            "2": partial(with_threads, 2),
            "apart": halves,
        }
        return interleaved(calls, rounds)
