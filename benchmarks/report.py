"""What the benchmark prints and writes: rows with their promises, tables, and the machine."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

PACKAGES: Final = (
    "numpy", "scipy", "casadi", "sympy", "heyoka", "numba", "jax", "diffrax", "dask", "distributed"
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One comparison: ours may take at most `bound` times what the peer takes; times are medians, s.

    Attributes:
        what: is compared.
        ours: s.
        peer: who, and in which setting.
        theirs: s.
        bound: largest ratio promised; None where nothing is.
        note: achieved errors, or why a promise is missed.
    """

    what: str
    ours: float
    peer: str
    theirs: float
    bound: float | None = None
    note: str = ""

    @property
    def ratio(self) -> float:
        """Ours over theirs."""
        return self.ours / self.theirs

    @property
    def holds(self) -> bool:
        """Say whether the promise is kept."""
        return self.bound is None or self.ratio <= self.bound

    def cells(self) -> tuple[str, ...]:
        """Return the row as text."""
        return (
            self.what,
            shown(self.ours),
            self.peer,
            shown(self.theirs),
            f"{self.ratio:.3g}",
            self._promise(),
        )

    def _promise(self) -> str:
        if self.bound is None:
            return "-"
        if self.holds:
            return f"<= {self.bound:.3g} holds"
        return f"<= {self.bound:.3g} MISSED by {self.ratio / self.bound - 1:.0%}"


HEADER: Final = ("what", "ours", "peer", "its time", "ratio", "promise")


@dataclass
class Section:
    """One table of the report.

    Attributes:
        title: of the table.
        about: what is measured and how, a paragraph.
        header: of the columns.
        lines: cells.
        missed: rows whose promise is not kept.
        absent: peers that could not run, with the reason.
        notes: sentences below the table.
    """

    title: str
    about: str
    header: Sequence[str] = HEADER
    lines: list[tuple[str, ...]] = field(default_factory=list)
    missed: list[Row] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    figure: str = ""

    def add(self, row: Row) -> None:
        """Append a comparison."""
        self.lines.append(row.cells())
        if not row.holds:
            self.missed.append(row)
        if row.note:
            self.notes.append(f"{row.what} ({row.peer}): {row.note}")

    def text(self) -> str:
        """Return the table as aligned text."""
        cells = [tuple(self.header), *self.lines]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        table = [
            "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
            for line in cells
        ]
        return "\n".join([f"== {self.title}", *table, *self._below()])

    def markdown(self, processor: str) -> str:
        """Return the section of the document, which says on what its figures were measured."""
        lines = [_row(self.header), _row(["---"] * len(self.header)), *map(_row, self.lines)]
        below = [f"- {line}" for line in self._below()]
        figure = [f"![{self.title}]({self.figure})", ""] if self.figure else []
        about = f"{self.about} Processor: {processor}."
        return "\n".join([f"## {self.title}", "", about, "", *figure, *lines, "", *below]).rstrip() + "\n"

    def _below(self) -> list[str]:
        return [*(f"not run: {line}" for line in self.absent), *self.notes]


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def shown(seconds: float) -> str:
    """Write a time with three digits and a unit."""
    scales = ((1.0, 1.0, "s"), (1e-3, 1e3, "ms"), (1e-6, 1e6, "us"))
    for least, factor, unit in scales:
        if seconds >= least:
            return f"{seconds * factor:.3g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def machine() -> Mapping[str, str]:
    """Describe the machine and the software: no path, no clock, no name of the machine."""
    return {
        "processor": processor(),
        "cores": str(os.cpu_count()),
        "memory": f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.machine()}, {' '.join(platform.libc_ver())}",
        "compiler": _compiler(),
        "Python": platform.python_version(),
    } | {name: _version(name) for name in PACKAGES}


def processor() -> str:
    """Name the processor and its widest vector instructions."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    flags = re.search(r"^flags\s*:\s*(.+)$", text, re.MULTILINE)
    known = set(flags[1].split()) if flags else set()
    vectors = next((name for name in ("avx512f", "avx2", "avx") if name in known), "")
    return f"{found[1] if found else 'unknown'}{', ' + vectors if vectors else ''}"


def _compiler() -> str:
    command = os.environ.get("CC", "cc").split()
    try:
        done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "none"
    return done.stdout.splitlines()[0]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


HEAD: Final = """# Benchmarks

Written by `make bench`; every figure here comes from one run of it on one machine, in which the
contestants took turns, and is a median. A ratio is our time over the peer's: below 1 is faster. Times
are the machine's; ratios travel better. A promise is the largest ratio that we hold ourselves to. Nobody
is slowed down for it: each peer runs in the fastest of the settings tried that reaches the accuracy
demanded, compiled where it can be.

`make bench` installs the peers; without one of them, it is named as not run.
"""


def document(sections: Sequence[Section]) -> str:
    """Return ``docs/benchmarks.md``."""
    facts = [_row(("machine", "")), _row(("---", "---")), *(_row(item) for item in machine().items())]
    tables = (section.markdown(processor()) for section in sections)
    return "\n".join([HEAD, *facts, "", *tables, _verdict(sections)])


# Why a promise may be missed, by (what, peer) of a row: the first whose beginnings both fit.
WHY: Final = (
    (
        "",
        "SciPy LSODA (odeint)",
        "odeint's loop is compiled Fortran and numba compiles its right-hand side, which leaves nothing"
        " interpreted; the rows with `solve_ivp`, SciPy's present interface to the same solver, keep the"
        " promise",
    ),
    (
        "",
        "SciPy LSODA (solve_ivp), right-hand side numba",
        "only solve_ivp's own steps are interpreted",
    ),
    (
        "2001",
        "",
        "values of the polynomials at 2001 instants are most of our time, and little of a slow solver's",
    ),
    (
        "",
        "one thread",
        "the row of two processes or commands apart, which share nothing, is what the machine gave two at"
        " once; beyond it, start and writing are one thread's work",
    ),
    (
        "",
        "one Dask worker",
        "the row of two commands apart is what the machine gave two at once; beyond it, the client, the"
        " scheduler and two workers share two cores",
    ),
)


def _verdict(sections: Sequence[Section]) -> str:
    missed = [
        f"- {row.what}, against {row.peer}: {row.ratio:.3g} where at most {row.bound:.3g} is promised."
        f" Why: {_reason(row)}."
        for section in sections
        for row in section.missed
    ]
    return "\n".join(["## Promises missed", "", *(missed or ["None."]), ""])


def _reason(row: Row) -> str:
    fitting = (why for what, peer, why in WHY if row.what.startswith(what) and row.peer.startswith(peer))
    return next(fitting, "not known yet")
