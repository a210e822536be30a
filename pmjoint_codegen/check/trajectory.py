"""Trajectories for comparison by gates: states and v at some instants, and when u met its limits."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.check.result import Difference, GateResult, failed, passed
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import Settings, make_settings

Array = npt.NDArray[np.float64]

ACCURACY = 1e-9  # required agreement of a trajectory, relative to max(1, |value|); the same for instants, s
# Local errors of the runs; the first that a run can keep is taken: high gains may leave more rounding in v.
TOLERANCES = (1e-13, 1e-12, 1e-11)
ROWS = 201  # instants kept, at most

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
    evaluator: Evaluator,
    parameters: dict[str, float] | None = None,
    output_step: float | None = None,
    x0: Array | None = None,
) -> Run:
    """The model's own run, as exact as the integrator allows.

    Args:
        evaluator: of the model's kernels.
        parameters: other values of some parameters, as the kernels take them.
        output_step: an override of the model's, s.
        x0: other initial states.
    """
    settings = make_settings(
        evaluator.manifest,
        parameters=evaluator.manifest.written(parameters or {}),
        output_step=output_step,
        x0=x0,
        controller="continuous",  # theory and heyoka have no clock
    )
    return exact_run(evaluator, settings)


def exact_run(evaluator: Evaluator, settings: Settings) -> Run:
    """A run as exact as the integrator can make it, whatever tolerance the settings have.

    The accuracy that a comparison requires does not depend on the tolerance taken.
    """
    for tolerance in TOLERANCES:
        done = run(evaluator, dataclasses.replace(settings, tolerance=tolerance))
        if done.status != Status.STALLED:
            break
    return done


def trajectory_of(done: Run) -> Trajectory:
    """The part of a run that a golden file keeps."""
    rows = kept_rows(len(done.t))
    names = tuple(item.name for item in done.manifest.states)
    values = np.column_stack([done.states, done["v"]])
    return Trajectory((*names, "v"), done.t[rows], values[rows], done.switches)


def kept_rows(count: int) -> list[int]:
    """The output rows of a run that are kept: evenly spaced, and the last one."""
    every = max(1, -(-(count - 1) // (ROWS - 1)))
    return sorted({*range(0, count, every), count - 1})


def compare(expected: Trajectory, found: Trajectory, against: str, scales: Array | None = None) -> GateResult:
    """Check one trajectory against another, switching instants included.

    Args:
        expected: the reference.
        found: the integrator's result.
        against: name of the reference, for messages.
        scales: scale of each entry's error, shape (rows, columns); max(1, |value|) by default.
    """
    if expected.names != found.names or not np.array_equal(expected.t, found.t):
        return failed(
            f"columns or instants are not those of the {against} trajectory",
        )
    modes = [mode for _, mode in expected.switches], [mode for _, mode in found.switches]
    if modes[0] != modes[1]:
        first = Difference(
            "run", "modes of saturation", "", str(expected.switches), str(found.switches), "", ""
        )
        return failed(f"other saturation switches than the {against} trajectory", difference=first)
    relative_to = np.maximum(1.0, np.abs(expected.values)) if scales is None else scales
    error = np.abs(found.values - expected.values) / relative_to
    error = np.where(np.isnan(error), np.inf, error)
    row, column = (int(i) for i in np.unravel_index(np.argmax(error), error.shape))
    late = [abs(a - b) for (a, _), (b, _) in zip(expected.switches, found.switches, strict=True)]
    worst = max(float(error[row, column]), *late) if late else float(error[row, column])
    counts = f"{len(error)} rows and {len(late)} switching instants"
    detail = f"largest difference from the {against} trajectory, {counts}"
    if worst <= ACCURACY:
        return passed(detail, worst, ACCURACY)
    first = _difference(expected, found, late, error, row, column)
    return failed(f"{first.entry} differs by {first.error}: {detail}", worst, ACCURACY, first)


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
