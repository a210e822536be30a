"""The sampled controller, one step at a time, for a plant of the caller's own: hardware or a simulation.

    controller = ClosedLoop.load("paper").controller(sample_time=0.001)
    while running:
        u = controller.step(measured_angle())  # every 0.001 s
        write_to_valve(u)

Its arithmetic is that of ``pmjoint simulate --controller sampled``, bit for bit. Sensor, delays and jitter of
a model file are the bench's part: here the caller's own take their place.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import PmjointError, SimulationError, UsageError, quoted
from pmjoint_codegen.kernels.evaluator import Array, PreparingEvaluator
from pmjoint_codegen.loops.chain import COMMAND, U, make_chain
from pmjoint_codegen.loops.constants import (
    APPLIED_REFUSED,
    GAVE_APPLIED,
    GAVE_REFERENCE,
    READING_REFUSED,
    REFERENCE_REFUSED,
    SAME_INSTANT,
)
from pmjoint_codegen.loops.controller import Layout, Memory, make_steps
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.settings import Settings
from pmjoint_codegen.values import MATCHED

Reference = float | Sequence[float] | Array  # y_r, constant; or with its derivatives up to order rho
_NUMBER: Final = (float, int)  # NumPy's doubles are of the first
_UNUSED: Final = {"delay": 0.0, "samples": 0.0, "jitter": 0.0, "resolution": 0.0, "noise": 0.0}  # the bench's


@dataclass(frozen=True)
class ControllerState:
    """All that a controller's next steps depend on; it can be pickled, and `dataclasses.asdict` suits JSON.

    Attributes:
        model: name of its model.
        sample_time: s.
        sample: index of the next sample.
        values: s, what is held, v, z and alpha, as `pmjoint_codegen.loops.controller.Layout` has them.
        matches: whether the first sample will match the state to its reading.
    """

    model: str
    sample_time: float
    sample: int
    values: tuple[float, ...]
    matches: bool


class Controller:
    """A sampled controller; `ClosedLoop.controller` makes it.

    Controllers are independent of each other: each thread may have its own. Steps of one controller that
    several threads take are done one after the other, in the order in which the threads arrive. It can be
    pickled and copied, with its state.

    Attributes:
        evaluator: of the kernels.
        settings: parameters, sample time, start and reference.
    """

    def __init__(self, evaluator: PreparingEvaluator, settings: Settings) -> None:
        """Prepare a controller at rest, before its first sample.

        Args:
            evaluator: of the kernels.
            settings: of a sampled run; its horizon, output step and x0 are not used.
        """
        manifest, period, p = evaluator.manifest, settings.sample_time, settings.p
        chain = replace(make_chain(manifest, settings.parameters, period), **_UNUSED)
        self.evaluator, self.settings = evaluator, settings
        self._memory = Memory.make(manifest, chain, hold_matrices(evaluator, p, period), p)
        self._steps = make_steps(evaluator, self._memory)
        self._take = self._steps.step
        self._estimate = evaluator.prepare("estimate")
        self._lock = Lock()
        self._layout = Layout.of(manifest)
        # Reading doubles from views takes half the time of arrays.
        self._now: Any = self._memory.now.data
        self._y_r: Any = self._memory.y_r.data
        self._derivatives = range(1, manifest.rho + 1)
        self._command = self._layout.held.start + COMMAND
        self._v = self._layout.v.start
        segments = settings.reference
        self._breaks: list[float] = [] if segments is None else segments.breaks.tolist()
        self.reset()

    def __repr__(self) -> str:
        """Name the model and the clock."""
        with self._lock:
            v = self._now[self._v]
        period = self.settings.sample_time
        return f"<Controller of {self.evaluator.manifest.name}: every {period:g} s, last v {v:.6g}>"

    def step(self, y: float, y_r: Reference | None = None, u_applied: float | None = None) -> float:
        """Take one sample: every `sample_time`, with what is measured now.

        Args:
            y: measured output, in the kernels' unit, as in a run's column ``y``.
            y_r: the reference now and its derivatives up to order rho, shape (rho + 1,); a number is a
                constant reference; None: the model's own at the time of this sample, k T after the first.
            u_applied: what the actuator was really told in the hold that ends now, in u's unit; None: what
                the last step returned. The first step ignores it.

        Returns:
            What to tell the actuator until the next step, in u's unit. It is within the limits and the rate,
            and a dead zone is added to it: column ``u_command`` of a run with a dead zone, else ``u``.

        Raises:
            UsageError: y, y_r or u_applied is not a finite number, or y_r has another length.
            SimulationError: v or the state is no longer a finite number.

        After an error the state is as before: the call can be repeated with other arguments.
        """
        with self._lock:
            if y_r is not None:
                given = GAVE_REFERENCE
                self._give(y_r)
            else:
                given = 0
                if self._breaks:
                    self._enter_segment()
            try:
                if u_applied is None:
                    failed = self._take(y, 0.0, given)
                else:
                    failed = self._take(y, u_applied, given | GAVE_APPLIED)
            except (TypeError, ValueError, OverflowError):
                failed = _refused_type(y)
            if failed:
                raise _error(failed, self.evaluator.manifest.name, y, y_r, u_applied)
            return self._now[self._command]  # type: ignore[no-any-return]  # a view of doubles

    def reset(self, y0: float | None = None, y_r: Reference | None = None) -> None:
        """Begin anew: the next sample is the first, at time 0.

        A model that starts matched takes its first state from y0, or if that is None from the reading of the
        first step; y_r is the reference there, as for `step`. A model that starts at zero uses neither.

        Raises:
            UsageError: y0 or y_r is not a finite number, or y_r has another length.
        """
        matched = self.settings.start == MATCHED
        with self._lock:
            if y0 is None:
                s: Array | None = None
                if y_r is not None:
                    raise UsageError("is given without y0", where="y_r", remedy="give both, or neither")
            else:
                s = self._matched(y0, y_r)
            self._memory.rest()
            if s is not None and matched:
                self._memory.now[: self._layout.n_s] = s
            self._steps.sample = 0
            self._steps.matches = matched and s is None

    @property
    def sample_time(self) -> float:
        """T, s."""
        return self.settings.sample_time

    @property
    def sample(self) -> int:
        """Index of the next sample: the number of steps since the start or the last `reset`."""
        return self._steps.sample

    @property
    def v(self) -> float:
        """V of (29) at the last step, in u's unit; raises `UsageError` before the first."""
        self._check_begun("v")
        return float(self._now[self._v])

    @property
    def u(self) -> float:
        """What of the last command is left beyond a dead zone: the u of filters and compensator.

        Raises:
            UsageError: there was no step yet.
        """
        self._check_begun("u")
        return float(self._now[self._layout.held.start + U])

    @property
    def z(self) -> Array:
        """Errors of (24) at the last step, shape (rho,); raises `UsageError` before the first."""
        self._check_begun("z")
        return self._memory.now[self._layout.z].copy()

    @property
    def x_hat(self) -> Array:
        """State estimate (15) at the last step, shape (n,); raises `UsageError` before the first."""
        self._check_begun("x_hat")
        with self._lock:
            state, parameters = self._estimate.inputs
            state[:], parameters[:] = self._memory.now[: self._layout.n_s], self._memory.p
            self._estimate.run()
            return self._estimate.outputs[0].copy()

    @property
    def s(self) -> Array:
        """Controller states (xi, Xi, lambda, r) at the last step, or at the start, shape (ns,)."""
        return self._memory.now[: self._layout.n_s].copy()

    @property
    def state(self) -> ControllerState:
        """All that the next steps depend on, to be kept, and assigned later to go on from there."""
        with self._lock:
            return ControllerState(
                self.evaluator.manifest.name,
                self.sample_time,
                self._steps.sample,
                tuple(self._memory.now.tolist()),
                self._steps.matches and self._steps.sample == 0,
            )

    @state.setter
    def state(self, state: ControllerState) -> None:
        """Go on from a state; raises `UsageError` if it is that of another model or sample time."""
        if not isinstance(state, ControllerState):
            raise UsageError(f"is {quoted(state)}", where="state", remedy="allowed: a ControllerState")
        mine = (self.evaluator.manifest.name, self.sample_time, self._layout.size)
        other = (state.model, state.sample_time, len(state.values))
        if other != mine:
            raise UsageError(
                f"belongs to {other[0]} at {other[1]:g} s with {other[2]} values",
                where="state",
                remedy=f"allowed: of {mine[0]} at {mine[1]:g} s with {mine[2]} values",
            )
        with self._lock:
            self._memory.now[:] = state.values
            self._steps.sample, self._steps.matches = state.sample, state.matches

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle and copy by evaluator, settings and state: memory of C belongs to one object."""
        return _restored, (self.evaluator, self.settings, self.state)

    def _give(self, y_r: Reference) -> None:
        """Put a reference into memory, a number as a constant one."""
        memory = self._y_r
        try:
            if isinstance(y_r, _NUMBER) or (not isinstance(y_r, tuple) and np.ndim(y_r) == 0):
                memory[0] = y_r
                for i in self._derivatives:
                    memory[i] = 0.0
            elif len(y_r) == len(memory):
                for i, value in enumerate(y_r):
                    memory[i] = value
            else:
                raise ValueError(f"{len(y_r)} values")
        except (TypeError, ValueError):
            raise UsageError(
                f"is {quoted(y_r)}",
                where="y_r",
                remedy=f"allowed: a number, or {len(memory)} numbers: y_r and its derivatives",
            ) from None

    def _enter_segment(self) -> None:
        """Put the segment of the reference's data at this sample into the parameters."""
        segments, memory = self.settings.reference, self._memory
        assert segments is not None
        slack = SAME_INSTANT * self.sample_time
        place = bisect_right(self._breaks, self._steps.sample * self.sample_time + slack)
        memory.p[len(memory.p) - segments.rows.shape[1] :] = segments.rows[place]

    def _matched(self, y0: float, y_r: Reference | None) -> Array:
        """The state matched to a reading and a reference."""
        if not (isinstance(y0, (float, int, np.number)) and np.isfinite(y0)):
            raise _error(READING_REFUSED, "", y0, None, None, reading="y0")
        if y_r is None:
            at = self.evaluator.call("reference", [0.0], self.settings.p)[0]
        else:
            self._give(y_r)
            at = self._memory.y_r.copy()
        if not np.all(np.isfinite(at)):
            raise _error(REFERENCE_REFUSED, "", y0, y_r, None)
        return self.evaluator.call("start", [float(y0)], at, self.settings.p)[0]

    def _check_begun(self, name: str) -> None:
        if self._steps.sample == 0:
            raise UsageError("has no value before the first step", where=name, remedy="call step first")


