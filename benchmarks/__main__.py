"""Compare this project with its peers, all measured in this one run, and write ``docs/benchmarks.md``.

    make bench                     # about ten minutes
    make bench ARGS="law sampled"  # only these tables; writes nothing
    make bench ARGS=heyoka         # one run and the sweep, against heyoka alone
    make bench-smoke               # --quick: few rounds, small sweeps; writes nothing; part of .ci/run

Each row is a ratio of medians of interleaved runs, beside the ratio that the project promises. Times are
those of this machine; ratios travel better.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from benchmarks import continuous, exported, law, processes, sampled, scaling, sweeps
from benchmarks.reference import ROOT
from benchmarks.report import Section, document

DOCUMENT = ROOT / "docs" / "benchmarks.md"
FIGURE = ROOT / "docs" / "figures" / "work_precision.png"

Parts = Mapping[str, Callable[[], list[Section]]]


def parts(quick: bool, folder: Path, figure: Path | None) -> Parts:
    """Return the parts of the benchmark by name, in the order of the document."""
    return {
        "continuous": lambda: continuous.run(quick, figure),
        "sampled": lambda: [sampled.run(quick, folder)],
        "exported": lambda: [exported.run(quick, folder)],
        "sweep": lambda: [sweeps.run(quick), scaling.run(quick)],
        "law": lambda: [law.run(quick, folder)],
        "process": lambda: [processes.run(quick, folder)],
        "disk": lambda: [processes.sweeps(quick, folder)],
    }


def against_heyoka(quick: bool) -> list[Section]:
    """The ratios to heyoka that must hold, alone; the whole benchmark has them among others."""
    return [*continuous.against_heyoka(quick), sweeps.run(quick, sweeps.AGAINST_HEYOKA)]


def main(arguments: list[str]) -> int:
    """Measure, print and write; 1 where a promise is missed, but for a smoke test."""
    quick = "--quick" in arguments
    named = [name for name in arguments if name != "--quick"]
    whole = not quick and not named
    sections: list[Section] = []
    with tempfile.TemporaryDirectory() as name:
        os.environ["PMJOINT_CACHE"] = str(Path(name) / "cache")
        every = parts(quick, Path(name), FIGURE if whole else None)
        known: Parts = {**every, "heyoka": lambda: against_heyoka(quick)}
        if unknown := [part for part in named if part not in known]:
            print(f"benchmarks: no part {', '.join(unknown)}; parts: {', '.join(known)}", file=sys.stderr)
            return 2
        for part in named or every:
            for section in known[part]():
                print(section.text(), end="\n\n", flush=True)
                sections.append(section)
    if whole:
        DOCUMENT.write_text(document(sections), encoding="utf-8")
    return int(not quick and any(section.missed for section in sections))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
