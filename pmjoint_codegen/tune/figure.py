"""Both designs in one figure: the error and v, the beginning enlarged on the left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen import storage
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.simulate.style import BLUE, RUST, STONE, png, styled, wrapped
from pmjoint_codegen.tune.comparison import Comparison, Traces, traces, transient
from pmjoint_codegen.tune.cost import CostFunction

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS: Final = (STONE, BLUE)  # before, after
LABELS: Final = ("before", "after")
SIZE: Final = (6.6, 4.3)  # inches
_STYLE: Final = {"axes.xmargin": 0.0}


def write_figure(costing: CostFunction, comparison: Comparison, path: Path) -> None:
    """Draw both designs on every plant as a PNG file.

    Raises:
        UsageError: the file cannot be written.
    """
    storage.write_bytes(path, png(draw(costing, comparison), _STYLE))


def draw(costing: CostFunction, comparison: Comparison) -> Figure:
    """Draw both designs on every plant."""
    from matplotlib.figure import Figure

    with styled(_STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        panels = figure.subplots(2, 2, sharex="col", width_ratios=(1.0, 1.6))
        ends = (transient(comparison), comparison.request.runs.horizon)
        for column, end in zip(panels.T, ends, strict=True):
            drawn = traces(costing, comparison, end)
            _curves(column[0], drawn, drawn.e)
            _curves(column[1], drawn, drawn.v)
            column[1].set_xlabel("$t$ (s)")
        _limits(panels[1], comparison)
        units = {item.name: item.unit for item in comparison.manifest.signals}
        panels[0, 0].set_ylabel(f"$e$ ({units['e']})")
        panels[1, 0].set_ylabel(f"$v$ ({units['v']})")
        panels[0, 1].legend(loc="best")
        figure.supxlabel("\n".join(wrapped(_caption(comparison))), fontsize=8.2, x=0.02, ha="left")
    return figure


def _curves(panel: Axes, drawn: Traces, values: Array) -> None:
    panel.axhline(0.0, color=STONE, lw=0.3, zorder=1)
    for side, (colour, label) in enumerate(zip(COLOURS, LABELS, strict=True)):
        others = values[side, 1:]
        if len(others):
            alpha = max(0.12, min(0.5, 4 / len(others)))
            panel.plot(drawn.t, others.T, color=colour, lw=0.5, alpha=alpha, zorder=2 + side)
        panel.plot(drawn.t, values[side, 0], color=colour, lw=1.1, label=label, zorder=4 + side)


def _limits(panels: Array, comparison: Comparison) -> None:
    """The requested limit of v on the left; on the right, v near the actuator's limit."""
    request, manifest = comparison.request, comparison.manifest
    peak = 1.08 * float(np.nanmax(comparison.metrics[..., Column.MAX_ABS_V]))
    left, right = panels[0], panels[1]
    if request.max_v is not None:
        for sign in (-1, 1):
            left.axhline(sign * request.max_v, color=RUST, lw=0.7, ls=(0, (4, 2)), zorder=1)
    limits = manifest.limits(dict(zip(manifest.parameter_names, request.runs.p, strict=False)))
    level = max(map(abs, limits))
    for limit in limits:
        right.axhline(limit, color=STONE, lw=0.5, ls=(0, (1, 2)), zorder=1)
    if peak > 2 * level:
        right.set_ylim(-1.5 * level, 1.5 * level)


def _caption(comparison: Comparison) -> str:
    request = comparison.request
    parts = [f"{comparison.manifest.name}: gains before and after tuning for {request.objective.text}"]
    if request.max_v is not None:
        parts.append(rf"under $|v| \leq {request.max_v:g}$ (dashed)")
    drawn = ", ".join(
        f"{item.name} ~ {item.law}({item.first:g},{item.second:g})" for item in request.drawn.samples
    )
    if drawn:
        parts.append(f"{request.over} of {request.count} plants, {drawn} (thin)")
    return f"{', '.join(parts)}. Left: the beginning. Dotted: the limit of u."
