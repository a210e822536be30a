"""A tuning in one call, for scripts and for ``pmjoint tune``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

from pmjoint_codegen.brief import brief
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.modelfile.reader import parse_document
from pmjoint_codegen.provision import Provided
from pmjoint_codegen.simulate.settings import CommandOptions
from pmjoint_codegen.storage import ensure_folder, write_bytes
from pmjoint_codegen.studies.model import Model, Subject, subject_of
from pmjoint_codegen.studies.spec import Gains, Samples, gain_texts, sample_texts
from pmjoint_codegen.studies.watch import Notify, Report, Watch, counting, processors, to_stderr, unwatched
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.tune.comparison import Comparison, compare, summary_table, too_fast_plants
from pmjoint_codegen.tune.cost import CostFunction
from pmjoint_codegen.tune.request import Request, make_request
from pmjoint_codegen.tune.rewrite import rewrite
from pmjoint_codegen.tune.search import search
from pmjoint_codegen.workspace import is_stream

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TUNED: Final = "with gains tuned for least"  # in the note at the head of a file that tune writes
_FILE_STEM: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


@dataclass(frozen=True, repr=False)
class Tuned:
    """The result of a tuning.

    Attributes:
        study: what was asked for.
        costing: simulates designs, for the figure.
        comparison: the model's own gains and those found, on every plant.
    """

    study: Study
    costing: CostFunction
    comparison: Comparison

    @property
    def gains(self) -> Mapping[str, float]:
        """The gains found, for ``parameters`` of `ClosedLoop.simulate`."""
        return self.comparison.found.gains

    @property
    def cost(self) -> float:
        """The objective with these gains, over all plants."""
        return self.comparison.found.cost

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The same as ``pmjoint tune --json`` prints: gains and metrics, before and after."""
        return summary_table(self.comparison)

    @property
    def warning(self) -> str | None:
        """One line if the gains are too fast for the clock; None if they are not."""
        return too_fast_plants(self.comparison)

    def write(self, path: str | Path) -> Path:
        """Write the model file with these gains, comments kept; its name becomes the model's.

        A start or saturation that was given is written too; a reference is not.

        Raises:
            UsageError: the path is not NAME.toml, is the model itself, exists and was not written by a
                tuning, or cannot be written.
            ModelError: the model file is written in a way that cannot be edited in place, or has changed.
        """
        file, study = Path(path), self.study
        check_target(study.subject, file)
        edited = study.edited(file, self.gains, self._note)
        ensure_folder(file.parent)
        _write_model(edited, file)
        return file

    def plot(self) -> Figure:
        """Draw both designs on every plant."""
        from pmjoint_codegen.tune.figure import draw

        return draw(self.costing, self.comparison)

    @property
    def _note(self) -> str:
        """How the gains were found, in one line."""
        request = self.study.request
        parts = [f"{self.comparison.manifest.name} {_TUNED} {request.objective.text}"]
        if request.max_v is not None:
            parts.append(f"|v| <= {request.max_v:g}")
        if request.count > 1:
            drawn = ", ".join(
                f"{item.name}~{item.law}({item.first:g},{item.second:g})" for item in request.drawn.samples
            )
            parts.append(f"{request.over} of {request.count} plants, {drawn}")
        if self.study.has_task:  # it stays out of the file: a task, not the design
            parts.append(f"y_r = {request.runs.reference}")
        return f"{'; '.join(parts)}; seed {request.seed}"

    def __repr__(self) -> str:
        """The objective before and after, and the gains found."""
        found = self.summary
        both = found["worst" if self.study.request.over == "worst" else "mean"]["objective"]
        gains = ", ".join(f"{name} {value:.6g}" for name, value in self.gains.items())
        return (
            f"<Tuned {found['model']}: {found['objective']} {both['before']:.6g} -> {both['after']:.6g}, "
            f"{found['designs']} designs, seed {found['seed']}\n  {gains}>"
        )


@dataclass(frozen=True)
class Study:
    """A tuning that is checked, and not yet computed.

    Attributes:
        provided: the model's kernels.
        request: the tuning.
        subject: the model as it was given.
        words: keys of the design that options replace: the gains are found for these.
        has_task: whether a reference other than the model's was given.
    """

    provided: Provided
    request: Request
    subject: Subject
    words: Mapping[str, str]
    has_task: bool

    __repr__ = brief

    def edited(self, file: Path, gains: Mapping[str, float], note: str) -> str:
        """The model file's text with these gains; raises `ModelError`."""
        source = self.subject.source.file
        text = source.read_bytes().decode("utf-8-sig")
        if parse_document(text, str(source)) != self.subject.source.document:
            raise ModelError(
                "has changed since it was read",
                where=str(source),
                remedy="repeat the tuning with the new file",
            )
        return rewrite(text, file.stem, gains, note, str(source), self.request.own, self.words)

    def check_edit(self, file: Path) -> None:
        """Edit the file's text as a trial: a search should not end at a file that cannot be edited."""
        own = self.request.own
        self.edited(file, {name: 1.5 * own[name] for name in self.request.space.gains}, "")

    def run(self, *, threads: int | None = None, watch: Watch = unwatched) -> Tuned:
        """Search for the gains; raises the errors of `tune`."""
        with watch("preparing the simulation"):
            library = library_of(make_inputs(self.provided.folder), self.subject.environment)
            costing = CostFunction(library, self.request, threads or processors())
        total = self.request.most_designs
        with watch(f"trying up to {total} designs", total=total, unit="designs") as progress:
            found = search(costing, lambda tried: progress(tried / total))
        return Tuned(self, costing, compare(costing, found))


