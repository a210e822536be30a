"""A run as the values of JSON in ``run.json``, and back: a folder yields the same record as a live run.

Numbers come back bit for bit. The columns stand in ``trajectory.csv``, the duration in ``summary.json``.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pmjoint_codegen import __version__
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.reference.command import Command
from pmjoint_codegen.reference.segments import Segments, make_segments
from pmjoint_codegen.simulate.record import Record
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import Settings, vector_of

SCHEMA: Final = 1
_PLAIN: Final = ("horizon", "output_step", "controller", "sample_time", "tolerance", "start")
_LIMITS: Final = ("max_step", "divergence", "max_steps", "max_switches")


def versions_of(run: Record) -> dict[str, str]:
    """Versions that a run's bytes may depend on: the package, Python, NumPy, and what made the kernels."""
    here = {"pmjoint": __version__, "python": platform.python_version(), "numpy": np.__version__}
    return {**here, **{name: v for name, v in run.manifest.versions.items() if name != "pmjoint_codegen"}}


def contents_of(run: Record) -> dict[str, Any]:
    """Settings, result and model of a run, without its columns and its duration."""
    settings, reference = run.settings, run.settings.reference
    return {
        "settings": {
            "parameters": dict(settings.parameters),
            "x0": settings.x0.tolist(),
            "reference": None if reference is None else _command_contents(reference.command),
            **{name: getattr(settings, name) for name in _PLAIN},
            **{name: _number(getattr(settings, name)) for name in _LIMITS},
        },
        "result": {
            "evaluator": run.evaluator,
            "status": run.status.name,
            "message": run.message,
            "steps": run.steps,
            "initial_mode": run.initial_mode,
            "switches": [list(item) for item in run.switches],
            "sticks": [list(item) for item in run.sticks],
            "peaks": {name: [_number(size), _number(t)] for name, (size, t) in run.peaks.items()},
            "ise": _number(run.ise),
            "settling_s": None if run.settling_s is None else _number(run.settling_s),
        },
        "manifest": run.manifest.without_kernels().to_contents(),
    }


def run_from(contents: Mapping[str, Any], columns: Mapping[str, Array], wall_s: float) -> Run:
    """Rebuild a run.

    Args:
        contents: as `contents_of` gave them.
        columns: by name, each of shape (rows,).
        wall_s: the run's duration, s.

    Raises:
        KeyError: a field or a column is missing.
        TypeError: a field that this version does not have, or a value of another type.
        ValueError: a value that is none of those known.
    """
    manifest = Manifest.from_contents(dict(contents["manifest"]))
    settings = _settings(contents["settings"], manifest)
    if settings.reference is not None:
        manifest = manifest.with_command(settings.reference.command)
    result = contents["result"]
    peaks = {name: (float(size), float(t)) for name, (size, t) in result["peaks"].items()}
    return Run(
        manifest=manifest,
        settings=settings,
        evaluator=result["evaluator"],
        status=Status[result["status"]],
        message=result["message"],
        **tables(manifest, columns),
        switches=tuple((float(t), int(mode)) for t, mode in result["switches"]),
        initial_mode=int(result["initial_mode"]),
        peaks=peaks,
        ise=float(result["ise"]),
        settling_s=None if result["settling_s"] is None else float(result["settling_s"]),
        steps=int(result["steps"]),
        wall_s=wall_s,
        sticks=tuple((float(start), float(end)) for start, end in result["sticks"]),
    )


def tables(manifest: Manifest, columns: Mapping[str, Array]) -> dict[str, Any]:
    """The fields t, states and signals of a record from its columns; raises `KeyError` if one is missing."""
    rows = len(columns["t"])

    def table(names: list[str]) -> Array:
        return np.column_stack([columns[name] for name in names]) if names else np.empty((rows, 0))

    return {
        "t": columns["t"],
        "states": table([item.name for item in manifest.states]),
        "signals": table([item.name for item in manifest.signals]),
    }


def _settings(contents: Mapping[str, Any], manifest: Manifest) -> Settings:
    values = {name: float(value) for name, value in contents["parameters"].items()}
    segments = _segments(contents["reference"], manifest)
    limits: dict[str, Any] = {name: float(contents[name]) for name in _LIMITS}
    whole: dict[str, Any] = {name: int(limits.pop(name)) for name in ("max_steps", "max_switches")}
    return Settings(
        parameters=MappingProxyType(values),
        p=vector_of(values, segments),
        x0=np.array(contents["x0"], dtype=np.float64),
        reference=segments,
        **{name: contents[name] for name in _PLAIN},
        **limits,
        **whole,
    )


def _segments(contents: Mapping[str, Any] | None, manifest: Manifest) -> Segments | None:
    if contents is None:
        return None
    given = {**contents, "t": tuple(contents["t"]), "y": tuple(contents["y"])}
    return make_segments(Command(**given), manifest.rho)


def _command_contents(command: Command) -> dict[str, Any]:
    return {
        "kind": command.kind,
        "t": list(command.t),
        "y": list(command.y),
        "filter": command.filter,
        "origin": dict(command.origin),
    }


def _number(value: float) -> float | str:
    """A number as JSON has it; one that it has not, such as an infinity, as the text that `float` reads."""
    return value if math.isfinite(value) else str(value)
