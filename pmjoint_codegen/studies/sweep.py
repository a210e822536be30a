"""A sweep in one call, for scripts and for ``pmjoint sweep``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.provision import Provided
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.simulate.settings import CommandOptions
from pmjoint_codegen.studies.model import Model, Subject, subject_of
from pmjoint_codegen.studies.spec import Grid, Samples, grid_texts, sample_texts
from pmjoint_codegen.studies.watch import Notify, Report, Watch, counting, processors, to_stderr, unwatched
from pmjoint_codegen.sweep.build_inputs import make_inputs
from pmjoint_codegen.sweep.dataset import assemble, import_ahead, read
from pmjoint_codegen.sweep.executor import execute
from pmjoint_codegen.sweep.formats import export, require
from pmjoint_codegen.sweep.pace import too_fast_runs
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.repair import find_damage, mend
from pmjoint_codegen.sweep.request import Request, make_request
from pmjoint_codegen.sweep.store import Store

if TYPE_CHECKING:
    import xarray as xr

_SHOWN: Final = 3  # damaged files that a message names
_KIND: Final = "pmjoint-sweep"  # of a folder that is gone after the call


@dataclass(frozen=True)
class Study:
    """A sweep that is checked, and not yet computed.

    Attributes:
        provided: the model's kernels.
        request: the sweep.
        subject: the model as it was given.
    """

    provided: Provided
    request: Request
    subject: Subject

    __repr__ = brief

    @property
    def warning(self) -> str | None:
        """One line about runs whose law is too fast for their clock; None if there are none."""
        return too_fast_runs(self.provided.manifest, self.request)

    @contextmanager
    def computed(
        self,
        folder: Path,
        *,
        threads: int | None = None,
        scheduler: str | None = None,
        restart: bool = False,
        watch: Watch = unwatched,
        notify: Notify = to_stderr,
    ) -> Iterator[Store]:
        """Compute the sweep in a folder, or what is missing there; the folder is locked during the block.

        Args:
            folder: of the results.
            threads: to compute with; None: all processors.
            scheduler: address of a Dask scheduler to compute on instead.
            restart: discard what is in the folder.
            watch: shows the stages.
            notify: called with one-line messages.

        Yields:
            The folder, with the dataset.

        Raises:
            MissingToolError: no compiler, or a package is not installed.
            BuildError: the compiler failed.
            SimulationError: the connection to the scheduler was lost; what is done is kept.
            UsageError: the folder holds another sweep, is in use, or cannot be written.
        """
        store = Store(folder, self.request, self.provided.manifest.nX)
        work = _Work(self, store, threads or processors(), scheduler, watch, notify)
        with store.alone():
            work.compute(restart=restart)
            with watch("writing the dataset"):
                if not store.dataset.exists():
                    assemble(store, self.provided.manifest)
            yield store


@dataclass(frozen=True)
class _Work:
    """The stages of a sweep in one folder."""

    study: Study
    store: Store
    threads: int
    scheduler: str | None
    watch: Watch
    notify: Notify

    def compute(self, *, restart: bool) -> None:
        """Compute what is missing or damaged, and report it."""
        store, manifest = self.store, self.study.provided.manifest
        store.open(restart=restart)
        if not store.dataset.exists():
            with self.watch("reading the finished runs"):
                missing = store.missing()
                damaged = store.damaged(missing)
            self._tell_damage(damaged, missing)
            self._simulate(missing)
            return
        with self.watch("reading the dataset"):
            damage = find_damage(store, manifest)
        if damage.files:
            self._tell_damage([store.dataset / name for name in damage.files], damage.starts)
            self._simulate(damage.starts)
            with self.watch("repairing the dataset"):
                mend(store, manifest, damage)

    def _tell_damage(self, files: Sequence[Path], starts: Sequence[int]) -> None:
        """Report which files were removed or altered, and how many runs that costs."""
        if files:
            folder = self.store.folder
            some = ", ".join(str(path.relative_to(folder)) for path in files[:_SHOWN])
            more = f" and {len(files) - _SHOWN} more" if len(files) > _SHOWN else ""
            runs = sum(self.store.length(start) for start in starts)
            self.notify(f"{folder}: removed or altered: {some}{more}; computing {runs} runs")

    def _simulate(self, starts: Sequence[int]) -> None:
        """Compute these chunks; say how to resume after an interruption."""
        store, total = self.store, self.store.request.plan.runs
        inputs = make_inputs(self.study.provided.folder)
        import_ahead()
        try:
            with self.watch(f"simulating {total} runs", total=total, unit="runs") as progress:
                execute(
                    store,
                    inputs,
                    threads=self.threads,
                    scheduler=self.scheduler,
                    tell=lambda done: progress(done / total),
                    starts=starts,
                )
        except KeyboardInterrupt:
            kept = f"{store.done()} of {total} runs are kept in {store.folder}"
            self.notify(f"{kept}; the same command resumes there")
            raise


def make_study(
    model: Model,
    *,
    grid: Grid | None = None,
    sample: Samples | None = None,
    runs: int | None = None,
    seed: int = 0,
    method: str = "latin-hypercube",
    reference: object = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    formats: Sequence[str] = (),
    scheduler: str | None = None,
    environment: Mapping[str, str] | None = None,
    notify: Notify = to_stderr,
    **asked: Unpack[CommandOptions],
) -> Study:
    """Check a sweep before it is computed; arguments and errors are those of `sweep`."""
    require((*formats, *(["dask"] if scheduler is not None else [])))
    plan = make_plan(grid_texts(grid), sample_texts(sample, "sample"), runs, seed, method)
    if saturation not in (None, "clip") and asked.get("compensator") is False:
        raise UsageError(
            f"is {saturation!r}, and compensator is False", where="saturation", remedy="give one of them"
        )
    subject = subject_of(model, reference, disturbance or None, saturation, environment)
    provided = subject.provide(notify, saturation=plan.saturation)
    return Study(provided, make_request(provided.manifest, plan, **subject.runs, **asked), subject)


def sweep(
    model: Model,
    *,
    grid: Grid | None = None,
    sample: Samples | None = None,
    runs: int | None = None,
    seed: int = 0,
    method: str = "latin-hypercube",
    reference: object = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    out: str | Path | None = None,
    formats: Sequence[str] = (),
    threads: int | None = None,
    scheduler: str | None = None,
    restart: bool = False,
    environment: Mapping[str, str] | None = None,
    progress: Report | None = None,
    notify: Notify = to_stderr,
    **asked: Unpack[CommandOptions],
) -> xr.Dataset:
    """Simulate a model many times over, on a grid, with random values, or both, as ``pmjoint sweep`` does.

    The dataset has a dimension per axis, ``draw`` for random values, a variable per result of a run, and
    units, seed, hashes and versions as attributes. The same arguments have the same numbers, for any number
    of threads.

    Args:
        model: name, path of a model file, or a loop made by `ClosedLoop.load`.
        grid: axes, which multiply: ``{"x1": np.linspace(-100, 100, 201), "c1": "5:25:21"}``, or texts as on
            the command line, ``["c1=5:25:21"]``.
        sample: random values: ``{"b0": "normal(2, 0.2)"}``, or ``["b0~normal(2,0.2)"]``; the laws are
            normal(MEAN, SD), uniform, loguniform and integers(LOW, HIGH).
        runs: how many draws `sample` makes, on every grid point.
        seed: of the draws.
        method: ``latin-hypercube`` or ``sobol``.
        reference: another y_r, as for `ClosedLoop.simulate`: an expression, data, an array, a function of t.
        disturbance: another disturbance, one expression per state.
        saturation: ``compensator``, ``clip`` or ``braking`` in place of the model's own.
        out: folder of the results, as of the command: ``sweep.zarr``, which is read from there when values
            are needed; the same call resumes what was interrupted. None: the dataset is held in memory alone.
        formats: ``netcdf``, ``parquet``: other files beside ``sweep.zarr``; they need `out`.
        threads: to compute with; None: all processors.
        scheduler: address of a Dask scheduler to compute on instead.
        restart: discard what is in `out`.
        environment: for compiler and cache folder; the process's own by default.
        progress: called periodically with the fraction completed.
        notify: called with one-line messages.
        asked: settings of every run, as for `ClosedLoop.simulate`: horizon, parameters, x0, controller,
            sample_time, compensator, start, tolerance (1e-6 by default), max_step, divergence;
            ``output_step`` keeps trajectories too, a row every so many seconds.

    Raises:
        UsageError: a setting is unknown or out of range, nothing is varied, or the folder cannot be used.
        ModelError: the model cannot be found, read or derived.
        MissingToolError: no C compiler, or a package of the extra ``sweep`` is not installed.
        BuildError: the compiler failed.
    """
    if formats and out is None:
        raise UsageError("are files beside sweep.zarr", where="formats", remedy="give a folder, out=...")
    study = make_study(
        model,
        grid=grid,
        sample=sample,
        runs=runs,
        seed=seed,
        method=method,
        reference=reference,
        disturbance=disturbance,
        saturation=saturation,
        formats=formats,
        scheduler=scheduler,
        environment=environment,
        notify=notify,
        **asked,
    )
    if study.warning:
        notify(study.warning)

    def made(folder: Path) -> xr.Dataset:
        with study.computed(
            folder,
            threads=threads,
            scheduler=scheduler,
            restart=restart,
            watch=counting(progress),
            notify=notify,
        ) as store:
            for kind in formats:
                export(store.dataset, kind)
            return read(store.dataset) if out is not None else read(store.dataset).load()

    if out is not None:
        return made(Path(out))
    with scratch(_KIND) as folder:
        return made(folder / "sweep")
