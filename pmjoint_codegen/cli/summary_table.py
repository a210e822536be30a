"""A short table of a run: how it ended, when u was saturated, peaks, settling, error, files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pmjoint_codegen.cli.terminal import table

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.run import Run

_SHOWN = 8  # switches in the table; summary.json has all of them
_BEYOND = "overflow"  # of a run that failed
_SEEN = "at the output instants"  # for quantities that are no states: in between they may be larger
_PASCALS = 1e5  # in a bar
_MODES = {-1: "at {lower}", 0: "inside its limits", 1: "at {upper}"}


def summary_table(run: Run, notes: Sequence[str], files: Sequence[Path]) -> str:
    """Give the table.

    Args:
        run: the run to describe.
        notes: changes that the run itself cannot recognise as such.
        files: the files written, all in one folder.
    """
    told = (
        _head(run, notes),
        _saturation(run),
        _peaks(run),
        _tracking(run),
        _adaptation(run),
        _disturbance(run),
    )
    rows = [
        *(row for part in told for row in part),
        *_pressures(run),
        *_forces(run),
        *_against(run),
        *_files(files),
    ]
    return f"{run.manifest.name}: {run.manifest.title}\n{table(rows)}"


def _head(run: Run, notes: Sequence[str]) -> Iterator[tuple[str, ...]]:
    from pmjoint_codegen.simulate.assumptions import assumed, changes, remarks, stated

    yield "run", f"{run.settings.controller} controller, {run.evaluator} kernels"
    status = run.summary["status"]
    ended = run.message if run.message.startswith(status) else f"{status}: {run.message}"
    yield "status", f"{ended} ({run.steps} steps in {run.wall_s * 1e3:.3g} ms)"
    assumptions = assumed(run)
    if assumptions:
        yield "assumed", f"{', '.join(assumptions)} (not stated in the paper)"
    for label, items in (("settings", stated(run)), ("changed", (*changes(run), *notes))):
        if items:
            yield label, ", ".join(items)
    for remark in remarks(run):
        yield "note", remark


def _saturation(run: Run) -> Iterator[tuple[str, ...]]:
    starts = [(0.0, run.initial_mode), *run.switches[:_SHOWN]]
    lower, upper = run.manifest.limit_names
    for label, (t, mode) in zip(["u", *[""] * len(starts)], starts, strict=False):
        yield label, f"{_MODES[mode].format(lower=lower, upper=upper)} from {t:.10f} s"
    if len(run.switches) > _SHOWN:
        yield "", f"and {len(run.switches) - _SHOWN} more switches, in summary.json"
    yield "saturated", f"{run.summary['saturated_s']:.6g} s in all"
    if run.manifest.can_hold:
        yield "stuck", f"{run.summary['stuck_s']:.6g} s in all, {len(run.sticks)} times"


def _peaks(run: Run) -> Iterator[tuple[str, ...]]:
    from pmjoint_codegen.simulate.blocks import compensator_states
    from pmjoint_codegen.simulate.record import RATE

    manifest = run.manifest
    units = {item.name: item.unit for item in (*manifest.signals, *manifest.states)}
    names = [RATE] if RATE in run.peaks else [f"x{i}" for i in range(2, manifest.n + 1)]
    names += compensator_states(manifest)
    for label, name in zip(["peaks", *[""] * len(names)], ["v", *names], strict=True):
        size, t = run.peaks[name]
        unit = f" {units[name]}" if units[name] not in ("", "1") else ""
        yield label, f"|{name}| = {size:.6g}{unit} at {t:.6g} s"


def _tracking(run: Run) -> Iterator[tuple[str, ...]]:
    summary = run.summary
    unit = next((item.unit for item in run.manifest.signals if item.name == "y"), "")
    if run.summary["status"] == "done" and not summary["held"]:
        yield "diverging", "u is at its limit and |e| is largest at the end: tracking is lost for good"
    if summary["status"] == "done":
        yield "settling", _settling(summary["settling_s"], float(run["e"][0]), float(run.t[-1]), unit)
    for label, key, of in (("ISE", "ise", "^2 s"), ("max |e|", "max_abs_e", ""), ("final e", "final_e", "")):
        value = summary[key]
        yield label, _BEYOND if value is None else f"{value:.6g} {unit}{of}"


def _settling(settled: float | None, initial: float, end: float, unit: str) -> str:
    """Give the band in y's unit: 2 % of a small initial e may be less than the disturbance's effect on e."""
    if initial == 0.0 or not math.isfinite(initial):
        return "e starts at 0" if initial == 0.0 else _BEYOND
    band = f"{0.02 * abs(initial):.6g} {unit}, 2 % of the initial |e|"
    if settled is None:
        return f"not by {end:.6g} s (|e| > {band})"
    return f"{settled:.6g} s (last |e| > {band})"


def _adaptation(run: Run) -> Iterator[tuple[str, ...]]:
    """Give each estimate at the end beside the plant's own value, and V at both ends."""
    units = {item.name: item.unit for item in (*run.manifest.states, *run.manifest.signals)}
    found = run.summary.get("estimates", {})
    for label, (name, item) in zip(["estimates", *[""] * len(found)], found.items(), strict=False):
        first, final, true = (_number(item[key]) for key in ("first", "final", "true"))
        ends = "" if item["range"] is None else ", kept within {:.6g} to {:.6g}".format(*item["range"])
        yield (
            label,
            f"{name} = {first} to {final} {units[name]}; the plant's {item['of']} = {true}{ends}".rstrip(),
        )
    if "V" in run.summary:
        first, final = (_number(run.summary["V"][key]) for key in ("first", "final"))
        yield "V", f"{first} to {final} {units['V']}".rstrip()