def _restored(evaluator: PreparingEvaluator, settings: Settings, state: ControllerState) -> Controller:
    """A copy of a controller."""
    controller = Controller(evaluator, settings)
    controller.state = state
    return controller


def _refused_type(y: object) -> int:
    """Which argument is no number: y, or else the applied u."""
    try:
        float(y)  # type: ignore[arg-type]  # an object that float() refuses is what is looked for
    except (TypeError, ValueError, OverflowError):
        return READING_REFUSED
    return APPLIED_REFUSED


def _error(
    failed: int, model: str, y: object, y_r: object, u_applied: object, reading: str = "y"
) -> PmjointError:
    """The error of a step that was refused."""
    if failed == READING_REFUSED:
        return UsageError(f"is {quoted(y)}", where=reading, remedy="allowed: a finite number")
    if failed == APPLIED_REFUSED:
        remedy = "allowed: a finite number, or None for what the last step returned"
        return UsageError(f"is {quoted(u_applied)}", where="u_applied", remedy=remedy)
    if failed == REFERENCE_REFUSED:
        what = "the model's own has no finite values here" if y_r is None else f"is {quoted(y_r)}"
        return UsageError(what, where="y_r", remedy="allowed: finite numbers")
    what = (
        "v or the controller's state is no finite number"
        if failed == Status.NON_FINITE
        else "a kernel failed"
    )
    return SimulationError(what, where=model, remedy="reset the controller, or set other gains")
