"""A run in a short table: how it ended, when u was saturated, peaks, settling, error, files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pmjoint_codegen.cli.terminal import table

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.run import Run

_SHOWN = 8  # switches in the table; summary.json holds all of them
_BEYOND = "beyond floating point"  # of a run that failed
_PASCALS = 1e5  # in a bar
_MODES = {-1: "at -{limit}", 0: "inside its limits", 1: "at {limit}"}


def account(run: Run, notes: Sequence[str], files: Sequence[Path]) -> str:
    """Give the table.

    Args:
        run: what to tell of.
        notes: changes that the run itself does not know to be changes.
        files: what was written, all of it in one folder.
    """
    told = (_head(run, notes), _saturation(run), _peaks(run), _tracking(run), _disturbance(run))
    rows = [*(row for part in told for row in part), *_pressures(run), *_files(files)]
    return f"{run.manifest.name}: {run.manifest.title}\n{table(rows)}"


def _head(run: Run, notes: Sequence[str]) -> Iterator[tuple[str, ...]]:
    from pmjoint_codegen.simulate.assumptions import assumed, changes, stated

    yield "run", f"{run.settings.controller} controller, {run.evaluator} kernels"
    yield "status", f"{run.summary['status']}: {run.message} ({run.steps} steps in {run.wall_s * 1e3:.3g} ms)"
    assumptions = assumed(run)
    if assumptions:
        yield "assumed", f"{', '.join(assumptions)} (not stated in the paper)"
    for label, items in (("settings", stated(run)), ("changed", (*changes(run), *notes))):
        if items:
            yield label, ", ".join(items)


def _saturation(run: Run) -> Iterator[tuple[str, ...]]:
    starts = [(0.0, run.initial_mode), *run.switches[:_SHOWN]]
    for label, (t, mode) in zip(["u", *[""] * len(starts)], starts, strict=False):
        yield label, f"{_MODES[mode].format(limit=run.manifest.limit)} from {t:.10f} s"
    if len(run.switches) > _SHOWN:
        yield "", f"and {len(run.switches) - _SHOWN} more switches, in summary.json"
    yield "saturated", f"{run.summary['saturated_s']:.6g} s in all"


def _peaks(run: Run) -> Iterator[tuple[str, ...]]:
    manifest = run.manifest
    units = {item.name: item.unit for item in (*manifest.signals, *manifest.states)}
    names = [f"x{i}" for i in range(2, manifest.n + 1)] + [f"r{i}" for i in range(1, manifest.rho + 1)]
    for label, name in zip(["peaks", *[""] * len(names)], ["v", *names], strict=True):
        size, t = run.peaks[name]
        unit = f" {units[name]}" if units[name] not in ("", "1") else ""
        yield label, f"|{name}| = {size:.6g}{unit} at {t:.6g} s"


def _tracking(run: Run) -> Iterator[tuple[str, ...]]:
    summary = run.summary
    unit = next((item.unit for item in run.manifest.signals if item.name == "y"), "")
    yield "settling", _settling(summary["settling_s"], float(run["e"][0]), float(run.t[-1]))
    for label, key, of in (("ISE", "ise", "^2 s"), ("max |e|", "max_abs_e", ""), ("final e", "final_e", "")):
        value = summary[key]
        yield label, _BEYOND if value is None else f"{value:.6g} {unit}{of}"


def _settling(settled: float | None, initial: float, end: float) -> str:
    if settled is None:
        return "e starts at 0" if initial == 0.0 else _BEYOND
    if settled >= end:
        return f"not by {end:.6g} s (|e| > 2 % of the initial |e|)"
    return f"{settled:.6g} s (last |e| > 2 % of the initial |e|)"


def _disturbance(run: Run) -> Iterator[tuple[str, ...]]:
    """Say how large D of (12) was, what it is, and whether it kept to the bound that the proof presumes."""
    summary, bound = run.summary, run.manifest.disturbance_bound
    largest, parts = summary["disturbance_max"], summary["disturbance_max_components"]
    if largest == 0.0 and bound is None:
        return
    of_joint = bool(summary["pressures"])
    what = "all that the design leaves out of the joint" if of_joint else "unknown to the controller"
    size = _BEYOND if largest is None else f"{largest:.6g}"
    held = bound is None or (largest is not None and largest <= bound)
    presumed = "" if bound is None else f"; D_max = {bound:g}{'' if held else ' is exceeded'}"
    yield "max |D|", f"{size}: {what}{presumed}"
    units = {item.name: item.unit for item in run.manifest.signals}
    shown = [f"|{name}| = {part:.6g} {units[name]}" for name, part in parts.items() if part]
    if len(shown) > 1:
        yield "", ", ".join(shown)


def _pressures(run: Run) -> Iterator[tuple[str, ...]]:
    """Say where the muscle pressures went, and plainly when a command went beyond what there is."""
    muscles = run.summary["pressures"] or {}
    for label, (name, item) in zip(("pressures", ""), muscles.items(), strict=False):
        least, greatest, limit = (item[key] / _PASCALS for key in ("min", "max", "P_max"))
        yield label, f"{name} = {least:.4g} to {greatest:.4g} bar, limits 0 and {limit:.4g} bar"
        if item["clipped"]:
            low, high = (value / _PASCALS for value in item["commanded"])
            yield (
                "",
                f"{name} is clipped: {low:.4g} to {high:.4g} bar was commanded; what is missing is part of D",
            )


def _files(files: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    for label, path in zip(["files", *[""] * len(files)], files, strict=False):
        yield label, str(path)
