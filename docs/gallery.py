"""The gallery: `python -m docs.gallery` runs the systems of docs/gallery.toml and writes page and figures.

Names of systems given to it limit the figures to these; the page is always written whole. A run is one
`pmjoint simulate` of the system's model file, with the options that the page prints.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import tempfile
import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.main import run as pmjoint
from pmjoint_codegen.reference.columns import factor, read_table
from pmjoint_codegen.simulate import style
from pmjoint_codegen.storage import write_bytes, write_text
from pmjoint_codegen.values import SI, to_si

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

ROOT: Final = Path(__file__).resolve().parent.parent
LIST: Final = ROOT / "docs" / "gallery.toml"
PAGE: Final = ROOT / "docs" / "gallery.md"
FIGURES: Final = ROOT / "docs" / "figures" / "gallery"
FOLDER: Final = "models/gallery"
WIDTH: Final = 120  # characters of a line of prose
RUN_FAILED: Final = 3  # exit code of a run that is lost
LOOK: Final[style.Look] = {"lines.linewidth": 1.0, "axes.titlesize": 9.5, "figure.dpi": 110}

HEAD = """# Gallery

<!-- Written by `python -m docs.gallery` from docs/gallery.toml; edit that. -->

Real systems, each with the numbers of its source, in a model file of the keys that [models.md](models.md)
explains. Nothing is eliminated by hand: a file states the physics, and the output-feedback form is derived
from it. Sensors, limits and sample times are those of the source unless its section says otherwise. All
results are simulations of the source's model under this controller; nothing here has been run on the
machine itself. A published figure is what the source reports of its own controller, under its own
conditions.

Every line below is one `pmjoint simulate` of the file with the options shown. "Error" is the largest |y −
y_r| of the rows of `trajectory.csv` from the given instant to the end of the run. A test repeats every run,
holds each error to its bound, and compares it with this page. `python -m docs.gallery` writes page and
figures anew.
"""


@dataclass(frozen=True)
class Run:
    """One run of a system.

    Attributes:
        name: what it shows.
        options: of `pmjoint simulate`.
        after: s; the error counts from here on.
        bound: what the error must stay below, in `unit`; None where the loop is lost.
        unit: of the error, as the page prints it.
        digits: of the error, as the page prints it.
    """

    name: str
    options: str
    after: float
    unit: str
    bound: float | None = None
    digits: int = 2

    def __post_init__(self) -> None:
        """Refuse what proves nothing."""
        if self.bound is not None and not 0.0 < self.bound < math.inf:
            raise ValueError(f"{self.name}: bound = {self.bound}, not a positive number")


@dataclass(frozen=True)
class System:
    """One system of the gallery.

    Attributes:
        model: stem of its file in models/gallery/.
        story: what it is and what is asked of it.
        source: where the numbers come from, and what was taken from there.
        published: what the source reports of its own controller; empty where it reports nothing comparable.
        misfit: what of the system the model or the method leaves out, and why.
        runs: the first is drawn.
    """

    model: str
    story: str
    source: str
    misfit: str
    runs: tuple[Run, ...]
    published: str = ""

    @property
    def file(self) -> Path:
        """Its model file."""
        return ROOT / FOLDER / f"{self.model}.toml"

    @property
    def title(self) -> str:
        """Its name in the model file."""
        title: str = tomllib.loads(self.file.read_text(encoding="utf-8"))["title"]
        return title


@dataclass(frozen=True)
class Outcome:
    """What one run gave.

    Attributes:
        run: which.
        summary: summary.json.
        columns: t, y, y_r, e and u of trajectory.csv, each of shape (rows,).
        late: the largest |e| after `run.after`, in its unit; None where the loop was lost.
    """

    run: Run
    summary: Mapping[str, Any]
    columns: Mapping[str, Array]
    late: float | None

    @property
    def holds(self) -> bool:
        """Whether it ended as docs/gallery.toml says."""
        if self.run.bound is None or self.late is None:
            return self.run.bound is None and self.late is None
        return self.late <= self.run.bound

    @property
    def clock(self) -> str:
        """How the controller ran."""
        if self.summary["controller"] != "sampled":
            return "continuous"
        period = float(self.summary["sample_time"])
        return f"{1000 * period:.4g} ms"

    @property
    def shown(self) -> str:
        """The error as the page prints it."""
        return "lost" if self.late is None else f"{said(self.late, self.run.digits)} {self.run.unit}"


def systems(file: Path = LIST) -> tuple[System, ...]:
    """All systems, in the order of the page.

    Raises:
        TypeError: an entry has an unknown key, or lacks one.
    """
    entries = tomllib.loads(file.read_text(encoding="utf-8"))["system"]
    return tuple(System(**{**entry, "runs": tuple(Run(**run) for run in entry["runs"])}) for entry in entries)


def said(value: float, digits: int) -> str:
    """A number with so many digits."""
    return f"{value:#.{digits}g}".rstrip(".").replace("e-0", "e-")


def outcome(system: System, run: Run) -> Outcome:
    """Simulate as the page says.

    Raises:
        SystemExit: the command failed otherwise than by a run that is lost.
    """
    with tempfile.TemporaryDirectory() as folder:
        told = StringIO()
        command = ["simulate", str(system.file), *shlex.split(run.options), "--no-figures", "--out", folder]
        with redirect_stdout(told), redirect_stderr(told):
            code = pmjoint(command)
        if code not in (0, RUN_FAILED):
            raise SystemExit(f"gallery: pmjoint {shlex.join(command)} failed:\n{told.getvalue()}")
        summary = json.loads((Path(folder) / "summary.json").read_text(encoding="utf-8"))
        table = read_table(Path(folder) / "trajectory.csv")
        columns = {name: table.numbers(name) for name in ("t", "y", "y_r", "e", "u")}
    return Outcome(run, summary, columns, None if code else late(run, summary, columns))


def late(run: Run, summary: Mapping[str, Any], columns: Mapping[str, Array]) -> float:
    """The largest |e| of the rows after `run.after`, in the run's unit."""
    scale = factor(summary["units"]["e"], run.unit, run.name)
    return scale * float(np.max(np.abs(columns["e"][columns["t"] >= run.after])))


