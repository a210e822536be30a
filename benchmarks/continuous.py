"""One continuous run of the paper's model: work against precision, and times at one accuracy."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.clock import interleaved
from benchmarks.paper import HORIZON, Array
from benchmarks.peers import cvodes, heyoka_loop, jax_loop, numba_loop, ours, scipy_loop
from benchmarks.peers.solver import Solver
from benchmarks.reference import error
from benchmarks.report import Row, Section, processor, shown
from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.settings import DEFAULT_TOLERANCE
from pmjoint_codegen.simulate.style import png, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmjoint_codegen import Run

ACCURACY: Final = 1e-9  # largest error in any state that a contestant may have
GRID: Final[Array] = np.arange(2001, dtype=np.float64) * 0.01  # s, the default output grid
ENDS: Final[Array] = np.array([0.0, HORIZON])
PATIENCE_S: Final = 1.0  # a setting that takes longer is a solver's last
_STYLE: Final = {"axes.titlesize": 10.0}
FLOOR: Final = 1e-12  # the reference's own accuracy: points below it tell nothing
COLOURS: Final = ("black", "C0", "C1", "C2", "C3", "C4", "C5", "C6", "C7", "C8", "C9", "navy")
BOUNDS: Final = {"heyoka": 1.0, "CasADi CVODES": 1 / 40, "SciPy LSODA": 1 / 200}
BARE: Final = {**BOUNDS, "heyoka": 0.7}  # with no output but the end
FRONT_DOOR: Final = {  # of heyoka's time, for `ClosedLoop.simulate`
    "front door, output_step=1": (np.arange(0.0, HORIZON + 1.0), 0.9),
    "front door, 2001 instants": (GRID, 1.0),
    "front door, 2001 instants, all of it read": (GRID, None),
}


@dataclass(frozen=True)
class Point:
    """One setting of one solver: its largest error in any state, and its time, s, on the default grid."""

    setting: float
    error: float
    time: float


@dataclass(frozen=True)
class Curve:
    """A solver with what it reaches, the loosest setting first."""

    solver: Solver
    points: tuple[Point, ...]

    def fit(self) -> Point | None:
        """Return the fastest point that reaches the accuracy."""
        good = [point for point in self.points if point.error <= ACCURACY]
        return min(good, key=lambda point: point.time, default=None)


def contestants(absent: list[str]) -> list[Solver]:
    """Return all solvers that can run; the others are noted in `absent`."""
    found = [ours.states_only(), ours.whole()]
    sources: tuple[tuple[str, Callable[[], Iterable[Solver]]], ...] = (
        ("heyoka", lambda: [heyoka_loop.solver()]),
        ("CasADi CVODES", cvodes.solvers),
        ("SciPy", scipy_loop.solvers),
        ("numba RK4", lambda: _checked(numba_loop.field, numba_loop.runge_kutta)),
        ("diffrax", lambda: [jax_loop.solver()]),
        ("CasADi interpreted", lambda: [ours.states_only("interpreted")]),
    )
    for name, source in sources:
        try:
            found += source()
        except ImportError as error_:
            absent.append(f"{name}: no {error_.name}")
    return found


def _checked(first: Callable[[], object], then: Callable[[], Solver]) -> list[Solver]:
    first()
    return [then()]


def curve(solver: Solver, quick: bool) -> Curve:
    """Measure a solver at its settings, until one takes too long or passes the reference's accuracy."""
    points: list[Point] = []
    for setting in solver.settings:
        call = solver.make(setting, GRID)
        missed = error(GRID, call())
        begun = time.perf_counter()
        call()
        once = time.perf_counter() - begun
        repeats = 0 if once > 0.1 else 1 if quick else 9
        taken = interleaved({"": call}, repeats)[""] if repeats else once
        points.append(Point(setting, missed, taken))
        if once > PATIENCE_S or missed < FLOOR:
            break
    return Curve(solver, tuple(points))


def run(quick: bool, figure: Path | None) -> list[Section]:
    """Measure; draw the curves into `figure`.

    Args:
        quick: few rounds, for a smoke test.
        figure: where to draw, or None.
    """
    absent: list[str] = []
    curves = [curve(solver, quick) for solver in contestants(absent)]
    if figure is not None:
        draw(curves, figure)
    sections = [_one_accuracy(curves, GRID, quick, absent), _one_accuracy(curves, ENDS, quick, absent)]
    return [*sections, _front_door(curves, quick), _precision(curves)]


def against_heyoka(quick: bool) -> list[Section]:
    """Measure our bare loop, our front door and heyoka with events; heyoka chooses its own steps."""
    curves = [curve(solver, quick) for solver in (ours.states_only(), heyoka_loop.solver())]
    return [_one_accuracy(curves, ENDS, quick, []), _front_door(curves, quick)]


