"""The quasi-static design of the bellows against the whole strip with its mass, as docs/gallery.md says.

The sampled controller is written out here but for the law itself; SciPy integrates the plant.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from docs import gallery
from pmjoint_codegen import ClosedLoop

SYSTEMS = {system.model: system for system in gallery.systems()}
DESIGN = SYSTEMS["bellows"]
FILE = tomllib.loads(DESIGN.file.read_text(encoding="utf-8"))
s, h, b1, b2, b3, c, g, u_low, u_max = (float(line["value"]) for line in FILE["parameters"].values())
T = FILE["simulation"]["sample_time"]
M, D = 3.986e-8, 4e-5  # of the strip: kg m^4, N m^2 s
ROWS = 4  # a hold

Plant = Callable[[Sequence[float], float], list[float]]


def moment(y: float) -> float:
    """Moment of the bent strip, N m, without the factor s."""
    return float((b1 + b2 * np.tanh(b3 * y) ** 2) * y)


def stiffness(y: float) -> float:
    """Its derivative, N m^2."""
    bent = np.tanh(b3 * y)
    return float(b1 + b2 * bent**2 + 2 * b2 * b3 * y * bent * (1 - bent**2))


def drift(y: float) -> float:
    return -c * moment(y) / stiffness(y)


def without_mass(x: Sequence[float], u: float) -> list[float]:
    return [drift(x[0]) + h * g / s * u / stiffness(x[0])]


def whole(x: Sequence[float], u: float) -> list[float]:
    return [x[1], (h * x[2] - D * x[1] - s * moment(x[0])) / M, g * u - c * x[2]]


def late_error(plant: Plant, start: Sequence[float]) -> float:
    """The largest |e| after 6 s, in 1/m."""
    loop = ClosedLoop.load(DESIGN.file, notify=lambda line: None)
    law = loop.law()
    values = {item.name: item.value for item in loop.manifest.parameters}
    k, ck = values["k1"], values["ck1"]
    x, held = np.array(start), (1 - np.exp(-k * T)) / k
    xi, lamda, r = x[0], 0.0, 0.0
    errors = []
    for n in range(round(FILE["simulation"]["horizon"] / T)):
        y, t = float(x[0]), n * T
        v = law([xi, lamda, r], y, (4 - 2 * np.cos(0.2 * t), 0.4 * np.sin(0.2 * t)))
        u = float(np.clip(v, u_low, u_max))
        times = np.linspace(0, T, ROWS + 1)
        done = solve_ivp(
            lambda _, state, u=u: plant(state, u), (0, T), x, "LSODA", times, rtol=1e-11, atol=1e-11
        )
        errors += [
            abs(row - 4 + 2 * np.cos(0.2 * (t + later)))
            for later, row in zip(times, done.y[0], strict=True)
            if t + later >= 6
        ]
        x = done.y[:, -1]
        xi += held * (k * (y - xi) + drift(y))
        lamda += held * (-k * lamda - u / stiffness(y))
        r += (1 - np.exp(-ck * T)) / ck * (-ck * r + h * g / s / stiffness(y) * (u - v))
    return float(max(errors))


def test_it_gives_the_error_of_the_page_where_there_is_no_mass() -> None:
    found = gallery.outcome(DESIGN, DESIGN.runs[0])
    assert found.late == pytest.approx(late_error(without_mass, [2.0]), rel=1e-6)


def test_the_whole_strip_errs_as_said() -> None:
    found = late_error(whole, [2.0, 0.0, s * moment(2.0) / h])
    match = re.search(r"whole strip\s+in SciPy\s+gives (\S+) 1/m", SYSTEMS["bellows-strip"].published)
    assert match
    assert gallery.said(found, 2) == match[1]