def outcomes(system: System) -> tuple[Outcome, ...]:
    """All runs of a system."""
    return tuple(outcome(system, run) for run in system.runs)


def section(system: System, found: Sequence[Outcome]) -> str:
    """A system's part of the page."""
    lines = [
        f"## {system.title}",
        "",
        f"![{system.title}: output, error and input](figures/gallery/{system.model}.png)",
        "",
        paragraph(system.story),
        "",
        paragraph(f"**Source.** {system.source}"),
        "",
        f"Model file: [{FOLDER}/{system.model}.toml](../{FOLDER}/{system.model}.toml).",
        "",
        "| run | sample time | error | from | bound | options |",
        "|---|---|---|---|---|---|",
        *(row(item) for item in found),
        "",
        paragraph(f"**Published.** {system.published or 'No figure that compares.'}"),
        "",
        paragraph(f"**What does not fit.** {system.misfit}"),
    ]
    return "\n".join(lines) + "\n"


def row(found: Outcome) -> str:
    """One line of a system's table."""
    run = found.run
    bound = "-" if run.bound is None else f"{run.bound:.4g}".replace("e-0", "e-")
    options = f"`{run.options}`" if run.options else ""
    return f"| {run.name} | {found.clock} | {found.shown} | {run.after:.4g} s | {bound} | {options} |"


def paragraph(text: str) -> str:
    """A text of the list as a paragraph of the page."""
    return textwrap.fill(" ".join(text.split()), WIDTH, break_long_words=False, break_on_hyphens=False)


def page(found: Mapping[System, Sequence[Outcome]]) -> str:
    """The page."""
    lines = [
        "| system | sample time | error | from |",
        "|---|---|---|---|",
        *(line(system, first) for system, (first, *_) in found.items()),
    ]
    return "\n".join([HEAD, "\n".join(lines), "", *(section(*pair) for pair in found.items())])


def line(system: System, first: Outcome) -> str:
    """A system's line at the head of the page, with its first run."""
    name = f"[{system.title}](#{anchor(system.title)})"
    return f"| {name} | {first.clock} | {first.shown} | {first.run.after:.4g} s |"


def anchor(title: str) -> str:
    """The name by which a link reaches a heading."""
    return "".join(letter for letter in title.lower().replace(" ", "-") if letter.isalnum() or letter in "-_")


def figure(system: System, found: Outcome) -> Figure:
    """Draw y and y_r, e with its bound, u with its limits, side by side."""
    from matplotlib.figure import Figure

    columns, run = found.columns, found.run
    units = found.summary["units"]
    scale = factor(units["e"], run.unit, run.name)
    t = columns["t"]
    with style.styled(LOOK):
        drawn = Figure(figsize=(7.4, 1.9), layout="constrained")
        output, error, actuation = drawn.subplots(1, 3)
        output.plot(t, scale * columns["y"], color=style.BLUE, label="$y$")
        output.plot(t, scale * columns["y_r"], color=style.RED, linestyle="--", label="$y_r$")
        output.legend(fontsize=8, loc="best")
        output.set_title(f"output ({run.unit})")
        error.plot(t, scale * columns["e"], color=style.BLUE)
        if run.bound is not None:
            for sign in (-1.0, 1.0):
                error.plot([run.after, t[-1]], [sign * run.bound] * 2, color=style.GREY, linestyle=":")
            fit(error, scale * columns["e"][t >= run.after], run.bound)
        error.set_title(f"error $y - y_r$ ({run.unit})")
        actuation.plot(t, columns["u"], color=style.BLUE)
        for limit in limits(system, found):
            actuation.axhline(limit, color=style.GREY, linestyle=":")
        actuation.set_title(f"input $u$ ({units['u']})")
        for axes in (output, error, actuation):
            axes.set_xlim(0.0, float(t[-1]))
            axes.set_xlabel("$t$ (s)", labelpad=1)
    return drawn


def fit(axes: Axes, error: Array, bound: float) -> None:
    """Show the late error and its bound; a larger transient leaves the panel."""
    height = 1.6 * max(float(np.max(np.abs(error))), bound)
    axes.set_ylim(-height, height)


def limits(system: System, found: Outcome) -> tuple[float, ...]:
    """The actuator's limits in a run, in the unit of u: the file may state them in another, such as deg."""
    manifest = ClosedLoop.load(system.file, notify=lambda line: None).manifest
    stated = found.summary["parameters"]
    return manifest.limits({name: to_si(stated[name], manifest.scales.get(name, SI)) for name in stated})


def main(names: Sequence[str]) -> None:
    """Write the page, and the figures of the named systems or of all."""
    os.environ.setdefault("PMJOINT_PROGRESS", "0")
    found = {system: outcomes(system) for system in systems()}
    write_text(PAGE, page(found))
    for system, (first, *_) in found.items():
        if not names or system.model in names:
            write_bytes(FIGURES / f"{system.model}.png", style.png(figure(system, first), LOOK))
    broken = [
        f"{system.model}, {item.run.name}: {item.shown}, bound {item.run.bound}"
        for system, items in found.items()
        for item in items
        if not item.holds
    ]
    if broken:
        raise SystemExit("gallery: these runs miss their bounds\n" + "\n".join(broken))


if __name__ == "__main__":
    main(sys.argv[1:])
