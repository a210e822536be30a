"""A system's run is the run of its physical rates, which SciPy integrates apart from any transformation."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.provision import provide
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.trajectory import csv_columns
from pmjoint_codegen.sweep.chunks import fill_in
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

Field = Callable[[float, npt.NDArray[np.float64], float], list[float]]

HEAD = """
schema = 1
name = "{name}"
[parameters]
{parameters}
[system]
{system}
[actuator]
limit = "u_max"
{actuator}
[units]
y = "{y}"
u = "{u}"
[design]
bandwidth = {bandwidth}
input_scale = "auto"
start = "matched"
[simulation]
reference = "{reference}"
x0 = {x0}
horizon = 2.0
"""
AXIS = {
    "name": "axis",
    "parameters": """
J = { value = 500, unit = "kg cm^2" }
B = { value = 0.109, unit = "N m s/rad" }
G = { value = 4.7, unit = "N m" }
K = { value = 4.358, unit = "N m/bar" }
S = { value = 6.35, unit = "N m/rad" }
tau = { value = 200, unit = "ms" }
u_max = { value = 2.5, unit = "bar" }
""",
    "system": """
states = ["theta", "omega", "p"]
rates = ["omega", "(K*p - S*theta - B*omega - G*sin(theta))/J", "(u - p)/tau"]
output = "theta"
units = ["rad", "rad/s", "Pa"]
disturbance = ["0", "2*sin(3*t) - 0.1*omega**3 - 0.2*abs(omega + 30)", "100*theta*omega"]
""",
    "actuator": """
dead_zone = 2000
lag = 0.004
""",
    "y": "rad",
    "u": "Pa",
    "bandwidth": "20",
    "reference": "0.3*(1 - cos(2*t))",
    "x0": "[0.1, -0.2, 3e4]",
}
DRAG = {
    "name": "drag",
    "parameters": """
J = { value = 0.05, unit = "kg m^2" }
B = { value = 0.2, unit = "N m s/rad" }
tau = { value = 0.1, unit = "s" }
u_max = { value = 50, unit = "N m" }
""",
    "system": """
states = ["theta", "omega", "p"]
rates = [
    "omega",
    "(p - B*cos(theta)**2*omega - 2*sin(theta))/J",
    "((1 + theta**2)*u - p)/tau - 3*theta*omega",
]
output = "theta"
""",
    "actuator": "",
    "y": "rad",
    "u": "N m",
    "bandwidth": "20",
    "reference": "0.5*sin(t)",
    "x0": "[0.3, 0.5, -1.0]",
}
TWINS = {"J_plant": 600.0, "tau_plant": 250.0, "dead_zone_plant": 3000.0}  # in the file's units


def write(folder: Path, table: dict[str, str]) -> Path:
    path = folder / f"{table['name']}.toml"
    path.write_text(HEAD.format(**table))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("systems")


@pytest.fixture(scope="module")
def axis(folder: Path) -> ClosedLoop:
    return ClosedLoop.load(str(write(folder, AXIS)), notify=lambda line: None)


@pytest.fixture(scope="module")
def drag(folder: Path) -> ClosedLoop:
    return ClosedLoop.load(str(write(folder, DRAG)), notify=lambda line: None)


def axis_rates(J: float, tau: float) -> Field:
    """The rates of the file, SI units, behind the lag of the actuator."""
    B, G, K, S, lag = 0.109, 4.7, 4.358e-5, 6.35, 0.004

    def rates(t: float, s: npt.NDArray[np.float64], delivered: float) -> list[float]:
        theta, omega, p, driven = s
        balance = (K * p - S * theta - B * omega - G * math.sin(theta)) / J
        return [
            omega,
            balance + 2 * math.sin(3 * t) - 0.1 * omega**3 - 0.2 * abs(omega + 30),
            (driven - p) / tau + 100 * theta * omega,
            (delivered - driven) / lag,
        ]

    return rates


def drag_rates(t: float, s: npt.NDArray[np.float64], u: float) -> list[float]:
    theta, omega, p = s
    return [
        omega,
        (p - 0.2 * math.cos(theta) ** 2 * omega - 2 * math.sin(theta)) / 0.05,
        ((1 + theta**2) * u - p) / 0.1 - 3 * theta * omega,
    ]


def integrated(run: Run, rates: Field, names: list[str], held: str, rest: int = 0) -> npt.NDArray[np.float64]:
    """The physical states at the samples, under the inputs of the run."""
    t, u = run.t, run[held]
    state = np.array([run[name][0] for name in names] + [0.0] * rest)
    found = [state]
    for begin, end, value in zip(t[:-1], t[1:], u[:-1], strict=True):
        solved = solve_ivp(
            rates, (begin, end), state, args=(float(value),), method="DOP853", rtol=1e-12, atol=1e-9
        )
        state = solved.y[:, -1]
        found.append(state)
    return np.array(found)


@pytest.mark.parametrize("own", [{}, TWINS], ids=["nominal", "true plant"])
def test_a_sampled_run_is_that_of_the_physical_rates(axis: ClosedLoop, own: dict[str, float]) -> None:
    names = ["theta", "omega", "p"]
    run = axis.simulate(parameters=own, controller="sampled", sample_time=0.01, output_step=0.01)
    rates = axis_rates(own.get("J_plant", 500.0) * 1e-4, own.get("tau_plant", 200.0) * 1e-3)
    expected = integrated(run, rates, names, "u_valve", rest=1)
    assert [run[name][0] for name in names] == pytest.approx([0.1, -0.2, 3e4], rel=1e-12)
    for i, name in enumerate(names):
        size = np.abs(expected[:, i]).max()
        np.testing.assert_allclose(run[name], expected[:, i], atol=1e-8 * size)
    assert np.abs(run["D2"]).max() > 1.0  # the disturbance acts
    assert np.abs(run["u"] - run["u_valve"]).max() == pytest.approx(1000.0 if own else 0.0, abs=1e-9)


def test_physics_that_needs_the_peeling_runs_as_written(drag: ClosedLoop) -> None:
    names = ["theta", "omega", "p"]
    run = drag.simulate(controller="sampled", sample_time=0.005, output_step=0.005)
    expected = integrated(run, drag_rates, names, "u")
    for i, name in enumerate(names):
        np.testing.assert_allclose(run[name], expected[:, i], atol=1e-8 * np.abs(expected[:, i]).max())
    assert abs(run["e"][-1]) < 1e-3
    assert np.abs(run["D3"]).max() == 0.0


def test_the_columns_of_a_continuous_run_obey_the_rates(drag: ClosedLoop) -> None:
    """Central differences of each column, with u and the states of the same row."""
    step = 1e-4
    run = drag.simulate(horizon=0.5, output_step=step)
    names = ["theta", "omega", "p"]
    table = np.column_stack([run[name] for name in names])
    rates = np.array([drag_rates(t, s, u) for t, s, u in zip(run.t, table, run["u"], strict=True)])
    differences = (table[2:] - table[:-2]) / (2 * step)
    calm = run.t[1:-1] > 0.2  # u is within its limits, and smooth
    bend = np.abs(np.diff(rates, 2, axis=0)).max(axis=0)
    assert np.all(np.abs(differences - rates[1:-1])[calm].max(axis=0) <= bend + 1e-9)


def test_both_evaluators_and_a_sweep_start_where_the_file_says(folder: Path, axis: ClosedLoop) -> None:
    other = ClosedLoop.load(str(folder / "axis.toml"), "interpreted", notify=lambda line: None)
    one, two = (loop.simulate(horizon=0.05, output_step=0.01) for loop in (axis, other))
    for name in ("theta", "omega", "p", "u", "D2"):
        np.testing.assert_array_equal(one[name], two[name])
    plan = make_plan(("J_plant=400,600", "omega=-0.5,0.5"), (), None, 0, "latin-hypercube")
    provided = provide(
        str(folder / "axis.toml"), environment=os.environ, notify=lambda line: None, lanes=True
    )
    x0, _ = fill_in(provided.manifest, make_request(provided.manifest, plan), plan.columns(0, plan.runs))
    for row, (J, omega) in zip(x0, ((J, w) for J in (400.0, 600.0) for w in (-0.5, 0.5)), strict=True):
        run = axis.simulate(x0=[0.1, omega, 3e4], parameters={"J_plant": J}, horizon=0.01)
        np.testing.assert_allclose(row[:4], [run[f"x{i}"][0] for i in range(1, 5)], rtol=1e-14)


def test_states_are_columns_and_their_number_is_checked(axis: ClosedLoop) -> None:
    assert csv_columns(axis.manifest)[-5:] == ("theta", "omega", "p", "u_command", "u_valve")
    with pytest.raises(UsageError, match="theta, omega, p, x4"):
        axis.simulate(x0=[0.0])


def test_dry_friction_of_a_system_holds_it(folder: Path) -> None:
    """A block with Coulomb friction in its own speed, no coordinate of the design, sticks and slips."""
    table: dict[str, Any] = {
        **DRAG,
        "name": "block",
        "system": """
