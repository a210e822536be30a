"""All that the result of a sweep depends on, checked, as one record that can be hashed, stored and sent."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.identity import canonical_hash
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.settings import Settings, make_settings
from pmjoint_codegen.sweep.plan import Plan

DEFAULT_TOLERANCE: Final = 1e-6
DEFAULT_DIVERGENCE: Final = (
    1e4  # a run that passes it has left; following it further costs more than all others
)
MAX_STEPS: Final = 1_000_000
MAX_TRAJECTORIES: Final = 2**31  # bytes


@dataclass(frozen=True)
class Request:
    """A sweep, as asked for.

    Attributes:
        model: name of the model.
        model_hash: of all that its file says.
        kernels: SHA-256 of the generated lanes.
        reference: y_r.
        disturbance: one expression a state.
        plan: which runs.
        p: parameters that hold where nothing is varied, in the kernels' order.
        own: the plant's own parameters, such as ``J_plant``, that are set; others follow what the controller
            believes, run by run, unless they are varied.
        x0: initial plant states, likewise.
        horizon: s.
        controller: ``continuous`` or ``sampled``.
        sample_time: s; 0 for the continuous controller.
        tolerance: local error, relative to max(1, |value|).
        output_step: s, of the trajectories; 0 keeps none.
        divergence: |X_i| above it ends a run.
        max_steps: limit of steps of one run.
    """

    model: str
    model_hash: str
    kernels: str
    reference: str
    disturbance: tuple[str, ...]
    plan: Plan
    p: tuple[float, ...]
    own: tuple[str, ...]
    x0: tuple[float, ...]
    horizon: float
    controller: str
    sample_time: float
    tolerance: float
    output_step: float
    divergence: float
    max_steps: int

    @property
    def document(self) -> dict[str, Any]:
        """The record as plain data."""
        return asdict(self)

    @property
    def hash(self) -> str:
        """SHA-256 of the record: equal requests have equal results."""
        return canonical_hash(self.document)

    def times(self) -> Array:
        """Instants of the trajectories, s; none where none are kept."""
        if not self.output_step:
            return np.empty(0)
        count = int(np.ceil(self.horizon / self.output_step * (1 - 1e-12)))
        times = np.arange(count + 1, dtype=np.float64) * self.output_step
        times[-1] = self.horizon
        return times


def make_request(
    manifest: Manifest,
    plan: Plan,
    *,
    parameters: Mapping[str, float] | None = None,
    x0: Sequence[float] | None = None,
    horizon: float | None = None,
    controller: str = "continuous",
    sample_time: float | None = None,
    compensator: bool | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    output_step: float | None = None,
    divergence: float = DEFAULT_DIVERGENCE,
) -> Request:
    """Complete a sweep from the model's defaults and check it.

    Args:
        manifest: the model.
        plan: which runs.
        parameters: fixed overrides, by name.
        x0: initial plant states where they are not varied.
        horizon: s.
        controller: ``continuous`` or ``sampled``.
        sample_time: s.
        compensator: False: r = 0, plain clipping.
        tolerance: local error.
        output_step: s; keeps trajectories.
        divergence: |X_i| above it ends a run.

    Raises:
        UsageError: for the first setting that is unknown or out of range.
    """
    settings = make_settings(
        manifest,
        parameters=parameters,
        x0=x0,
        horizon=horizon,
        controller=controller,
        sample_time=sample_time,
        compensator=compensator,
        tolerance=tolerance,
        output_step=output_step,
    )
    _check_names(manifest, plan, parameters or {})
    own = tuple(name for name in manifest.own if name in (parameters or {}))
    request = _request(manifest, plan, replace(settings, divergence=_positive(divergence)), own, output_step)
    size = 8 * plan.runs * len(request.times()) * (manifest.nX + 2)
    if size > MAX_TRAJECTORIES:
        raise UsageError(
            f"would keep {size / 2**30:.1f} GiB of trajectories",
            where="--output-step",
            remedy=f"at most {MAX_TRAJECTORIES / 2**30:g} GiB: fewer runs, a shorter horizon, a longer step",
        )
    return request


def _positive(divergence: float) -> float:
    if not 0 < divergence < float("inf"):
        raise UsageError(
            f"is {divergence:g}", where="--divergence", remedy="allowed: a number greater than 0"
        )
    return float(divergence)


def _request(
    manifest: Manifest, plan: Plan, settings: Settings, own: tuple[str, ...], output_step: float | None
) -> Request:
    simulation = manifest.simulation
    return Request(
        model=manifest.name,
        model_hash=manifest.model_hash,
        kernels=manifest.files["lanes.c"],
        reference=simulation.reference,
        disturbance=simulation.disturbance,
        plan=plan,
        p=tuple(settings.p.tolist()),
        own=own,
        x0=tuple(settings.x0.tolist()),
        horizon=settings.horizon,
        controller=settings.controller,
        sample_time=settings.sample_time if settings.controller == "sampled" else 0.0,
        tolerance=settings.tolerance,
        output_step=settings.output_step if output_step is not None else 0.0,
        divergence=settings.divergence,
        max_steps=MAX_STEPS,
    )


def varied_names(manifest: Manifest) -> tuple[str, ...]:
    """What a sweep can vary: initial plant states by the states' names, then every entry of p."""
    return (*(state.name for state in manifest.states[: manifest.nx]), *manifest.parameter_names)


def _check_names(manifest: Manifest, plan: Plan, fixed: Mapping[str, float]) -> None:
    names = varied_names(manifest)
    for name in plan.names:
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise UsageError(
                f"{manifest.name} has no {name!r} to vary", remedy=f"{hint}names: {', '.join(names)}"
            )
        if name in fixed:
            raise UsageError(
                f"{name} is both set and varied",
                where="sweep",
                remedy="leave out --set, or --grid and --sample",
            )
