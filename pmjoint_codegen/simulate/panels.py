"""Curves and panels: what figures are made of; nothing is drawn here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.style import BLACK, BLUE, GREY, RED
from pmjoint_codegen.simulate.symbols import symbol

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.record import Record

COLOURS: Final = (BLACK, BLUE, RED, GREY)


@dataclass(frozen=True)
class Line:
    """One curve.

    Attributes:
        column: name of the signal in the run; ``a-b`` is a difference of two.
        label: text in the legend.
        colour: of the line.
        dash: matplotlib's line style.
        unit: what one unit of the axis is in the signal's unit.
        own: instants and values of a curve that is no column of the run; `column` then only names it.
    """

    column: str
    label: str
    colour: str = BLACK
    dash: str = "-"
    unit: float = 1.0
    own: tuple[Array, Array] | None = None

    def curve(self, run: Record) -> tuple[Array, Array]:
        """Return instants, s, and the curve there, both of shape (rows,)."""
        return (run.t, self.values(run)) if self.own is None else self.own

    def values(self, run: Record) -> Array:
        """Return the curve at the run's output instants, shape (rows,)."""
        if self.unit != 1.0:
            return run[self.column] / self.unit
        first, _, second = self.column.partition("-")
        return run[first] - run[second] if second else run[first]


@dataclass(frozen=True)
class Panel:
    """One pair of axes: curves over time.

    Attributes:
        lines: its curves, the most important one last, on top.
        label: what the vertical axis shows.
        clip: largest magnitude that the whole-run panel shows, or None for all.
        levels: values to mark by horizontal lines, without moving the axis.
        marks: values to mark by horizontal lines.
        remark: text above the panel, on its left.
        decades: that a logarithmic axis shows of the magnitudes, below the largest; 0: the axis is linear.
        based: whether the axis contains 0.
    """

    lines: tuple[Line, ...]
    label: str
    clip: float | None = None
    levels: tuple[float, ...] = ()
    marks: tuple[float, ...] = ()
    remark: str = ""
    decades: int = 0
    based: bool = True

    def is_zero(self, run: Record) -> bool:
        """Whether every curve is exactly 0 over the whole run, as r is without a compensator."""
        return all(not line.curve(run)[1].any() for line in self.lines)

    @property
    def needs_legend(self) -> bool:
        """Whether the curves need a legend besides the vertical label."""
        return len(self.lines) > 1


def unit_text(manifest: Manifest, name: str) -> str:
    """Format a signal's unit for an axis: ``(rad/s$^2$)``, or nothing for a pure number."""
    unit = next((item.unit for item in (*manifest.states, *manifest.signals) if item.name == name), "")
    first, *powers = unit.split("^")
    raised = first + "".join(f"$^{{{piece[:1]}}}${piece[1:]}" for piece in powers)
    return f" ({raised})" if unit not in ("", "1") else ""


def by_unit(manifest: Manifest, lines: Sequence[Line], label: str) -> tuple[Panel, ...]:
    """Give the curves of each unit a panel of their own; a single curve labels its axis."""
    units: dict[str, tuple[Line, ...]] = {}
    for line in lines:
        unit = unit_text(manifest, line.column.partition("-")[0])
        units[unit] = (*units.get(unit, ()), line)
    return tuple(
        Panel((replace(own[0], colour=BLACK),), own[0].label + unit)
        if len(own) == 1
        else Panel(own, label + unit)
        for unit, own in units.items()
    )


def single(manifest: Manifest, name: str, label: str) -> Panel:
    """Show one column, whose label is that of its axis."""
    return Panel((Line(name, label),), label + unit_text(manifest, name))


def family(manifest: Manifest, names: Sequence[str], stem: str) -> tuple[Panel, ...]:
    """Show several columns of one kind, a panel for each unit."""
    lines = [Line(name, symbol(name), COLOURS[k % 4]) for k, name in enumerate(names)]
    return by_unit(manifest, lines, f"${stem}$")
