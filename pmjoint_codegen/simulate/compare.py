"""Several runs side by side: settings in which they differ, their summaries, distances of their curves."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.simulate.chosen import unit_of
from pmjoint_codegen.simulate.summary import saturation_of
from pmjoint_codegen.simulate.trajectory import csv_columns
from pmjoint_codegen.values import COMPENSATOR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmjoint_codegen.simulate.page import Page
    from pmjoint_codegen.simulate.record import Record

MOST: Final = 8  # runs that dashes and colours tell apart
_MOST_NAMED: Final = 3  # settings in a label
_SHOWN: Final = ("y", "e", "v", "u")  # whose distances the table has; `signals` has all
_FIGURES: Final = (  # of the summary: key, name, unit of which column, what it is multiplied by
    ("ise", "ISE", "y", "^2 s"),
    ("max_abs_e", "max |e|", "y", ""),
    ("final_e", "final e", "y", ""),
    ("settling_s", "settling", "", "s"),
    ("max_abs_v", "max |v|", "u", ""),
    ("saturated_s", "saturated", "", "s"),
)


@dataclass(frozen=True)
class Quantity:
    """One number of each run.

    Attributes:
        name: for people.
        unit: of the numbers.
        values: one a run; None where a run has none.
    """

    name: str
    unit: str
    values: tuple[float | None, ...]

    @property
    def differences(self) -> tuple[float | None, ...]:
        """Each value less the first; None where one of them is missing."""
        first = self.values[0]
        return tuple(None if first is None or value is None else value - first for value in self.values)


@dataclass(frozen=True)
class Gap:
    """The largest distance of a signal from that of the first run, at the first run's output instants.

    Attributes:
        size: in the signal's unit; between its own instants the other run is interpolated linearly.
        at: its instant, s.
    """

    size: float
    at: float


@dataclass(frozen=True)
class Comparison:
    """Several runs side by side; ``print`` shows the table.

    Attributes:
        runs: what is compared.
        names: of the runs, such as their folders.
        labels: the settings in which each differs from the others, else its name.
        settings: name -> its value in each run, of the settings that differ, as text.
        summary: key of ``summary.json`` -> that number of each run.
        signals: column that all runs have -> the distance of each run from the first.
    """

    runs: tuple[Record, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    settings: Mapping[str, tuple[str, ...]]
    summary: Mapping[str, Quantity]
    signals: Mapping[str, tuple[Gap, ...]]

    def table(self) -> list[tuple[str, ...]]:
        """The rows of the table, the first with the heads: a name, a cell for each run, the difference."""
        two = len(self.runs) == 2
        rows = [("", *self.names, *(["difference"] if two else []))]
        rows += [(name, *values) for name, values in self.settings.items()]
        rows.append(("status", *(run.status.name.lower() for run in self.runs)))
        for item in self.summary.values():
            cells = tuple(_number(value) for value in item.values)
            name = f"{item.name} ({item.unit})" if item.unit else item.name
            rows.append((name, *cells, *([_number(item.differences[1], "+")] if two else [])))
        for name in (name for name in _SHOWN if name in self.signals):
            unit, gaps = unit_of(self.runs[0].manifest, name), self.signals[name]
            cells = ("", *(f"{gap.size:.6g} at {gap.at:.6g} s" for gap in gaps[1:]))
            rows.append((f"farthest {name}{f' ({unit})' if unit else ''}", *cells))
        return rows

    def contents(self) -> dict[str, Any]:
        """The same as values of JSON."""
        units = self.runs[0].manifest
        return {
            "runs": [
                {"name": name, "label": label, "model": run.manifest.name, "status": run.status.name.lower()}
                for name, label, run in zip(self.names, self.labels, self.runs, strict=True)
            ],
            "settings": {name: list(values) for name, values in self.settings.items()},
            "summary": {
                key: {"unit": item.unit, "values": item.values, "differences": item.differences}
                for key, item in self.summary.items()
            },
            "signals": {
                name: {
                    "unit": unit_of(units, name) or "1",
                    "largest": [gap.size for gap in gaps],
                    "at": [gap.at for gap in gaps],
                }
                for name, gaps in self.signals.items()
            },
        }

    def plot(self, signals: Sequence[str] | None = None, *, page: Page | None = None) -> Figure:
        """Draw the runs over each other.

        Args:
            signals: a panel for each entry, as for `Run.plot`; by default y, e, v, u, the compensator's
                states and what the estimates miss.
            page: that the figure is drawn for; by default a printed one.

        Raises:
            UsageError: a signal that not every run has.
        """
        from pmjoint_codegen.simulate.overlay import overlay
        from pmjoint_codegen.simulate.page import PRINTED

        return overlay(self, signals, page or PRINTED)

    def __str__(self) -> str:
        """The table, its columns aligned."""
        rows = self.table()
        widths = [max(len(row[k]) for row in rows if k < len(row)) for k in range(len(rows[0]))]
        return "\n".join(
            "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=False)).rstrip()
            for row in rows
        )

    def __repr__(self) -> str:
        """One line."""
        return f"<Comparison of {len(self.runs)} runs: {'; '.join(self.labels)}>"

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        head, *rows = ([html.escape(cell) for cell in row] for row in self.table())
        top = "".join(f"<th>{cell}</th>" for cell in head)
        body = "".join(
            f"<tr><th>{row[0]}</th>{''.join(f'<td>{c}</td>' for c in row[1:])}</tr>" for row in rows
        )
        return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def compare(*runs: Record, names: Sequence[str] | None = None) -> Comparison:
    """Compare runs, also of different models, live or read by `open_run`.

    Args:
        runs: two to eight.
        names: of the runs, for the table's heads; by default ``run 1``, ``run 2`` and so on.

    Raises:
        UsageError: fewer than two runs, more than eight, a name for not each, or a run without a row.
    """
    if not 2 <= len(runs) <= MOST:
        raise UsageError(f"got {len(runs)} runs", where="compare", remedy=f"allowed: 2 to {MOST}")
    if names is not None and len(names) != len(runs):
        raise UsageError(f"got {len(names)} names for {len(runs)} runs", where="compare", remedy="one a run")
    if not all(run.t.size for run in runs):
        raise UsageError("a run has no rows", where="compare", remedy="compare runs that began")
    named = tuple(names) if names is not None else tuple(f"run {k}" for k in range(1, len(runs) + 1))
    settings = _differing(runs)
    return Comparison(
        runs, named, _labels(runs, named, settings), settings, _summaries(runs), _distances(runs)
    )


def settings_of(run: Record) -> dict[str, str]:
    """All settings of a run as text, by name."""
    manifest, settings = run.manifest, run.settings
    units = {item.name: item.unit for item in manifest.parameters}
    stated = manifest.written(manifest.stated(settings.parameters))
    sampled = settings.controller == "sampled"
    reference = settings.reference
    data = "" if reference is None else f" ({reference.command.hash[:8]})"
    return {
        "model": manifest.name,
        "model hash": manifest.model_hash[:8],
        **{
            name: f"{value:.10g} {'' if units[name] == '1' else units[name]}".rstrip()
            for name, value in stated.items()
            if name != COMPENSATOR
        },
        "saturation": saturation_of(settings.parameters),
        "x0": f"({', '.join(f'{value:g}' for value in settings.x0)})",
        "y_r": run.reference_text + data,
        "disturbance": f"({', '.join(manifest.simulation.disturbance)})",
        "horizon": f"{settings.horizon:g} s",
        "output step": f"{settings.output_step:g} s",
        "controller": settings.controller,
        **({"sample time": f"{settings.sample_time:g} s"} if sampled else {}),
        "start": settings.start,
        "tolerance": f"{settings.tolerance:g}",
        "longest step": f"{settings.max_step:g} s",
    }


def _differing(runs: Sequence[Record]) -> dict[str, tuple[str, ...]]:
    """The settings in which the runs differ; a parameter that a model does not have is a dash."""
    listed = [settings_of(run) for run in runs]
    names = dict.fromkeys(name for settings in listed for name in settings)
    table = {name: tuple(settings.get(name, "-") for settings in listed) for name in names}
    found = {name: values for name, values in table.items() if len(set(values)) > 1}
    if found.keys() & {"y_r", "disturbance", "saturation"}:  # given for a run, they enter the hash as well
        found.pop("model hash", None)
    return found


def _labels(
    runs: Sequence[Record], names: tuple[str, ...], settings: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    """What differs, if that is short and tells the runs apart; else models, else names."""
    models = tuple(run.manifest.name for run in runs)
    if len(set(models)) == len(models):
        return models
    short = {name: values for name, values in settings.items() if name != "model hash"}
    if 0 < len(short) <= _MOST_NAMED and "model" not in short:
        own = {item.name for run in runs for item in run.manifest.parameters}
        labels = tuple(
            ", ".join(_said(name, values[k], bare=name in own) for name, values in short.items())
            for k in range(len(runs))
        )
        if len(set(labels)) == len(labels):
            return labels
    return names


def _said(name: str, value: str, *, bare: bool) -> str:
    """One setting in a label; a parameter without its unit, which the table has."""
    if name in ("saturation", "start", "controller"):
        return f"{value} {name}" if name != "saturation" else f"saturation {value}"
    return f"{name} = {value.partition(' ')[0] if bare else value}"


def _summaries(runs: Sequence[Record]) -> dict[str, Quantity]:
    from pmjoint_codegen.simulate.summary import summarise

    found, first = [summarise(run) for run in runs], runs[0].manifest
    return {
        key: Quantity(
            name, (unit_of(first, column) if column else "") + power, tuple(item[key] for item in found)
        )
        for key, name, column, power in _FIGURES
    }


def _distances(runs: Sequence[Record]) -> dict[str, tuple[Gap, ...]]:
    """The distances of every column that all runs have in one unit."""
    first, *others = runs
    common = [
        name
        for name in csv_columns(first.manifest)[1:]
        if all(name in other.columns and _same_unit(first, other, name) for other in others)
    ]
    return {name: (Gap(0.0, 0.0), *(_gap(first, other, name) for other in others)) for name in common}


def _same_unit(first: Record, other: Record, name: str) -> bool:
    return unit_of(first.manifest, name) == unit_of(other.manifest, name)


def _gap(first: Record, other: Record, name: str) -> Gap:
    t = first.t[first.t <= other.t[-1]]
    with np.errstate(all="ignore"):  # a failed run may end in infinities
        apart = np.abs(first[name][: len(t)] - np.interp(t, other.t, other[name]))
    worst = int(np.argmax(np.nan_to_num(apart, nan=-1.0, posinf=np.inf)))
    return Gap(float(apart[worst]), float(t[worst]))


def _number(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.6g}"
