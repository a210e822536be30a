"""One simulation: settings in, `Run` out.

The stages of `Simulator.run`: a `Problem` from the settings, or that of the run before; the loop until it
ends; and, on first reading, the derived columns and the summary.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack, cast, overload

import numpy as np

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.logs.formats import save
from pmjoint_codegen.loops.chain import actuator_of, is_looped, make_chain
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.logits import reach_of
from pmjoint_codegen.loops.metrics import last_exit
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.loops.problem import Memory, Problem, Progress, make_memory, own_parameters
from pmjoint_codegen.loops.select import Advance, CompiledLoop, make_loop
from pmjoint_codegen.loops.status import Status, sentence
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.reference.segments import inside
from pmjoint_codegen.simulate.fixed import fixed_constants
from pmjoint_codegen.simulate.located import Holds, switches_of
from pmjoint_codegen.simulate.record import RATE, Record, reports_rate
from pmjoint_codegen.simulate.settings import RunOptions, Settings, make_settings
from pmjoint_codegen.simulate.signals import signals_of
from pmjoint_codegen.simulate.start import columns_of, make_start
from pmjoint_codegen.simulate.summary import summarise
from pmjoint_codegen.simulate.trajectory import trajectory_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BUDGET: Final = 2000  # steps between two looks at progress and Ctrl-C
FEW_SWITCHES: Final = 1000  # more restart the run, with room for as many as the settings allow
SHARED: Final = attrgetter(  # settings, besides p, that a `Problem` depends on
    *("controller", "horizon", "output_step", "sample_time", "tolerance", "max_step", "divergence"),
    *("max_steps", "max_switches"),
)
FEW_ROWS: Final = 10_001  # of a run that is copied out of memory that the next run reuses

Tell = Callable[[float], None]


@dataclass(frozen=True, repr=False)
class Run(Record):
    """A simulated trajectory with the methods for users.

    `signals` are computed when they are first read. So are `peaks`, `ise` and `settling_s` of a short run,
    by repeating the same steps: states and switches alone take three quarters of the loop's time.
    """

    if not TYPE_CHECKING:  # for the type checker, all fields exist

        def __getattr__(self, name: str) -> Any:
            """Compute a field that is read for the first time."""
            if name not in {field.name for field in fields(self)} or "_deferred" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            self.__dict__.update(self._deferred(name))
            return self.__dict__[name]

    def __getstate__(self) -> dict[str, Any]:
        """Return every field: kernels belong to one process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The contents of ``summary.json``."""
        return summarise(self)

    def _repr_html_(self) -> str:
        """Show the run in a notebook: a table, and the overview as a picture."""
        from pmjoint_codegen.simulate.shown import html

        return html(self)

    def to_csv(self, path: str | Path) -> None:
        """Write ``trajectory.csv``, atomically; raises `UsageError` if that is impossible."""
        from pmjoint_codegen.logs.text import write
        from pmjoint_codegen.storage import writing

        trajectory = trajectory_of(self)
        with writing(Path(path)) as stream:
            write(trajectory, stream)

    def save(self, path: str | Path) -> None:
        """Write the trajectory, atomically, as the path's ending says.

        ``.csv``; ``.parquet`` for PlotJuggler and data frames; ``.mat`` for MATLAB and GNU Octave; ``.mcap``
        for Foxglove. All but the first have the unit and the meaning of every column, the model's hash, the
        parameters and the summary inside. The same run has the same bytes.

        Raises:
            UsageError: another ending, or a file that cannot be written.
            MissingToolError: the format's package, of the extra ``logs``, is not installed.
        """
        save(lambda: trajectory_of(self), Path(path))

    def to_dataframe(self) -> pd.DataFrame:
        """The trajectory as a table of pandas; raises `MissingToolError` without it."""
        from pmjoint_codegen.simulate.tables import dataframe

        return dataframe(self)

    def to_xarray(self) -> xr.Dataset:
        """The trajectory as a dataset of xarray; raises `MissingToolError` without it."""
        from pmjoint_codegen.simulate.tables import dataset

        return dataset(self)

    @overload
    def plot(self, ax: None = None, signals: str | Sequence[str] | None = None) -> Figure: ...
    @overload
    def plot(self, ax: Axes, signals: str | Sequence[str] | None = None) -> Axes: ...
    def plot(self, ax: Axes | None = None, signals: str | Sequence[str] | None = None) -> Figure | Axes:
        """Draw an overview of the run, or chosen signals.

        Args:
            ax: axes of a figure of your own to draw onto, by default y and y_r; None: a new figure.
            signals: names of columns, with a comma between them or as a sequence. In a new figure each entry
                has its own axes: a column, ``x1-x_hat1``, or several of one unit, ``y+y_r``. On axes given,
                all entries are drawn together and have one unit.

        Returns:
            The new figure, or the axes that were given.

        Raises:
            UsageError: a column that there is not, or several units on one pair of axes.
        """
        from pmjoint_codegen.simulate.chosen import chosen_panels
        from pmjoint_codegen.simulate.figures import chosen_figure, draw_onto, overview

        chosen = signals.split(",") if isinstance(signals, str) else signals
        if ax is not None:
            together = "+".join(chosen) if chosen is not None else "y+y_r"
            draw_onto(ax, self, chosen_panels(self, [together])[0])
            return ax
        return overview(self) if chosen is None else chosen_figure(self, chosen)


@dataclass(frozen=True)
class _Preparation:
    """Data shared by runs that differ only in x0.

    Attributes:
        key: the settings they have in common.
        problem: constants of a run.
        actuator: its modes.
        columns: parameters by name, each of shape (1,).
        done: the message that the horizon is reached.
        spare: loops of short runs that are not in use; a thread takes one, or makes another.
    """

    key: tuple[object, ...]
    problem: Problem
    actuator: Actuator
    columns: Mapping[str, Array]
    done: str
    spare: deque[tuple[CompiledLoop, Progress, Memory]]


class Simulator:
    """Runs of one model, which share their constants. Several threads may use it.

    Attributes:
        evaluator: of the model's kernels.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator
        self._last: _Preparation | None = None

    @cached_property
    def _checked(self) -> Callable[..., Settings]:
        own = make_settings(self.evaluator.manifest)
        return lru_cache(maxsize=1, typed=True)(partial(make_settings, self.evaluator.manifest, own))

    def settings(self, **asked: Unpack[RunOptions]) -> Settings:
        """Complete a run's settings, or return those of the previous call if it was the same."""
        if asked.get("reference") is not None:  # compared by its numbers, not as an object
            return self._checked.__wrapped__(**asked)  # type: ignore[attr-defined, no-any-return]
        try:
            return self._checked(**asked)
        except TypeError:  # an object without a hash may have changed since
            return self._checked.__wrapped__(**asked)  # type: ignore[attr-defined, no-any-return]

    def run(self, settings: Settings, progress: Tell | None = None) -> Run:
        """Simulate the closed loop; see `run`."""
        begun = time.perf_counter()
        prepared = self._prepared(settings)
        start = make_start(self.evaluator, settings, prepared.columns)
        known = self._short(prepared, start) or self._whole(prepared, start, settings, progress)
        if progress is not None and "peaks" not in known:
            progress(1.0)
        made = Run.__new__(Run)  # its other fields are computed when read
        made.__dict__.update(
            known,
            manifest=self.evaluator.manifest,
            settings=settings,
            evaluator=self.evaluator.kind,
            wall_s=time.perf_counter() - begun,
        )
        return made

    def _prepared(self, settings: Settings) -> _Preparation:
        """The data of the last run if this one differs only in x0; else new data."""
        reference = settings.reference and settings.reference.command.hash
        key = (settings.p.tobytes(), reference, *SHARED(settings))
        prepared = self._last
        if prepared is None or prepared.key != key:
            actuator = actuator_of(self.evaluator, settings.p)
            problem = make_problem(self.evaluator, settings, actuator)
            problem.times.flags.writeable = False  # many runs return them
            columns = columns_of(settings)
            done = _message(self.evaluator.manifest, settings, Status.DONE, problem.horizon)
            prepared = self._last = _Preparation(key, problem, actuator, columns, done, deque())
        return prepared

    def _short(self, prepared: _Preparation, start: Array) -> dict[str, Any] | None:
        """A continuous run of few steps and rows, with only states and switches; None if it is not one."""
        problem = prepared.problem
        if problem.n_rows > FEW_ROWS or problem.sample_time or self.evaluator.kind != "compiled":
            return None
        try:
            loop, state, memory = prepared.spare.pop()
        except IndexError:
            loop, state, memory = _bare_loop(self.evaluator, problem)
        loop.restart(start)
        loop(BUDGET)
        known = None  # any other ending is reported by the whole run
        if state.status == Status.DONE:
            known = self._known(prepared, start, memory.rows.copy(), memory, state)
        prepared.spare.append((loop, state, memory))
        return known

    def _whole(
        self, prepared: _Preparation, start: Array, settings: Settings, progress: Tell | None
    ) -> dict[str, Any]:
        """Any run, with its figures."""
        manifest = self.evaluator.manifest
        memory, state = _integrate(self.evaluator, start, prepared.problem, progress)
        known = self._known(prepared, start, memory.rows[: state.row], memory, state)
        status = Status(state.status)
        kink = state.touching - (0 if prepared.problem.sample_time else prepared.problem.n_thresholds)
        ended = {"status": status, "message": _message(manifest, settings, status, state.t, memory, kink)}
        return {**known, **_figures(manifest, memory, state, prepared.problem.horizon), **ended}

    def _known(
        self, prepared: _Preparation, start: Array, rows: Array, memory: Memory, state: Progress
    ) -> dict[str, Any]:
        """The immediate fields of a run that reached its horizon, and the source of the rest."""
        rows.flags.writeable = False  # signals are computed from them, perhaps later
        evaluator, problem = self.evaluator, prepared.problem
        holds = Holds.of(memory, state)

        def deferred(name: str) -> dict[str, Any]:
            if name == "signals":
                return {name: signals_of(evaluator, problem, rows, memory, holds)}
            return _figures(evaluator.manifest, *_integrate(evaluator, start, problem, None), problem.horizon)

        return {
            "status": Status.DONE,
            "message": prepared.done,
            "t": problem.times[: state.row],
            "states": rows,
            "switches": switches_of(prepared.actuator, memory, state),
            "initial_mode": prepared.actuator.labels[state.first_mode],
            "sticks": holds.intervals(),
            "steps": state.steps,
            "_deferred": deferred,
        }


