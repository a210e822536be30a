"""The batch loops of ``loops/c_batch``, compiled with a model's ``lanes.c`` for this machine's vectors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.compile.library import FLAGS, build
from pmjoint_codegen.errors import BuildError, StaleError
from pmjoint_codegen.identity import canonical_hash
from pmjoint_codegen.kernels.declarations import MODULE, declarations, load_library, to_module
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.kernels.processor import Level
from pmjoint_codegen.loops.chain import longest_history
from pmjoint_codegen.loops.guard import HOLD_RATIOS, discs, hold_factors
from pmjoint_codegen.loops.logits import reach_of
from pmjoint_codegen.loops.metrics import Column, rows_header
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.storage import sha256_file
from pmjoint_codegen.values import SETTLED

HEADER: Final = "pmjoint_batch.h"
ROWS: Final = "metric_rows.h"  # made from the table of metrics
GENERATED: Final = ("lanes.c", "lanes.h")

Controller = Literal["continuous", "sampled"]


@dataclass(frozen=True)
class Runs:
    """Many runs to compute.

    Attributes:
        x0: shape (runs, nX), X(0).
        p: shape (runs, np), parameters.
        horizon: s.
        tolerance: local error, relative to max(1, |value|).
        sample_time: s; 0 for the continuous controller.
        hold: shape (runs or 1, nh), matrices of the zero-order hold, for the sampled controller.
        times: output instants of trajectories, s, ascending from 0 to the horizon; empty for none.
        divergence: |X_i| above it ends a run.
        max_steps: limit of steps of one run.
        max_step: longest step, s.
        breaks: instants at which the reference's next segment begins, s, inside the runs.
        segments: shape (breaks + 1, entries), what ends p on each; empty for an expression.
        chain: shape (runs, 13), sensor, actuator and clock; see `loops.chain`; empty for none.
        looped: whether the sampled loop acts on them.
    """

    x0: Array
    p: Array
    horizon: float
    tolerance: float
    sample_time: float
    hold: Array
    times: Array
    divergence: float
    max_steps: int
    max_step: float = math.inf
    breaks: Array = field(default_factory=lambda: np.empty(0))
    segments: Array = field(default_factory=lambda: np.empty((0, 0)))
    chain: Array = field(default_factory=lambda: np.empty((0, 0)))
    looped: bool = False


@dataclass(frozen=True)
class Outcome:
    """The results of the runs.

    Attributes:
        metrics: shape (runs, metrics), columns as in `Column`.
        final: shape (runs, nX), X at the horizon or where the run ended.
        trajectories: shape (runs, times, nX + 2): X, v, e; NaN after a run has ended.
    """

    metrics: Array
    final: Array
    trajectories: Array


@dataclass(frozen=True)
class StepRules:
    """How steps and holds of a batch are checked against the right-hand side; see `guard`.

    Attributes:
        lebesgue: factor on the largest defect found at the points of comparison.
        inside: these points, as fractions of a step, besides its end.
        ratios: radii of discs, as multiples of a step.
        factors: bound on a step's error, as multiples of the nonlinear part on the disc.
        hold_ratios: the same for holds that need no point of comparison.
        hold_rate_factors: for their rates.
        hold_value_factors: for their values.
    """

    lebesgue: float
    inside: Array
    ratios: Array
    factors: Array
    hold_ratios: Array
    hold_rate_factors: Array
    hold_value_factors: Array


def step_rules(manifest: Manifest, runs: Runs) -> StepRules:
    """The rules for the runs' controller at their tolerance."""
    rule = manifest.guards["plant_lanes" if runs.sample_time else "taylor_lanes"]
    around, order = discs(rule, runs.tolerance), manifest.hold_order
    arrays = (
        rule.inside,
        around.ratios,
        around.factors,
        HOLD_RATIOS,
        hold_factors(order),
        hold_factors(order + 1),
    )
    return StepRules(rule.lebesgue, *(np.array(values, dtype=np.float64) for values in arrays))


