"""Panels of an adaptive controller: its estimates, V, and its error beside that of frozen estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from pmjoint_codegen.simulate.estimates import LYAPUNOV, Estimate, estimates, has_lyapunov, is_frozen
from pmjoint_codegen.simulate.panels import Line, Panel, unit_text
from pmjoint_codegen.simulate.style import BLACK, GREY, RED
from pmjoint_codegen.simulate.symbols import symbol

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.estimates import FrozenError
    from pmjoint_codegen.simulate.record import Record

OF_V, OF_ERROR = 14, 5  # decades
NEAR: Final = 4.0  # a range up to this many times as wide as what is drawn has its ends drawn too
FROZEN: Final = "$e$, estimates at their guesses"


def estimate_panels(run: Record) -> tuple[Panel, ...]:
    """Each estimate with the plant's own value dashed, and the ends of its range."""
    return tuple(_estimate_panel(run, item) for item in estimates(run))


def _estimate_panel(run: Record, item: Estimate) -> Panel:
    label, of = symbol(item.name), of_text(item)
    ends = run.t[[0, -1]] if run.t.size else run.t
    lines = (
        Line(of, of, RED, "--", own=(ends, np.full(ends.size, item.truth))),
        Line(item.name, label),
    )
    remark = "" if item.range is None else "range {:.4g} to {:.4g}".format(*item.range)
    near = item.range if item.range is not None and _is_near(run, item, item.range) else ()
    return Panel(lines, label + unit_text(run.manifest, item.name), marks=near, remark=remark, based=False)


def of_text(item: Estimate) -> str:
    """What an estimate is of, as mathematics: ``$b_{0}$`` or ``$1/b_{0}$``."""
    inverse, _, name = item.of.rpartition("/")
    return symbol(name) if not inverse else f"${inverse}/{symbol(name).strip('$')}$"


def _is_near(run: Record, item: Estimate, ends: tuple[float, float]) -> bool:
    """Whether the ends of a range leave the curves room enough."""
    drawn = [*run[item.name].tolist(), item.truth]
    return bool(ends[1] - ends[0] <= NEAR * (max(drawn) - min(drawn)))


def lyapunov_panel(run: Record) -> tuple[Panel, ...]:
    """V on a logarithmic axis; nothing where a controller has none, or V no value."""
    if not has_lyapunov(run):
        return ()
    line = Line(LYAPUNOV, "$V$")
    return (Panel((line,), "$V$" + unit_text(run.manifest, LYAPUNOV), decades=OF_V),)


def error_panels(run: Record, frozen: FrozenError | None) -> tuple[Panel, ...]:
    """The error with and without adaptation: as it is, and its magnitude on a logarithmic axis."""
    unit = unit_text(run.manifest, "e")
    e = Line("e", "$e$", BLACK)
    lines = (e,) if frozen is None else (Line("frozen e", FROZEN, GREY, "--", own=(frozen.t, frozen.e)), e)
    return Panel(lines, f"$e${unit}"), Panel(lines, f"$|e|${unit}", decades=OF_ERROR)


def adaptation_caption(run: Record) -> str:
    """What the figure of the estimates shows."""
    which = ", ".join(symbol(item.name) for item in estimates(run))
    V = " Lyapunov function $V$." if has_lyapunov(run) else ""
    return f"Estimates {which} (solid) and the plant's values (dashed), which they need not reach.{V}"


def error_caption(run: Record, frozen: FrozenError | None) -> str:
    """What the figure of the errors shows."""
    if is_frozen(run):
        return "Tracking error with estimates that stay at their guesses."
    beside = "" if frozen is None else "; dashed: the same run with estimates that stay at their guesses"
    return f"Tracking error with adaptation{beside}."