def run(evaluator: Evaluator, settings: Settings, progress: Tell | None = None) -> Run:
    """Simulate the closed loop.

    Args:
        evaluator: of the model's kernels.
        settings: of the run.
        progress: called periodically with the fraction completed, from 0 to 1.

    Returns:
        The run, whether it reached its horizon or not: see `Run.status`.
    """
    return Simulator(evaluator).run(settings, progress)


def make_problem(evaluator: Evaluator, settings: Settings, actuator: Actuator) -> Problem:
    """Assemble the constants of a run."""
    manifest = evaluator.manifest
    sampled = settings.controller == "sampled"
    chained = sampled and is_looped(manifest)
    chain = make_chain(manifest, settings.parameters, settings.sample_time) if chained else None
    times = settings.times()
    breaks, segments = inside(settings.reference, settings.horizon)
    return Problem(
        **fixed_constants(manifest, sampled=sampled, tolerance=settings.tolerance),
        n_thresholds=len(actuator.thresholds),
        thresholds=actuator.thresholds,
        modes=actuator.modes,
        p=settings.p,
        breaks=breaks,
        segments=segments,
        n_breaks=len(breaks),
        n_segment=segments.shape[1],
        hold=hold_matrices(evaluator, settings.p, settings.sample_time) if sampled else np.empty(0),
        chain=chain.vector() if chain else np.empty(0),
        limits=actuator.limits,
        n_history=chain.history if chain else 0,
        max_step=settings.max_step,
        times=times,
        n_rows=len(times),
        sample_time=settings.sample_time if sampled else 0.0,
        divergence=settings.divergence,
        reach=reach_of(manifest, settings.divergence),
        max_steps=settings.max_steps,
        max_switches=settings.max_switches,
    )