class BatchLibrary:
    """A loaded library; its method may be called from several threads at once.

    Attributes:
        manifest: the model.
        level: vector instructions that it was built for.
    """

    def __init__(self, manifest: Manifest, level: Level, ffi: Any, lib: Any) -> None:
        self.manifest = manifest
        self.level = level
        self._ffi = ffi
        self._lib = lib

    @property
    def width(self) -> int:
        """Trajectories side by side."""
        return int(self._lib.pmj_width())

    def simulate(self, runs: Runs) -> Outcome:
        """Compute the runs; the interpreter's lock is released meanwhile."""
        count, size = runs.x0.shape
        rows = len(runs.times)
        outcome = Outcome(
            metrics=np.empty((count, len(Column))),
            final=np.empty((count, size)),
            trajectories=np.empty((count, rows, size + 2)),
        )
        waiting = longest_history(runs.chain) if runs.looped else 0
        history = np.zeros(waiting * self.manifest.nw * self.width)
        names = ("x0", "p", "hold", "times", "breaks", "segments", "chain")
        reach = reach_of(self.manifest, runs.divergence)
        arrays = {**{name: getattr(runs, name) for name in names}, "history": history, "reach": reach}
        inputs = {name: self._pointer(array) for name, array in arrays.items()}
        sweep = self._ffi.new("pmj_sweep *", {name: value for name, value in inputs.items() if len(value)})
        sweep.runs, sweep.rows = count, rows
        sweep.n_breaks, sweep.n_segment = len(runs.breaks), runs.segments.shape[1]
        sweep.looped, sweep.n_history = int(runs.looped), waiting
        sweep.hold_stride = runs.hold.shape[1] if len(runs.hold) > 1 else 0
        kept = self._set_rules(sweep, runs)
        sweep.settled = SETTLED
        for name in ("horizon", "sample_time", "tolerance", "max_step", "divergence", "max_steps"):
            setattr(sweep, name, getattr(runs, name))
        wanted = {
            name: self._pointer(getattr(outcome, name)) for name in ("metrics", "final", "trajectories")
        }
        results = self._ffi.new(
            "pmj_results *", {name: value for name, value in wanted.items() if len(value)}
        )
        if count and kept:
            (self._lib.pmj_sampled_batch if runs.sample_time else self._lib.pmj_continuous_batch)(
                sweep, results
            )
        return outcome

    def matrices(self, p: Array) -> Array:
        """A0 of (14) and Ar of (23), each row by row, for every row of p; shape (runs, their sizes)."""
        matrices = map(self.manifest.function, ("filter_matrix", "compensator_matrix"))
        result = np.empty((len(p), sum(size for item in matrices for _, size in item.outputs)))
        if len(p):
            self._lib.pmj_matrices(len(p), self._pointer(p), self._pointer(result))
        return result

    def starts(self, y: Array, p: Array) -> Array:
        """The controller's state matched to y(0), shape (runs, ns).

        Args:
            y: y(0), shape (runs,).
            p: parameters, shape (runs, np).
        """
        result = np.empty((len(p), self.manifest.nX - self.manifest.nx))
        if len(p):
            arrays = (np.ascontiguousarray(y), p, result)
            self._lib.pmj_starts(len(p), *(self._pointer(array) for array in arrays))
        return result

    def _set_rules(self, sweep: Any, runs: Runs) -> list[Any]:
        """Fill in the rules of steps; the pointers live as long as the result."""
        rules = step_rules(self.manifest, runs)
        sweep.rule.lebesgue = rules.lebesgue
        sweep.rule.n_inside, sweep.rule.n_ratios = len(rules.inside), len(rules.ratios)
        sweep.hold_rule.n_ratios = len(rules.hold_ratios)
        places = (
            (sweep.rule, "inside", rules.inside),
            (sweep.rule, "ratios", rules.ratios),
            (sweep.rule, "factors", rules.factors),
            (sweep.hold_rule, "ratios", rules.hold_ratios),
            (sweep.hold_rule, "factors", rules.hold_rate_factors),
            (sweep, "hold_value_factors", rules.hold_value_factors),
        )
        kept = [self._pointer(array) for _, _, array in places]
        for (struct, name, _), pointer in zip(places, kept, strict=True):
            setattr(struct, name, pointer)
        return kept

    def _pointer(self, array: Array) -> Any:
        return self._ffi.from_buffer("double[]", array)


def batch_sources(folder: Path) -> dict[str, bytes]:
    """All sources to compile: a model's generated lanes, and the package's own loops.

    Raises:
        StaleError: a generated file is missing.
    """
    paths = [*(folder / name for name in GENERATED), *_loops()]
    try:
        return {ROWS: rows_header().encode(), **{path.name: path.read_bytes() for path in paths}}
    except OSError as error:
        raise StaleError(
            f"{error.filename} cannot be read", where=str(folder), remedy="run pmjoint regenerate"
        ) from None


def loops_hash() -> str:
    """Hash of the package's own loops and their flags: with a model's lanes, they determine the result."""
    return canonical_hash([FLAGS, rows_header(), {path.name: sha256_file(path) for path in _loops()}])


def _loops() -> list[Path]:
    here = Path(__file__).parent
    shared = [
        here / "c" / name
        for name in ("polynomial.c", "pmjoint_chain.h", "pmjoint_constants.h", "pmjoint_runtime.h")
    ]
    return [*sorted((here / "c_batch").glob("*.[ch]")), *shared]


@dataclass(frozen=True)
class Target:
    """A compiled library.

    Attributes:
        folder: of the build.
        level: vector instructions that it was built for.
    """

    folder: Path
    level: Level


def level_flags(level: Level) -> tuple[str, ...]:
    """The compiler's flags for code that works on vectors of a level."""
    return (*FLAGS, *level.flags, f"-DPMJ_WIDTH={level.width}")


def compile_batch(
    sources: Mapping[str, bytes], levels: Sequence[Level], compiler: Compiler, cache: Path
) -> Target:
    """Build the batch loops, or reuse a build.

    Args:
        sources: as `batch_sources` gives them.
        levels: what this machine can run, the widest first; if a compiler does not know one, the next is
            tried.
        compiler: to build with.
        cache: folder for builds.

    Raises:
        BuildError: the compiler failed at the last level.
        UsageError: the cache cannot be written.
    """

    def extras() -> Mapping[str, bytes]:
        return {MODULE: to_module(declarations("", sources[HEADER].decode(), [])).encode()}

    for level in levels:
        try:
            return Target(build(sources, compiler, cache, extras, level_flags(level)), level)
        except BuildError:
            if level is levels[-1]:
                raise
    raise AssertionError("levels end with one that runs everywhere")


def load(
    sources: Mapping[str, bytes], manifest: Manifest, levels: Sequence[Level], compiler: Compiler, cache: Path
) -> BatchLibrary:
    """Build the batch loops of a model, or reuse a build, and load them: see `compile_batch`.

    Raises:
        BuildError: the compiler failed at the last level, or its output cannot be loaded here.
        UsageError: the cache cannot be written.
    """
    target = compile_batch(sources, levels, compiler, cache)
    return BatchLibrary(manifest, target.level, *load_library(target.folder))
