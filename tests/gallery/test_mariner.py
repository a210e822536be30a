"""What docs/gallery.md says of the PID of the ship's source, on the plant of the file, within its limits."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import numpy.typing as npt
from scipy.signal import StateSpace, cont2discrete, tf2ss

from docs import gallery

SHIP = next(system for system in gallery.systems() if system.model == "mariner")
FILE = tomllib.loads(SHIP.file.read_text(encoding="utf-8"))
STEP = FILE["simulation"]["sample_time"]
K, T1, T2, T3 = (FILE["parameters"][name]["value"] for name in ("K", "T1", "T2", "T3"))
TIME_CONSTANT, FREQUENCY = 107.3, 0.05  # of the PID's pole placement: s, rad/s


def pid_error() -> npt.NDArray[np.float64]:
    """Heading minus reference, in deg, shape (samples,): pole placement, feedforward, command 1 s late."""
    plant = StateSpace(*tf2ss([K * T3, K], [T1 * T2, T1 + T2, 1.0, 0.0]))
    a, b, *_ = cont2discrete((plant.A, plant.B, plant.C, plant.D), STEP)
    gain = TIME_CONSTANT / K * FREQUENCY**2
    derivative = TIME_CONSTANT / (K * gain) * (2.0 * FREQUENCY - 1.0 / TIME_CONSTANT)
    integral = 10.0 / FREQUENCY
    corner = FILE["simulation"]["reference"]["filter"]
    (_, _), (start, target) = FILE["simulation"]["reference"]["steps"]
    most = FILE["parameters"]["u_max"]["value"]
    slew = STEP * FILE["parameters"]["slew"]["value"]
    x, wanted = np.zeros(3), np.zeros(3)  # wanted: heading, rate, acceleration of the reference
    rudder, command, total = 0.0, 0.0, 0.0
    errors = []
    for k in range(round(FILE["simulation"]["horizon"] / STEP)):
        heading, rate = (plant.C @ x).item(), (plant.C @ plant.A @ x).item()
        error = heading - wanted[0]
        law = (
            TIME_CONSTANT / K * wanted[2]
            + wanted[1] / K
            - gain * (error + derivative * (rate - wanted[1]) + total / integral)
        )
        errors.append(error)
        rudder += float(np.clip(np.clip(command, -most, most) - rudder, -slew, slew))
        x = a @ x + b[:, 0] * rudder
        total += STEP * error
        command += STEP * (law - command)
        goal = target if k * STEP > start else 0.0
        jerk = corner**3 * (goal - wanted[0]) - 3.0 * corner**2 * wanted[1] - 3.0 * corner * wanted[2]
        wanted = wanted + STEP * np.array([wanted[1], wanted[2], jerk])
    return np.array(errors)


def test_the_sources_pid_errs_as_said() -> None:
    match = re.search(r"errs\s+by\s+up\s+to\s+(\d\.\d)\s+degrees", SHIP.published)
    assert match
    assert f"{np.max(np.abs(pid_error())):.1f}" == match[1]


def test_the_run_of_the_page_errs_ten_times_less() -> None:
    found = gallery.outcome(SHIP, SHIP.runs[0])
    assert found.run.unit == "deg" and found.run.after == 0
    assert found.late is not None
    assert found.late < 0.1 * float(np.max(np.abs(pid_error())))


def test_limits_are_drawn_in_the_unit_of_the_input() -> None:
    found = gallery.outcome(SHIP, SHIP.runs[0])
    lower, upper = gallery.limits(SHIP, found)
    np.testing.assert_allclose([lower, upper], np.radians([-40.0, 40.0]), rtol=1e-12)
    assert lower < float(np.min(found.columns["u"])) < float(np.max(found.columns["u"])) < upper
