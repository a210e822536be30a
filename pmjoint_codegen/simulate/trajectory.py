"""A run's columns in the order of ``trajectory.csv``, with units, meanings and groups, for every format."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from pmjoint_codegen.logs.trajectory import Column, Trajectory
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.record import COMMAND
from pmjoint_codegen.simulate.summary import summarise

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

_BLOCK_GROUPS = {  # the other blocks of X are those of the filters
    "x": "plant",
    "r": "compensator",
    "Theta": "adaptation",
    "rho": "adaptation",
    "Gamma": "adaptation",
}
_SIGNAL_GROUPS = ((r"x_hat\d+", "estimate"), (r"D\d+", "disturbance"), (r"V|.+_hat", "adaptation"))


def csv_columns(manifest: Manifest) -> tuple[str, ...]:
    """Names and order: t, y, y_r, e, states, errors, virtual controls, v, u, estimate, D, physics.

    After y_r comes y_cmd where the reference is data.
    """
    signals = [item.name for item in manifest.signals]
    first = signals.index("e") + 1
    errors = signals[first : signals.index("v")]
    rest = signals[signals.index("u") + 1 :]  # x_hat, D, then a joint's physical signals
    command = [COMMAND] if manifest.segment else []
    return (
        "t",
        "y",
        "y_r",
        *command,
        "e",
        *(item.name for item in manifest.states),
        *errors,
        "v",
        "u",
        *rest,
    )


def labels(run: Record) -> dict[str, tuple[str, str]]:
    """Unit and meaning of every column."""
    items = (*run.manifest.states, *run.manifest.signals)
    found = {item.name: (item.unit, item.about) for item in items}
    return {"t": ("s", "time"), COMMAND: (found["y_r"][0], "unfiltered reference"), **found}


def trajectory_of(run: Record) -> Trajectory:
    """A run as formats write it: the same for the same run, so without its duration on this machine."""
    from pmjoint_codegen import __version__

    known, groups = labels(run), _groups(run.manifest)
    summary = {name: value for name, value in summarise(run).items() if name != "wall_s"}
    return Trajectory(
        columns=tuple(
            Column(name, known[name][0] or "1", known[name][1], groups.get(name, "output"), run[name])
            for name in csv_columns(run.manifest)
        ),
        model=run.manifest.name,
        title=run.manifest.title,
        model_hash=run.manifest.model_hash,
        version=__version__,
        parameters=summary["parameters"],
        summary=summary,
    )


def _groups(manifest: Manifest) -> dict[str, str]:
    """The part of the loop that a column belongs to; those that are not here are of the output."""
    found = {
        item.name: _BLOCK_GROUPS.get(block, "filters")
        for block, (first, end) in manifest.blocks.items()
        for item in manifest.states[first:end]
    }
    names = [item.name for item in manifest.signals]
    e, v, u = (names.index(name) for name in ("e", "v", "u"))
    found |= dict.fromkeys(names[e + 1 : v], "errors") | dict.fromkeys(names[v : u + 1], "input")
    for name in names[u + 1 :]:
        found[name] = next((group for form, group in _SIGNAL_GROUPS if re.fullmatch(form, name)), "plant")
    return found
