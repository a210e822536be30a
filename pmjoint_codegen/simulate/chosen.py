"""Panels of signals that a user names: ``y+y_r,e,v`` is three panels, the first with two curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pmjoint_codegen.errors import UsageError, did_you_mean, quoted
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.panels import Line, Panel, unit_text
from pmjoint_codegen.simulate.record import COMMAND
from pmjoint_codegen.simulate.style import BLACK, BLUE, GREY, RED
from pmjoint_codegen.simulate.symbols import symbol

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

WHERE = "signals"
_LOOKS = ((BLACK, "-"), (RED, "--"), (BLUE, "-."), (GREY, ":"))  # of the curves of a panel, the first on top


def chosen_panels(run: Record, signals: Sequence[str]) -> tuple[Panel, ...]:
    """Make a panel for each entry.

    Args:
        run: what has the columns.
        signals: each a column, a difference of two, ``x1-x_hat1``, or several of one unit, ``y+y_r``.

    Raises:
        UsageError: no such column, no entry, more than four curves in a panel, or two units in one.
    """
    if not signals:
        raise UsageError("names no signal", where=WHERE, remedy=f"columns: {', '.join(run.columns)}")
    return tuple(_panel(run, entry.strip()) for entry in signals)


def unit_of(manifest: Manifest, name: str) -> str:
    """Unit of a column or of a difference of two, as in the model file; empty for a pure number."""
    first = "y_r" if name == COMMAND else name.partition("-")[0]
    items = (*manifest.states, *manifest.signals)
    unit = "s" if first == "t" else next((item.unit for item in items if item.name == first), "")
    return "" if unit == "1" else unit


def _panel(run: Record, entry: str) -> Panel:
    names = entry.split("+")
    for column in (part for name in names for part in name.split("-")):
        if column not in run.columns:
            raise UsageError(
                f"there is no column {quoted(column)}",
                where=WHERE,
                remedy=f"{did_you_mean(column, run.columns, str)}columns: {', '.join(run.columns)}",
            )
    units = {unit_of(run.manifest, part) for name in names for part in name.split("-")}
    if len(units) > 1:
        shown = " and ".join(sorted(unit or "1" for unit in units))
        raise UsageError(
            f"{quoted(entry)} has the units {shown}", where=WHERE, remedy="separate them by a comma"
        )
    if len(names) > len(_LOOKS) or any(name.count("-") > 1 for name in names):
        raise UsageError(
            f"is {quoted(entry)}", where=WHERE, remedy=f"allowed: at most {len(_LOOKS)} curves a panel, a-b"
        )
    lines = [
        Line(name, symbol(name), colour, dash) for name, (colour, dash) in zip(names, _LOOKS, strict=False)
    ]
    first = names[0].partition("-")[0]
    label = ",\\ ".join(symbol(name).strip("$") for name in names)
    return Panel(
        tuple(reversed(lines)), f"${label}$" + unit_text(run.manifest, "y_r" if first == COMMAND else first)
    )
