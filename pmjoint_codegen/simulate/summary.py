"""``summary.json``: a run in a few numbers, each defined here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pmjoint_codegen.chain import clocked
from pmjoint_codegen.loops.status import holds
from pmjoint_codegen.simulate.assumptions import remarks
from pmjoint_codegen.simulate.disturbance import disturbance_summary
from pmjoint_codegen.simulate.estimates import LYAPUNOV, estimates, has_lyapunov
from pmjoint_codegen.simulate.record import COMMAND
from pmjoint_codegen.simulate.settings import left_out
from pmjoint_codegen.values import BRAKING, CLIP, COMPENSATOR

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record


def summarise(run: Record) -> dict[str, Any]:
    """Summarise a run; keys in order of interest.

    ``ise`` is the integral of e^2 by Gauss-Legendre quadrature of the dense output, step by step;
    ``max_abs_e``, ``max_abs_v``, ``peaks`` (largest magnitude, its instant) and ``settling_s`` are taken on
    the dense output as well. None of them depends on the output grid; the extremes of the disturbance and of
    pressures are those at the output instants. ``held`` is false if the joint
    diverges, by the rule of sweeps. ``remarks`` has what a reader of an adaptive run must know.
    """
    settings, manifest = run.settings, run.manifest
    data = settings.reference
    parameters = manifest.written(manifest.stated(settings.parameters))
    return {
        "model": manifest.name,
        "model_hash": manifest.model_hash,
        "parameters": parameters,
        "units": units_of(run, parameters),
        "x0": settings.x0.tolist(),
        "start": settings.start,
        "saturation": saturation_of(settings.parameters),
        "reference": run.reference_text if data is None else data.command.summary,
        "disturbance": list(manifest.simulation.disturbance),
        "horizon": settings.horizon,
        "output_step": settings.output_step,
        "controller": settings.controller,
        "sample_time": settings.sample_time if settings.controller == "sampled" else None,
        **({"left_out": list(left_out(manifest, settings.controller))} if clocked(manifest.chain) else {}),
        "tolerance": settings.tolerance,
        "evaluator": run.evaluator,
        "status": run.status.name.lower(),
        "message": run.message,
        "held": held(run),
        "steps": run.steps,
        "wall_s": run.wall_s,
        "initial_mode": run.initial_mode,
        "saturation_switches": [[t, label] for t, label in run.switches],
        "saturated_s": saturated_time(run),
        **stick_summary(run),
        "max_abs_v": finite(run.peaks["v"][0]),
        "ise": finite(run.ise),
        "max_abs_e": finite(run.peaks["e"][0]),
        "settling_s": run.settling_s,
        "final_e": finite(float(run["e"][-1])),
        "remarks": list(remarks(run)),
        **estimation_summary(run),
        **disturbance_summary(run),
        "peaks": {name: [finite(value), t] for name, (value, t) in run.peaks.items()},
    }


def saturation_of(parameters: Mapping[str, float]) -> str:
    """What the controller does about a saturated input: ``compensator``, ``clip`` or ``braking``."""
    if not parameters[COMPENSATOR]:
        return CLIP
    return BRAKING if BRAKING in parameters else COMPENSATOR


def units_of(run: Record, parameters: Iterable[str]) -> dict[str, str]:
    """Unit of every parameter and column, as in the model file; ``1`` if there is none.

    A parameter with a column's name, such as e, is listed as ``parameter e``.
    """
    manifest = run.manifest
    stated = {item.name: item.unit for item in manifest.parameters}
    columns = {item.name: item.unit for item in (*manifest.states, *manifest.signals)}
    if COMMAND in run.columns:
        columns[COMMAND] = columns["y_r"]
    named = {f"parameter {name}" if name in columns else name: stated[name] or "1" for name in parameters}
    return {**named, "t": "s", **columns}


def held(run: Record) -> bool:
    """Whether the run reached its horizon, without u at a limit and e largest there; see `holds`."""
    if not run.t.size:
        return False
    e, mode = run["e"], run.switches[-1][1] if run.switches else run.initial_mode
    ends = (np.abs(e[-1:]), np.array([run.peaks["e"][0]]), np.array([float(mode != 0)]))
    return bool(holds(np.array([int(run.status)]), *ends)[0])


def stick_summary(run: Record) -> dict[str, Any]:
    """How long and when a kink held the plant, s; nothing of a model where none can."""
    if not run.manifest.can_hold:
        return {}
    return {
        "stuck_s": sum(end - start for start, end in run.sticks),
        "sticks": [list(interval) for interval in run.sticks],
    }


def estimation_summary(run: Record) -> dict[str, Any]:
    """Where estimates and V began and ended, and the plant's own values; nothing without estimates."""
    found = estimates(run)
    if not found:
        return {}
    told: dict[str, Any] = {
        "estimates": {
            item.name: {
                "of": item.of,
                "first": finite(float(run[item.name][0])),
                "final": finite(float(run[item.name][-1])),
                "true": finite(item.truth),
                "range": None if item.range is None else list(item.range),
            }
            for item in found
        }
    }
    if has_lyapunov(run):
        told["V"] = {"first": finite(float(run[LYAPUNOV][0])), "final": finite(float(run[LYAPUNOV][-1]))}
    return told


def saturated_time(run: Record) -> float:
    """Time that u spends at a limit, s, from the located switches."""
    if not run.t.size:
        return 0.0
    instants = [0.0, *(t for t, _ in run.switches), max(float(run.t[-1]), *(t for t, _ in run.switches), 0.0)]
    labels = [run.initial_mode, *(label for _, label in run.switches)]
    return sum(
        end - start for start, end, label in zip(instants, instants[1:], labels, strict=False) if label != 0
    )


def finite(value: float) -> float | None:
    """A number that JSON can represent, or None: a failed run may end in infinities."""
    return value if math.isfinite(value) else None