states = ["gap", "speed"]
rates = ["speed", "(u - B*speed)/J"]
output = "gap"
disturbance = ["0", "-0.2*sign(speed)/J"]
""",
        "y": "m",
        "bandwidth": "10",
        "reference": "0.1*sin(2*t)",
        "x0": "[0.0, 0.0]",
    }
    loop = ClosedLoop.load(str(write(folder, table)), notify=lambda line: None)
    run = loop.simulate(horizon=4.0)
    assert run.sticks
    for begin, end in run.sticks:
        inside = (run.t > begin) & (run.t < end)
        np.testing.assert_allclose(np.diff(run["gap"][inside]), 0.0, atol=1e-15)
        np.testing.assert_allclose(run["speed"][inside], 0.0, atol=1e-12)
    moving = np.abs(run["speed"]) > 1e-3
    np.testing.assert_allclose(run["D2"][moving], -4.0 * np.sign(run["speed"][moving]), rtol=1e-12)


def test_a_gap_that_is_never_zero_starts_matched(folder: Path) -> None:
    """Sigma is 1/gap**2: filters and coordinates far from it meet no pole, and the run takes few steps."""
    table: dict[str, Any] = {
        **DRAG,
        "name": "magnet",
        "parameters": 'K = { value = 6.5308e-5, unit = "N m^2/A^2" }\nm = { value = 68, unit = "g" }\n'
        'u_max = { value = 9, unit = "A^2" }',
        "system": """
states = ["gap", "speed"]
rates = ["speed", "9.81 - K*u/(2*m*gap**2)"]
output = "gap"
range = [0.001, 0.014]
""",
        "y": "m",
        "u": "A^2",
        "bandwidth": "100",
        "reference": "0.006 + 0.001*(1 - cos(2*t))",
        "x0": "[0.0065, 0.0]",
    }
    loop = ClosedLoop.load(str(write(folder, table)), notify=lambda line: None)
    run = loop.simulate(controller="sampled", sample_time=0.001)
    assert np.abs(run["e"][run.t > 1.0]).max() < 5e-6
    continuous = loop.simulate()
    assert continuous.steps < 1000
    assert np.abs(continuous["e"][continuous.t > 1.0]).max() < 1e-9