def _one_accuracy(curves: Sequence[Curve], grid: Array, quick: bool, absent: list[str]) -> Section:
    """Compare everybody on a grid at the accuracy demanded; slow solvers take fewer turns."""
    dense = len(grid) > 2
    what = "2001 output instants" if dense else "no output but the end"
    section = Section(
        f"One continuous run, 20 s, {what}",
        f"The paper's example; error at most {ACCURACY:g} in every state at every instant of "
        "tests/reference/paper_sin.csv, each solver in its fastest setting that reaches it. Ours is "
        "the C loop as the peers run theirs: prepared once, states and switches, called from Python. "
        "`ClosedLoop.simulate` checks the settings and makes a new record for every run.",
        absent=list(absent),
    )
    fits = [(item, point) for item in curves if (point := item.fit()) is not None]
    calls = {item.solver.label: item.solver.make(point.setting, grid) for item, point in fits}
    fast = {label: calls[label] for item, point in fits if point.time < 5e-3 for label in [item.solver.label]}
    slow = {label: call for label, call in calls.items() if label not in fast}
    times = interleaved(fast, 3 if quick else 31, burst=20) | interleaved(slow, 1 if quick else 5)
    for item, point in fits[1:]:
        section.add(_row(what, times, fits[0], item, point, dense))
    missing = [item.solver.label for item in curves if item.fit() is None]
    section.notes += [f"{label} does not reach {ACCURACY:g} in any setting tried" for label in missing]
    return section


def _front_door(curves: Sequence[Curve], quick: bool) -> Section:
    """Compare `ClosedLoop.simulate`, as scripts call it, with heyoka's bare integrator on the same grids."""
    section = Section(
        "One continuous run, 20 s, by ClosedLoop.simulate",
        f"The same example, at the default tolerance, {DEFAULT_TOLERANCE:g}, against heyoka in its fastest"
        f" setting that reaches {ACCURACY:g}. Every call checks its settings and gives a record of its own."
        " In the last row every signal and figure of the run is read, which are worked out then.",
    )
    loop = ClosedLoop.load("paper", evaluator="compiled")
    peers = [(item.solver, point) for item in curves if (point := item.fit()) is not None]
    for solver, point in (item for item in peers if item[0].label.startswith("heyoka")):
        for what, (grid, bound) in FRONT_DOOR.items():
            run = partial(loop.simulate, horizon=HORIZON, output_step=float(grid[1]))
            calls: dict[str, Callable[[], object]] = {"": run, "peer": solver.make(point.setting, grid)}
            if bound is None:
                calls[""] = partial(_read, run)
            times = interleaved(calls, 3 if quick else 31, burst=20)
            section.add(Row(what, times[""], solver.label, times["peer"], bound))
    return section


def _read(run: Callable[[], Run]) -> object:
    return run().summary


def _row(
    what: str,
    times: dict[str, float],
    own: tuple[Curve, Point],
    item: Curve,
    point: Point,
    dense: bool,
) -> Row:
    bounds = BOUNDS if dense else BARE
    bound = next((limit for start, limit in bounds.items() if item.solver.label.startswith(start)), None)
    achieved = (own[1].error, own[1].setting, point.error, point.setting)
    note = "errors: ours {:.1e} at {:.0e}, theirs {:.1e} at {:.0e}".format(*achieved)
    label = item.solver.label
    return Row(what, times[own[0].solver.label], label, times[item.solver.label], bound, note)


def _precision(curves: Sequence[Curve]) -> Section:
    """List each solver's time at the accuracies that it reaches."""
    demands = [10.0**-k for k in range(3, 12)]
    section = Section(
        "Work against precision",
        "The same run on the default grid: the least time at which a solver's error, over all states and"
        " listed instants, is at most that of the column.",
        header=("solver", *(f"{demand:.0e}" for demand in demands)),
        figure="figures/work_precision.png",
    )
    for item in curves:
        cells = []
        for demand in demands:
            taken = [point.time for point in item.points if point.error <= demand]
            cells.append(shown(min(taken)) if taken else "-")
        section.lines.append((item.solver.label, *cells))
    return section


def draw(curves: Sequence[Curve], path: Path) -> None:
    """Draw time against achieved error."""
    with styled(_STYLE):
        figure = _figure(curves)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(png(figure, _STYLE))


def _figure(curves: Sequence[Curve]) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Axes = figure.subplots()
    markers = "osD^v<>PX*hd"
    for index, item in enumerate(curves):
        errors = [max(point.error, FLOOR / 10) for point in item.points]
        times = [point.time * 1e3 for point in item.points]
        bold = item.solver.label == "ours"
        axes.loglog(
            errors,
            times,
            marker=markers[index % len(markers)],
            markersize=4,
            linewidth=2.0 if bold else 0.9,
            color=COLOURS[index % len(COLOURS)],
            label=item.solver.label,
        )
    axes.axvline(ACCURACY, color="0.6", linestyle=":", linewidth=1)
    axes.invert_xaxis()
    axes.set_xlabel("largest error in any state")
    axes.set_ylabel("time of one run, ms")
    axes.set_title(f"The paper's closed loop over 20 s, 2001 output instants; {processor()}")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, frameon=False)
    return figure
