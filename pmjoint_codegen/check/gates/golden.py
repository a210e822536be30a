"""Golden trajectories: the closed loop as last reviewed, in ``golden/<name>.csv``.

One row per instant: t, every state of the closed loop, v, 17 digits. The switching instants are beside it in
``golden/<name>.switches.csv``. So a reviewer sees a change of behaviour as a difference of these files;
``pmjoint check NAME --update-golden`` rewrites them.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from pathlib import Path

import numpy as np

from pmjoint_codegen.check.result import GateResult, Verdict, failed, not_run
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import Trajectory, compare, default_run, trajectory_of
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.storage import ensure_folder, write_text
from pmjoint_codegen.workspace import GENERATED, generated_root


def paths(subject: Subject) -> tuple[Path, Path]:
    """The golden files of a model under check."""
    return files_of(subject.file, subject.model.name)


def files_of(file: Path, name: str) -> tuple[Path, Path]:
    """The golden files of a model file: beside ``generated/``."""
    root = generated_root(file)
    folder = (root.parent if root.name == GENERATED else root) / "golden"
    return folder / f"{name}.csv", folder / f"{name}.switches.csv"


def read(rows: Path, switches: Path) -> Trajectory:
    """Read golden files.

    Raises:
        OSError: they are missing.
        ValueError: they do not have the format of :func:`write`.
    """
    header, *lines = list(csv.reader(io.StringIO(rows.read_text(encoding="utf-8"))))
    table = np.array([[float(cell) for cell in line] for line in lines]).reshape(-1, len(header))
    _, *instants = list(csv.reader(io.StringIO(switches.read_text(encoding="utf-8"))))
    return Trajectory(
        tuple(header[1:]), table[:, 0], table[:, 1:], tuple((float(t), int(mode)) for t, mode in instants)
    )


def write(subject: Subject) -> tuple[Path, Path]:
    """Rewrite the golden files of a model.

    Raises:
        UsageError: they cannot be written.
    """
    found = trajectory_of(default_run(subject.compiled or subject.interpreted))
    rows, switches = paths(subject)
    ensure_folder(rows.parent)
    lines = [",".join(("t", *found.names))]
    lines += [
        ",".join(repr(float(x)) for x in (t, *values))
        for t, values in zip(found.t, found.values, strict=True)
    ]
    write_text(rows, "\n".join(lines) + "\n")
    instants = ["t,mode", *(f"{t!r},{mode}" for t, mode in found.switches)]
    write_text(switches, "\n".join(instants) + "\n")
    return rows, switches


def check(subject: Subject) -> GateResult:
    """Run the model with its file's settings and compare with the golden trajectory."""
    remedy = f"pmjoint check {subject.model.name} --update-golden writes it"
    missing = [path for path in paths(subject) if not path.exists()]
    if len(missing) == 2:  # nobody has reviewed a run of this model
        return not_run(f"no {missing[0]}; {remedy}")
    if missing:
        return failed(f"{missing[0]} is gone, though its companion is there; {remedy}")
    try:
        golden = read(*paths(subject))
    except (OSError, ValueError) as error:
        return failed(f"{paths(subject)[0]} is damaged: {error}; {remedy} anew")
    done = default_run(subject.compiled or subject.interpreted)
    if done.status != Status.DONE:
        return failed(f"the run ended early: {done.message}")
    result = compare(golden, trajectory_of(done), "golden")
    if result.verdict is not Verdict.FAILED:
        return result
    deliberate = f"where the model was changed on purpose: {remedy} anew; review the difference"
    return dataclasses.replace(result, findings=(deliberate,))
