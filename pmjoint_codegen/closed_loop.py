"""The front door for scripts: load a model's closed loop, simulate it, evaluate its control law."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.compile.compiler import LOOKED_FOR, find_compiler, install_line
from pmjoint_codegen.errors import MissingToolError, SimulationError, UsageError
from pmjoint_codegen.kernels.evaluator import Array, PreparingEvaluator
from pmjoint_codegen.kernels.law import Law
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.provision import Source as Source  # its users make loops from it
from pmjoint_codegen.simulate.run import Run, Simulator
from pmjoint_codegen.simulate.settings import RunOptions, Settings

if TYPE_CHECKING:
    from pmjoint_codegen.controller import Controller
    from pmjoint_codegen.margins import Margins
    from pmjoint_codegen.provision import Provided
    from pmjoint_codegen.systems import ControlSystems

Notify = Callable[[str], None]
Stage = Callable[[str, float], None]  # name, part done


def _to_stderr(line: str) -> None:
    if sys.stderr is not None:  # `print` would take None as standard output
        print(line, file=sys.stderr)


def _silent(_line: str) -> None:
    """Print nothing: a copy has nothing new to report."""


@dataclass(frozen=True, repr=False)
class ClosedLoop:
    """A model with its kernels, ready to run.

    It can be pickled and copied: the copy is reloaded from the same model and settings, and reuses the
    build in the cache.

    Attributes:
        evaluator: of the kernels, compiled or interpreted.
    """

    evaluator: PreparingEvaluator

    @classmethod
    def load(
        cls,
        model: str | Path,
        evaluator: str | None = None,
        *,
        reference: str | Mapping[str, Any] | None = None,
        disturbance: Sequence[str] | None = None,
        saturation: str | None = None,
        environment: Mapping[str, str] | None = None,
        notify: Notify = _to_stderr,
        stage: Stage = lambda name, done: None,
    ) -> ClosedLoop:
        """Load a model, building its kernels or reusing the build.

        Args:
            model: name, or path of a model file.
            evaluator: ``compiled``, ``interpreted``, or None: compiled if a compiler is found.
            reference: another y_r, a function of t and parameters; or data, as in a model file:
                ``{"steps": [[0, 0], [1, 0.5]], "filter": 10}``.
            disturbance: another disturbance, one expression per state.
            saturation: ``compensator``, ``clip`` or ``braking`` in place of the model's own.
            environment: for compiler and cache folder; the process's own by default.
            notify: called with a one-line message for the user.
            stage: called with the name of a slow stage and the fraction of it completed.

        Raises:
            ModelError: the model cannot be found, read or derived.
            StaleError: a generated file was edited by hand.
            MissingToolError: ``compiled`` was requested without a compiler, or an extra is not installed.
            BuildError: the compiler failed.
            UsageError: an unknown evaluator.
        """
        if evaluator not in (None, "compiled", "interpreted"):
            raise UsageError(f"is {evaluator!r}", where="evaluator", remedy="allowed: compiled, interpreted")
        source = replace(
            Source.of(model),
            evaluator=evaluator,
            reference=reference,
            disturbance=None if disturbance is None else tuple(disturbance),
            saturation=saturation,
            environment=None if environment is None else dict(environment),
        )
        return cls(evaluator_of(source, notify, stage))

    @property
    def manifest(self) -> Manifest:
        """The model: names, units, defaults, equations."""
        return self.evaluator.manifest

    @property
    def source(self) -> Source | None:
        """What the loop was loaded from; None for kernels that were made otherwise."""
        made = self.evaluator.recipe
        source = made[1][0] if made else None
        return source if isinstance(source, Source) else None

    def simulate(
        self, *, progress: Callable[[float], None] | None = None, **asked: Unpack[RunOptions]
    ) -> Run:
        """Integrate the closed loop; defaults come from the model file.

        Args:
            horizon: s.
            parameters: overrides of parameters and gains, by name, in the units of the model file; ``J`` sets
                the controller's value and, unless ``J_plant`` is given too, the plant's.
            x0: initial states: for a joint theta, theta_dot and, where pressures lag, q1 and q2, which may be
                omitted together; for any other plant its own.
            output_step: s, at most the horizon.
            controller: ``continuous``, or ``sampled`` as on a microcontroller.
            sample_time: s, of the sampled controller, at most the horizon.
            compensator: False: r = 0, plain clipping.
            start: of the controller: ``zero``, or ``matched`` to the measured y(0).
            tolerance: local error, relative to max(1, |value|); by default 1e-10.
            max_step: longest integration step, s.
            divergence: a state beyond it ends the run; by default 1e4, more where a bounded run may need it:
                pressures, a distant start, order 3 or more, |b_m| < 1.
            reference: another y_r, as data: an array of shape (points, 2), t and y, or a pair of arrays; an
                array of one value for every output instant; a function of t, taken at the output instants; or
                a mapping as in a model file, with a filter. A smooth spline passes through these values. The
                first such run of a model whose reference is an expression derives and compiles kernels for
                all data. An expression, such as ``"0.5*sin(2*t)"``, is exact, and derived once for each text.
            progress: called periodically with the fraction completed.

        Raises:
            UsageError: a setting is unknown, of the wrong length, or out of range.
            ModelError: an expression for the reference that cannot be read.
            MissingToolError: a reference that needs a derivation, without the extra ``derive``.
            SimulationError: the run ended early; ``error.run`` is the run so far.
        """
        given = asked.get("reference")
        if isinstance(given, str):
            del asked["reference"]
            return self._for_expression(given).simulate(progress=progress, **asked)
        if given is not None and not self.manifest.segment:
            return self._for_data.simulate(progress=progress, **asked)
        result = self._simulator.run(self._simulator.settings(**asked), progress)
        if result.status != Status.DONE:
            raise SimulationError(result.message, where=self.manifest.name, run=result)
        return result

    def control(
        self,
        state: npt.ArrayLike,
        y: npt.ArrayLike,
        reference: npt.ArrayLike,
        *,
        parameters: Mapping[str, float] | None = None,
    ) -> Array:
        """Evaluate v of (29); leading dimensions broadcast. For single states in sequence, `law` is faster.

        Args:
            state: controller states s = (xi, Xi, lambda, r), shape (..., ns); or a whole closed-loop state X,
                shape (..., nX), of which s is used.
            y: measured output, shape (...).
            reference: y_r and its derivatives up to order rho, shape (..., rho + 1).
            parameters: overrides, by name.

        Returns:
            v in the actuator's unit, shape (...).

        Raises:
            UsageError: an unknown parameter, or shapes that do not fit.
        """
        s = np.asarray(state, dtype=np.float64)
        if s.ndim and s.shape[-1] == self.manifest.nX:
            s = s[..., self.manifest.nx :]
        output = np.asarray(y, dtype=np.float64)[..., np.newaxis]
        p = self._vector(parameters)
        return self.evaluator.call("law", output, s, reference, p, results=("v",))[0][..., 0]

    def law(self, *, parameters: Mapping[str, float] | None = None) -> Law:
        """Prepare v of (29) for single states in sequence: ``law(state, y, reference)`` gives a number.

        Args:
            parameters: overrides, by name.

        Raises:
            UsageError: an unknown parameter.
        """
        return Law(self.evaluator, self._vector(parameters))

    def controller(
        self,
        *,
        sample_time: float | None = None,
        parameters: Mapping[str, float] | None = None,
        compensator: bool | None = None,
        start: str | None = None,
        reference: object = None,
    ) -> Controller:
        """Make the sampled controller, for a plant of your own: one call of its `step` for each sample.

        Args:
            sample_time: T, s; by default the model's.
            parameters: as for `simulate`.
            compensator: as for `simulate`.
            start: as for `simulate`.
            reference: as for `simulate`; a function of t is taken at the model's own output instants, up to
                its horizon.

        Raises:
            UsageError: a setting is unknown or out of range.
        """
        from pmjoint_codegen.controller import Controller

        if isinstance(reference, str):
            return self._for_expression(reference).controller(
                sample_time=sample_time, parameters=parameters, compensator=compensator, start=start
            )
        if reference is not None and not self.manifest.segment:
            return self._for_data.controller(
                sample_time=sample_time,
                parameters=parameters,
                compensator=compensator,
                start=start,
                reference=reference,
            )
        settings = self._simulator.settings(
            controller="sampled",
            sample_time=sample_time,
            parameters=parameters,
            compensator=compensator,
            start=start,
            reference=reference,
        )
        return Controller(self.evaluator, settings)

    def to_control(
        self,
        *,
        parameters: Mapping[str, float] | None = None,
        compensator: bool | None = None,
        start: str | None = None,
        x0: Sequence[float] | Array | None = None,
        notify: Notify = _to_stderr,
    ) -> ControlSystems:
        """The continuous loop as python-control's systems: controller, plant, and both together.

        Args:
            parameters: as for `simulate`; each system's own ``params`` come on top.
            compensator: as for `simulate`.
            start: as for `simulate`.
            x0: as for `simulate`.
            notify: called with a line that names the model's keys that need a clock, if it has any.

        Raises:
            MissingToolError: python-control is not installed.
            UsageError: a setting is unknown or out of range.
        """
        from pmjoint_codegen.systems import make_systems

        prepare = self._continuous(parameters, compensator=compensator, start=start, x0=x0)
        systems = make_systems(self.evaluator, prepare)
        if systems.left_out:
            notify(f"{self.manifest.name}: a continuous loop leaves out {', '.join(systems.left_out)}")
        return systems

    def margins(
        self,
        t: float = 0.0,
        *,
        y_r: float | None = None,
        parameters: Mapping[str, float] | None = None,
        compensator: bool | None = None,
    ) -> Margins:
        """Gain, phase and delay margin of the continuous loop, cut at the plant's input.

        The same as `to_control().margins()`, without python-control.

        Args:
            t: the instant at which the model's reference is taken and a disturbance is frozen, s.
            y_r: another constant reference, in the kernels' unit.
            parameters: as for `simulate`.
            compensator: as for `simulate`.

        Raises:
            UsageError: a setting is unknown, or there are no margins: see `ControlSystems.margins`.
        """
        from pmjoint_codegen.systems import make_open_loop

        prepare = self._continuous(parameters, compensator=compensator)
        return make_open_loop(self.evaluator, prepare).margins(t, y_r, None)

    def _continuous(
        self, parameters: Mapping[str, float] | None, **asked: Any
    ) -> Callable[[Mapping[str, float]], Settings]:
        """What completes settings of a continuous run, with more parameters."""
        settings = partial(self._simulator.settings, controller="continuous", **asked)
        return lambda more: settings(parameters={**(parameters or {}), **more})

    def _vector(self, parameters: Mapping[str, float] | None) -> Array:
        return self._simulator.settings(parameters=parameters).p

    @cached_property
    def _for_data(self) -> ClosedLoop:
        """The same model with kernels for a reference that is data, whatever the numbers."""
        return self._with_reference({"steps": [[0.0, 0.0]]})

    @cached_property
    def _for_expressions(self) -> dict[str, ClosedLoop]:
        """The same model with other expressions for y_r, each derived once."""
        return {}

    def _for_expression(self, text: str) -> ClosedLoop:
        """The same model with another expression for y_r; raises the errors of `load`."""
        if text not in self._for_expressions:
            self._for_expressions[text] = self._with_reference(text)
        return self._for_expressions[text]

    def _with_reference(self, reference: str | Mapping[str, Any]) -> ClosedLoop:
        if self.source is None:
            raise UsageError(
                "these kernels contain an expression of t", where="reference", remedy="use ClosedLoop.load"
            )
        return ClosedLoop(evaluator_of(replace(self.source, reference=reference)))

    @cached_property
    def _simulator(self) -> Simulator:
        return Simulator(self.evaluator)

    def __repr__(self) -> str:
        """Name the model, its kernels and its default run."""
        manifest, simulation = self.manifest, self.manifest.simulation
        data = simulation.command
        reference = simulation.reference if data is None else data.text
        return (
            f"<ClosedLoop of {manifest.name}: order {manifest.n}, relative degree {manifest.rho}, "
            f"{self.evaluator.kind} kernels; by default y_r = {reference}, {simulation.horizon:g} s>"
        )

    def __reduce__(self) -> tuple[type[ClosedLoop], tuple[PreparingEvaluator]]:
        """Pickle and copy without data prepared for runs: it belongs to this process."""
        return ClosedLoop, (self.evaluator,)


def evaluator_of(
    source: Source, notify: Notify = _silent, stage: Stage = lambda name, done: None
) -> PreparingEvaluator:
    """Load the kernels of a model that has been read; raises the errors of `ClosedLoop.load`."""
    from pmjoint_codegen.provision import provide_document

    known = os.environ if source.environment is None else source.environment
    provided = provide_document(
        source.file,
        source.document,
        reference=source.reference,
        disturbance=source.disturbance,
        saturation=source.saturation,
        environment=known,
        notify=notify,
        stage=stage,
    )
    stage("compiling or loading the kernels", 0.0)
    loaded = _evaluator(provided, source.evaluator, known, notify)
    loaded.recipe = evaluator_of, (source,)
    return loaded


def _evaluator(
    provided: Provided, kind: str | None, environment: Mapping[str, str], notify: Notify
) -> PreparingEvaluator:
    compiler = None if kind == "interpreted" else find_compiler(environment, notify)
    if compiler is not None:
        from pmjoint_codegen.kernels import compiled
        from pmjoint_codegen.kernels.processor import usable_levels
        from pmjoint_codegen.workspace import cache_dir

        cache = cache_dir(environment, notify)
        levels = usable_levels(environment)
        return compiled.load(provided.folder, provided.manifest, compiler, cache, levels)
    if kind == "compiled":
        raise MissingToolError(
            f"no C compiler was found ({LOOKED_FOR})", remedy=f"install one: {install_line()}"
        )
    if kind is None:
        notify(
            "no C compiler was found, so the kernels run interpreted, slower; "
            f"to compile them: {install_line()}"
        )
    from pmjoint_codegen.kernels import interpreted

    return interpreted.load(provided.folder, provided.manifest)
