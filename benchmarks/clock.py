"""Fair timing on a shared machine: the contestants take turns, and medians are compared."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping


def interleaved(
    contestants: Mapping[str, Callable[[], object]], rounds: int, burst: int = 1, *, warm: bool = False
) -> dict[str, float]:
    """Time each contestant once a round, after one round that does not count.

    Args:
        contestants: by name, what to run.
        rounds: how many times each is timed.
        burst: calls in one timing, so that short ones are longer than the clock's grain.
        warm: the contestants have run before: no round that does not count.

    Returns:
        by name, the median time of one call, s.
    """
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for index in range(warm, rounds + 1):
        for name, call in contestants.items():
            begun = time.perf_counter()
            for _ in range(burst):
                call()
            if index:
                times[name].append((time.perf_counter() - begun) / burst)
    return {name: statistics.median(taken) for name, taken in times.items()}
