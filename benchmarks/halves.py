"""What the machine itself can do: a process that makes its share of a sweep on its own, when it is told to.

    python -m benchmarks.halves RUNS PART PARTS     # a line on standard input: make them; a line back: done

Two such processes share no interpreter, no lock and no memory. The time that they take for half the runs
each, against one that makes them all, is the best that this machine has to offer two threads.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from benchmarks.drawn import chunks, draw, library, make_chunk, requests
from benchmarks.reference import ROOT


@contextmanager
def apart(runs: int, parts: int) -> Iterator[Callable[[], None]]:
    """Start processes that have a part of the runs each; gives a call that makes them all once."""
    command = [sys.executable, "-m", "benchmarks.halves", str(runs)]
    started = [
        subprocess.Popen(
            [*command, str(part), str(parts)],
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for part in range(parts)
    ]

    def make() -> None:
        for child in started:
            assert child.stdin is not None
            child.stdin.write("\n")
            child.stdin.flush()
        for child in started:
            assert child.stdout is not None
            if not child.stdout.readline():
                raise SystemExit("benchmarks: a process that makes its share alone has failed")

    try:
        yield make
    finally:
        for child in started:
            child.communicate()


def main(runs: int, part: int, parts: int) -> None:
    """Make a part of the runs for every line that comes in."""
    batch = library()
    request = requests(batch, draw(runs))
    own = chunks(runs)[part::parts]
    for _ in sys.stdin:
        for which in own:
            make_chunk(batch, request, which)
        print("done", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
