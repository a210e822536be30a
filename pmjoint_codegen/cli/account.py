"""A run in a short table: how it ended, when u was saturated, peaks, settling, error, files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pmjoint_codegen.cli.terminal import table

if TYPE_CHECKING:
    from pmjoint_codegen.simulate.run import Run

_SHOWN = 8  # switches in the table; summary.json holds all of them
_MODES = {-1: "at -{limit}", 0: "inside its limits", 1: "at {limit}"}


def account(run: Run, notes: Sequence[str], files: Sequence[Path]) -> str:
    """Give the table.

    Args:
        run: what to tell of.
        notes: changes that the run itself does not know to be changes.
        files: what was written, all of it in one folder.
    """
    rows = [*_head(run, notes), *_saturation(run), *_peaks(run), *_tracking(run), *_files(files)]
    return f"{run.manifest.name}: {run.manifest.title}\n{table(rows)}"


def _head(run: Run, notes: Sequence[str]) -> Iterator[tuple[str, ...]]:
    from pmjoint_codegen.simulate.assumptions import changes, settings_text, source_is_silent

    yield "run", f"{run.settings.controller} controller, {run.evaluator} kernels"
    yield "status", f"{run.summary['status']}: {run.message} ({run.steps} steps in {run.wall_s * 1e3:.3g} ms)"
    silent = source_is_silent(run)
    yield (
        ("assumed" if silent else "settings"),
        settings_text(run) + (" (not stated in the paper)" if silent else ""),
    )
    changed = [*changes(run), *notes]
    if changed:
        yield "changed", ", ".join(changed)


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
    settled = summary["settling_s"]
    yield (
        "settling",
        "e starts at 0" if settled is None else f"{settled:.6g} s (last |e| > 2 % of the initial |e|)",
    )
    yield "ISE", f"{summary['ise']:.6g} {unit}^2 s"
    yield "max |e|", f"{summary['max_abs_e']:.6g} {unit}"
    yield "final e", f"{summary['final_e']:.6g} {unit}"


def _files(files: Sequence[Path]) -> Iterator[tuple[str, ...]]:
    for label, path in zip(["files", *[""] * len(files)], files, strict=False):
        yield label, str(path)