def _integrate(
    evaluator: Evaluator, start: Array, problem: Problem, progress: Tell | None
) -> tuple[Memory, Progress]:
    """Run the loop to its end, first with room for few switches: large arrays cost more than a run."""
    few = replace(problem, max_switches=min(problem.max_switches, FEW_SWITCHES))
    for given in map(own_parameters, (few, problem)):
        memory, state = make_memory(given, start), Progress()
        _drive(make_loop(evaluator, given, state, memory), given, state, progress)
        if state.status != Status.TOO_MANY_SWITCHES or given.max_switches == problem.max_switches:
            break
    return memory, state


def _bare_loop(evaluator: Evaluator, problem: Problem) -> tuple[CompiledLoop, Progress, Memory]:
    """A loop of states and switches only, with room for few of them: large arrays cost more than a run."""
    few = min(problem.max_switches, FEW_SWITCHES)
    bare = own_parameters(replace(problem, n_nodes=0, n_searched=0, notes_rate=0, max_switches=few))
    memory, state = make_memory(bare, np.zeros(problem.n_states)), Progress()
    return cast(CompiledLoop, make_loop(evaluator, bare, state, memory)), state, memory


def _drive(advance: Advance, problem: Problem, state: Progress, tell: Tell | None) -> None:
    """Advance until the run ends, in several calls: Ctrl-C takes effect between two of them."""
    while state.status == Status.RUNNING:
        advance(BUDGET)
        if tell is not None:
            tell(min(state.t / problem.horizon, 1.0))


def _settling(state: Progress, horizon: float) -> float | None:
    """The settling time; None of a run that ended early, starts without an error, or has not settled."""
    known = state.band > 0.0 and state.status == Status.DONE and state.settled < last_exit(horizon)
    return state.settled if known else None


def _figures(manifest: Manifest, memory: Memory, state: Progress, horizon: float) -> dict[str, Any]:
    names = [*(item.name for item in manifest.states), "v", "e", *([RATE] if reports_rate(manifest) else [])]
    pairs = zip(memory.peaks.tolist(), memory.peak_times.tolist(), strict=True)
    return {
        "peaks": dict(zip(names, pairs, strict=False)),  # the last entry may be unused
        "ise": state.integral,
        "settling_s": _settling(state, horizon),
    }


def _message(
    manifest: Manifest,
    settings: Settings,
    status: Status,
    t: float,
    memory: Memory | None = None,
    kink: int = -1,
) -> str:
    largest = int(np.argmax(memory.peaks[: manifest.nX])) if memory else 0  # the one that passed the limit
    return sentence(
        status,
        t=t,
        divergence=settings.divergence,
        max_steps=settings.max_steps,
        max_switches=settings.max_switches,
        state=manifest.states[largest].name,
        kink=manifest.kinks[kink % len(manifest.kinks)] if manifest.kinks else "",  # that which it is on
    )
