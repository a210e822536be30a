"""Print how this project compares with public tools, all measured in this one process run.

    make bench

Each row is a ratio of medians of interleaved runs, beside the ratio that the project promises.
Times are those of this machine; ratios travel better.
"""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import cvodes, sweeps
from benchmarks.clock import interleaved
from pmjoint_codegen import ClosedLoop, Run

ROOT = Path(__file__).resolve().parent.parent
REFERENCE = ROOT / "tests" / "reference" / "paper_sin.csv"
ACCURACY = 1e-9  # largest error in any state that a contestant may have


@dataclass(frozen=True)
class Row:
    """One comparison: ours may take at most `bound` times what the peer takes; times are medians, s."""

    what: str
    ours: float
    peer: str
    theirs: float
    bound: float

    @property
    def holds(self) -> bool:
        """Say whether the promise is kept."""
        return self.ours <= self.bound * self.theirs

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table as text."""
        verdict = "holds" if self.holds else "MISSED"
        ratio, promise = f"{self.ours / self.theirs:.3g}", f"<= {self.bound:.3g} {verdict}"
        return self.what, _shown(self.ours), self.peer, _shown(self.theirs), ratio, promise


HEADER = ("what", "ours", "peer", "its time", "ratio", "promise")


def table(rows: Sequence[Row]) -> str:
    """Return the rows as aligned text."""
    cells = [HEADER, *(row.cells() for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in cells
    )


def _shown(seconds: float) -> str:
    """Write a time with three digits and a unit."""
    unit, factor = (
        ("s", 1.0)
        if seconds >= 1
        else ("ms", 1e3)
        if seconds >= 1e-3
        else ("us", 1e6)
        if seconds >= 1e-6
        else ("ns", 1e9)
    )
    return f"{seconds * factor:.3g} {unit}"


def error(states: cvodes.Array, run: Run) -> float:
    """Return the largest difference from the reference trajectory, over all states and listed instants."""
    with REFERENCE.open(encoding="utf-8", newline="") as file:
        listed = list(csv.DictReader(file))
    names = [state.name for state in run.manifest.states]
    rows = [int(np.flatnonzero(np.isclose(run.t, float(line["t"])))[0]) for line in listed]
    expected = np.array([[float(line[name]) for name in names] for line in listed])
    return float(np.abs(states[rows] - expected).max())


def one_run(rounds: int) -> Row:
    """Compare the 20 s run on the default output grid with the fastest CVODES that is as accurate."""
    loop = ClosedLoop.load("paper", evaluator="compiled")
    run = loop.simulate()
    if error(run.states, run) > ACCURACY:
        sys.exit(f"our own run misses the demanded accuracy: {error(run.states, run):.1e}")
    dae = cvodes.closed_loop(ROOT / "generated" / "paper", run.settings.parameters["u_max"], run.settings.p)
    fit = [peer for peer in cvodes.entries(dae, run.states[0], run.t) if error(peer.run(), run) <= ACCURACY]
    trial = interleaved({peer.label: peer.run for peer in fit}, 3)
    best = min(fit, key=lambda peer: trial[peer.label])
    times = interleaved({"ours": loop.simulate, "peer": best.run}, rounds, burst=5)
    print(f"largest error: ours {error(run.states, run):.1e}, CVODES {error(best.run(), run):.1e}")
    return Row("paper, 20 s, 2001 instants", times["ours"], f"CVODES, {best.label}", times["peer"], 1 / 10)


def process(*arguments: str, cwd: Path = ROOT) -> Callable[[], object]:
    """Return a call that runs this interpreter once, silently, and fails if it does."""
    command = [sys.executable, *arguments]
    return lambda: subprocess.run(
        command,
        cwd=cwd,
        check=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def whole_process(folder: Path, rounds: int) -> Row:
    """Compare the whole `pmjoint simulate` process with an interpreter that imports NumPy and ends."""
    simulate = ("-m", "pmjoint_codegen", "simulate", "paper", "--no-figures", "--out", str(folder / "run"))
    times = interleaved({"ours": process(*simulate), "peer": process("-c", "import numpy")}, rounds)
    what = "pmjoint simulate paper --no-figures"
    return Row(what, times["ours"], 'python -c "import numpy"', times["peer"], 4.0)


def regenerate(folder: Path, rounds: int) -> Row:
    """Hold the whole `pmjoint regenerate paper` process, writing into a folder of its own, to 5 s."""
    shutil.copytree(ROOT / "models", folder / "models")
    call = process("-m", "pmjoint_codegen", "regenerate", "paper", cwd=folder)
    return Row("pmjoint regenerate paper", interleaved({"ours": call}, rounds)["ours"], "a clock", 5.0, 1.0)


def many_runs(folder: Path, *, quick: bool) -> list[Row]:
    """Compare the batch loops with their peers, and print the memory of a sweep over a million runs."""
    paper = sweeps.field(ROOT)
    found = [
        *sweeps.sampled(paper, folder, 3 if quick else 11),
        *sweeps.one_run(paper, 31 if quick else 301),
        *sweeps.continuous(paper, 3 if quick else 11),
        *sweeps.threads(paper, folder, 5 if quick else 21),
        *sweeps.workers(paper, folder),
    ]
    if not quick:
        print(sweeps.memory(folder))
    return [Row(item.what, item.ours, item.peer, item.theirs, item.bound) for item in found]


def main() -> None:
    """Measure, print one table, and exit with 1 if a promise is missed; `--quick` takes few rounds."""
    quick = "--quick" in sys.argv[1:]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["PMJOINT_CACHE"] = str(folder / "cache")
        rows = [
            one_run(5 if quick else 41),
            whole_process(folder, 3 if quick else 15),
            regenerate(folder, 1 if quick else 3),
            *many_runs(folder, quick=quick),
        ]
    print(table(rows))
    sys.exit(not all(row.holds for row in rows))


if __name__ == "__main__":
    main()