def check_target(subject: Subject, file: Path) -> None:
    """Refuse, before the search, a file that could not be used or that is the model itself.

    Args:
        subject: the model.
        file: to write its copy to.

    Raises:
        UsageError: the reason.
    """
    source = subject.source.file
    if is_stream(source):
        raise UsageError(
            "is not a file that could be rewritten with other gains",
            where=str(source),
            remedy="save the model as NAME.toml first",
        )
    if file.suffix != ".toml" or not _FILE_STEM.fullmatch(file.stem):
        raise UsageError(
            f"is {str(file)!r}",
            where="--out",
            remedy="allowed: NAME.toml, letters, digits, - and _ in NAME, which becomes the model's name",
        )
    if file.exists() and source.exists() and file.samefile(source):
        raise UsageError("is the model itself", where=f"--out {file}", remedy="give another file")
    if file.is_dir() or (file.exists() and not _is_tuned(file)):
        raise UsageError(
            "exists already, and was not written by tune",
            where=f"--out {file}",
            remedy="give another file",
        )


def _is_tuned(file: Path) -> bool:
    """Whether a file begins with the note that tune writes."""
    with file.open("rb") as stream:
        return f" {_TUNED} ".encode() in stream.readline()


def _write_model(edited: str, file: Path) -> None:
    """Write the model with the gains found, after validating it; whole or not at all."""
    found = parse_document(edited, str(file))
    try:
        from pmjoint_codegen.modelfile import model_of

        model_of(found, str(file))
    except ModuleNotFoundError:  # without the toolchain: only the gains have changed, and they were simulated
        pass
    write_bytes(file, edited.encode())


def make_study(
    model: Model | Subject,
    *,
    gains: Gains | None = None,
    objective: str = "ise",
    max_v: float | None = None,
    perturb: Samples | None = None,
    plants: int | None = None,
    over: str = "worst",
    seed: int = 0,
    generations: int = 60,
    population: int = 8,
    reference: object = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    environment: Mapping[str, str] | None = None,
    notify: Notify = to_stderr,
    **asked: Unpack[CommandOptions],
) -> Study:
    """Check a tuning before it is computed; arguments and errors are those of `tune`."""
    if over not in ("worst", "mean"):
        raise UsageError(f"is {over!r}", where="over", remedy="allowed: worst, mean")
    subject = subject_of(model, reference, disturbance, saturation, environment)
    provided = subject.provide(notify)
    request = make_request(
        provided.manifest,
        gains=gain_texts(gains),
        objective=objective,
        over=over,
        max_v=max_v,
        perturb=sample_texts(perturb, "perturb"),
        plants=plants,
        seed=seed,
        generations=generations,
        population=population,
        **subject.runs,
        **asked,
    )
    given = {"saturation": subject.source.saturation, "start": asked.get("start")}
    words = {key: word for key, word in given.items() if word is not None}
    task = subject.task is not None or subject.source.reference is not None
    return Study(provided, request, subject, words, task)


def tune(
    model: Model,
    *,
    gains: Gains | None = None,
    objective: str = "ise",
    max_v: float | None = None,
    perturb: Samples | None = None,
    plants: int | None = None,
    over: str = "worst",
    seed: int = 0,
    generations: int = 60,
    population: int = 8,
    reference: object = None,
    disturbance: Sequence[str] | None = None,
    saturation: str | None = None,
    threads: int | None = None,
    environment: Mapping[str, str] | None = None,
    progress: Report | None = None,
    notify: Notify = to_stderr,
    **asked: Unpack[CommandOptions],
) -> Tuned:
    """Choose gains of a model that minimise an objective, as ``pmjoint tune`` does.

    The same seed finds the same gains, for any number of threads. Nothing is written:
    `Tuned.write` writes the model file with the gains found.

    Args:
        model: name, path of a model file, or a loop made by `ClosedLoop.load`.
        gains: what may change: ``{"c": (2, 60), "e1": None}``, bounds by name, None for the default ones; or
            texts as on the command line, ``["c=2:60", "e1"]``. A name is c1, ..., or c, e, ck, k, poles,
            damping for all of a kind. None: c, e, ck and poles, from a fifth to five times the model's.
        objective: a weighted sum of metrics of a run, such as ``ise + 0.01*max_abs_v``.
        max_v: limit of |v| in every run, in v's unit.
        perturb: other plants: ``{"b0": "uniform(1.6, 2.4)"}``, or texts, ``["b0~uniform(1.6,2.4)"]``.
        plants: how many plants `perturb` draws; None: 16.
        over: how the objectives of all plants combine: ``worst`` or ``mean``.
        seed: of the draws and of the search.
        generations: of the search, at most.
        population: designs in a generation, for each gain.
        reference: another y_r, as for `ClosedLoop.simulate`.
        disturbance: another disturbance, one expression per state.
        saturation: ``compensator``, ``clip`` or ``braking`` in place of the model's own.
        threads: to compute with; None: all processors.
        environment: for compiler and cache folder; the process's own by default.
        progress: called periodically with the fraction completed.
        notify: called with one-line messages.
        asked: settings of every run, as for `ClosedLoop.simulate`; the tolerance is 1e-6 by default.

    Raises:
        UsageError: a setting is unknown or out of range, or no design is better than the model's own.
        ModelError: the model cannot be found, read or derived.
        MissingToolError: no C compiler, or SciPy is not installed.
        BuildError: the compiler failed.
    """
    study = make_study(
        model,
        gains=gains,
        objective=objective,
        max_v=max_v,
        perturb=perturb,
        plants=plants,
        over=over,
        seed=seed,
        generations=generations,
        population=population,
        reference=reference,
        disturbance=disturbance,
        saturation=saturation,
        environment=environment,
        notify=notify,
        **asked,
    )
    tuned = study.run(threads=threads, watch=counting(progress))
    if tuned.warning:
        notify(tuned.warning)
    return tuned
