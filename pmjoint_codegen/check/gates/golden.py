"""Golden trajectories: the closed loop as it was when somebody last reviewed it, in ``golden/<name>.csv``.

One row an instant: t, every state of the closed loop, v, 17 digits. The switching instants stand beside it in
``golden/<name>.switches.csv``. A change of behaviour is thus a difference that a reviewer reads; ``pmjoint
check NAME --update-golden`` writes them anew.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.result import Difference, GateResult, Verdict, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.storage import ensure_folder, write_text
from pmjoint_codegen.workspace import GENERATED, generated_root

Array = npt.NDArray[np.float64]

NAME = "trajectory.golden"
ACCURACY = 1e-9  # what a trajectory must agree to, relative to max(1, |value|); the same for instants, s
TOLERANCE = 1e-13  # local error of the runs: small enough for the accuracy above over the whole horizon
ROWS = 201  # instants that are kept, at most

Switches = tuple[tuple[float, int], ...]


@dataclass(frozen=True)
class Trajectory:
    """States and v at some instants, and when u entered or left its limits.

    Attributes:
        names: of the columns after t.
        t: instants, s, shape (rows,).
        values: shape (rows, columns).
        switches: (t in s, mode label).
    """

    names: tuple[str, ...]
    t: Array
    values: Array
    switches: Switches


def default_run(
    evaluator: Evaluator, parameters: dict[str, float] | None = None, output_step: float | None = None
) -> Run:
    """The model's own run, as exactly as the integrator can.

    Args:
        evaluator: of the model's kernels.
        parameters: other values of some parameters, as the kernels take them.
        output_step: another than the model's, s.
    """
    settings = make_settings(
        evaluator.manifest,
        parameters=evaluator.manifest.written(parameters or {}),
        output_step=output_step,
        tolerance=TOLERANCE,
    )
    return run(evaluator, settings)


def trajectory_of(done: Run) -> Trajectory:
    """What a golden file keeps of a run."""
    rows = kept_rows(len(done.t))
    names = tuple(item.name for item in done.manifest.states)
    values = np.column_stack([done.states, done["v"]])
    return Trajectory((*names, "v"), done.t[rows], values[rows], done.switches)


def kept_rows(count: int) -> list[int]:
    """Which of a run's output rows are kept: evenly many, and the last one."""
    every = max(1, -(-(count - 1) // (ROWS - 1)))
    return sorted({*range(0, count, every), count - 1})


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
        ValueError: they are not what :func:`write` writes.
    """
    header, *lines = list(csv.reader(io.StringIO(rows.read_text(encoding="utf-8"))))
    table = np.array([[float(cell) for cell in line] for line in lines]).reshape(-1, len(header))
    _, *instants = list(csv.reader(io.StringIO(switches.read_text(encoding="utf-8"))))
    return Trajectory(
        tuple(header[1:]), table[:, 0], table[:, 1:], tuple((float(t), int(mode)) for t, mode in instants)
    )


def write(subject: Subject) -> tuple[Path, Path]:
    """Write the golden files of a model anew.

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
    """Run the model as its file says and compare with the golden trajectory."""
    remedy = f"pmjoint check {subject.model.name} --update-golden writes it"
    missing = [path for path in paths(subject) if not path.exists()]
    if len(missing) == 2:  # nobody has reviewed a run of this model
        return not_run(NAME, f"no {missing[0]}; {remedy}")
    if missing:
        return failed(NAME, f"{missing[0]} is gone, though its companion is there; {remedy}")
    try:
        golden = read(*paths(subject))
    except (OSError, ValueError) as error:
        return failed(NAME, f"{paths(subject)[0]} is damaged: {error}")
    done = default_run(subject.compiled or subject.interpreted)
    if done.status != Status.DONE:
        return failed(NAME, f"the run ended early: {done.message}")
    result = compare(NAME, golden, trajectory_of(done), "golden")
    if result.verdict is not Verdict.FAILED:
        return result
    deliberate = f"where the model was changed on purpose: {remedy} anew; review the difference"
    return dataclasses.replace(result, findings=(deliberate,))


def compare(
    name: str, expected: Trajectory, found: Trajectory, against: str, scales: Array | None = None
) -> GateResult:
    """Hold one trajectory against another, switching instants included.

    Args:
        name: of the gate.
        expected: the reference.
        found: what the integrator gave.
        against: what the reference is, for people.
        scales: what each entry is held relative to, shape (rows, columns); max(1, |value|) unless told.
    """
    if expected.names != found.names or not np.array_equal(expected.t, found.t):
        return failed(
            name,
            f"columns or instants are not those of the {against} trajectory",
        )
    modes = [mode for _, mode in expected.switches], [mode for _, mode in found.switches]
    if modes[0] != modes[1]:
        first = Difference(
            "run", "modes of saturation", "", str(expected.switches), str(found.switches), "", ""
        )
        return failed(name, f"other saturation switches than the {against} trajectory", difference=first)
    relative_to = np.maximum(1.0, np.abs(expected.values)) if scales is None else scales
    error = np.abs(found.values - expected.values) / relative_to
    error = np.where(np.isnan(error), np.inf, error)
    row, column = (int(i) for i in np.unravel_index(np.argmax(error), error.shape))
    late = [abs(a - b) for (a, _), (b, _) in zip(expected.switches, found.switches, strict=True)]
    worst = max(float(error[row, column]), *late) if late else float(error[row, column])
    counts = f"{len(error)} rows and {len(late)} switching instants"
    detail = f"largest difference from the {against} trajectory, {counts}"
    if worst <= ACCURACY:
        return passed(name, detail, worst, ACCURACY)
    return failed(name, detail, worst, ACCURACY, _difference(expected, found, late, error, row, column))


def _difference(
    expected: Trajectory, found: Trajectory, late: list[float], error: Array, row: int, column: int
) -> Difference:
    bound = f"{ACCURACY:g}"
    if late and max(late) > error[row, column]:
        i = late.index(max(late))
        return Difference(
            "run",
            f"switch {i + 1}",
            "",
            str(expected.switches[i]),
            str(found.switches[i]),
            f"{late[i]:.3g} s",
            f"{bound} s",
        )
    a, b = float(expected.values[row, column]), float(found.values[row, column])
    return Difference(
        "run",
        expected.names[column],
        f"t={float(expected.t[row])!r} s",
        repr(a),
        repr(b),
        f"{error[row, column]:.3g} of its scale",
        bound,
    )