def _number(value: float | None) -> str:
    return _BEYOND if value is None else f"{value:.6g}"


def _disturbance(run: Run) -> Iterator[tuple[str, ...]]:
    """Describe each component of D (12) and its size; |D| only where the proof needs a bound on it."""
    summary, bound = run.summary, run.manifest.disturbance_bound
    if bound is not None:
        largest = summary["disturbance_max"]
        size = _BEYOND if largest is None else f"{largest:.6g}"
        held = largest is not None and largest <= bound
        presumed = f"D_max = {bound:g}{'' if held else ' is exceeded'}"
        yield "max |D|", f"{size} {_SEEN}: unknown to the controller; {presumed}"
    units = {item.name: item.unit for item in run.manifest.signals}
    acting = {name: ends for name, ends in summary["disturbance_range"].items() if ends != [0.0, 0.0]}
    if bound is not None and len(acting) < 2:
        return
    for label, (name, ends) in zip(["D", *[""] * len(acting)], acting.items(), strict=False):
        low, high = (_BEYOND if end is None else f"{end:.6g}" for end in ends)
        what = f" {_SEEN}: {_what(run)}" if label else ""
        yield label, f"{name} = {low} to {high} {units[name]}{what}"


def _what(run: Run) -> str:
    """Name the parts of D: physics that the design neglects, or a disturbance, and the model mismatch."""
    from pmjoint_codegen.simulate.disturbance import mismatched

    names = mismatched(run)
    acting = any(entry != "0" for entry in run.manifest.simulation.disturbance)
    first = "neglected physics" if run.summary["pressures"] else "the model's disturbance"
    parts = ([first] if acting or not names else []) + (
        [f"model mismatch ({', '.join(names)})"] if names else []
    )
    return ", and ".join(parts)


def _pressures(run: Run) -> Iterator[tuple[str, ...]]:
    """Give the range of the muscle pressures, and report commands outside the limits."""
    muscles = run.summary["pressures"] or {}
    for label, (name, item) in zip(("pressures", ""), muscles.items(), strict=False):
        least, greatest, limit = (item[key] / _PASCALS for key in ("min", "max", "P_max"))
        seen = f" {_SEEN}" if label else ""
        yield label, f"{name} = {least:.4g} to {greatest:.4g} bar{seen}, limits 0 and {limit:.4g} bar"
        if item["clipped"]:
            low, high = (value / _PASCALS for value in item["commanded"])
            yield (
                "",
                f"{name} is clipped: {low:.4g} to {high:.4g} bar was commanded; the clipped part adds to D",
            )


def _forces(run: Run) -> Iterator[tuple[str, ...]]:
    """Give the range of the muscles' forces, and say where a muscle would have to push."""
    forces = run.summary.get("forces", {})
    for label, (name, item) in zip(("forces", ""), forces.items(), strict=False):
        seen = f" {_SEEN}" if label else ""
        yield label, f"{name} = {item['min']:.4g} to {item['max']:.4g} N{seen}"
        if item["min"] < 0:
            yield "", f"{name} is below 0: that muscle is slack there, and the law of its force does not hold"


def _against(run: Run) -> Iterator[tuple[str, ...]]:
    """Give the distances from a recorded run."""
    against = run.summary.get("against", {})
    columns = against.get("columns", {})
    for label, (name, item) in zip(["against", *[""] * len(columns)], columns.items(), strict=False):
        unit = f" {item['unit']}" if item["unit"] not in ("", "1") else ""
        seen = f" of {against['file']}" if label else ""
        far = f"rms {item['rms']:.6g}{unit}, at most {item['max']:.6g}{unit} at {item['at']:.6g} s"
        yield label, f"{name}{seen}: {far}"


def _files(files: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    for label, path in zip(["files", *[""] * len(files)], files, strict=False):
        yield label, str(path)
