"""Sampled runs with sensor, actuator and clock against a plain loop.

The loop has the law typed in and the plant by matrix exponentials. It shares nothing with the package but the
random numbers, which ``tests/loops/test_chain.py`` checks. Its plant is linear, x' = A x + B w(t), so a hold
is exact; so are the filters' holds.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.loops.chain import normal, uniform
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.provision import provide
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

Array = npt.NDArray[np.float64]

D1, B0 = 0.2, 2.0
C, E, CK, K = (5.0, 4.0), (0.1, 0.2), (1.0, 2.0), (6.0, 8.0)
HEAD = """
schema = 1
name = "bench"
parameters = { d1 = { value = 0.2 }, b0 = { value = 2.0 } }
[plant]
order = 2
Phi = [["0"], ["y"]]
theta = ["d1"]
b = ["b0"]
[design]
c = [5, 4]
e = [0.1, 0.2]
ck = [1, 2]
k = [6, 8]
"""
EVERYTHING = {
    "actuator": "lower = -3\nupper = 5\nrate = 90\ndead_zone = 0.5\nlag = 0.02\ndelay = 0.0133",
    "sensor": "resolution = 0.0015\nnoise = 0.001\nseed = 7\nfilter = 300",
    "simulation": "delay_samples = 1\njitter = 0.001",
}


def write(folder: Path, tables: Mapping[str, str], **run: object) -> Path:
    settings = {"reference": '"sin(t)"', "x0": "[0.5, 0.0]", "horizon": 2.0, "sample_time": 0.005, **run}
    simulation = "\n".join(f"{key} = {value}" for key, value in settings.items())
    text = HEAD + "".join(f"[{name}]\n{lines}\n" for name, lines in tables.items() if name != "simulation")
    path = folder / "bench.toml"
    path.write_text(f"{text}[simulation]\n{simulation}\n{tables.get('simulation', '')}\n", encoding="utf-8")
    return path


def dead(q: float, width: float) -> float:
    return math.copysign(max(abs(q) - width, 0.0), q)


def holds(A: Array, B: Array, tau: float) -> tuple[Array, Array]:
    n, m = B.shape
    whole = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * tau)
    return whole[:n, :n], whole[:n, n:]


def law(y: float, s: Array, y_r: tuple[float, float, float]) -> float:
    """(24), (25), (29) for n = rho = 2, p = 1, phi = 0, as in the paper."""
    xi2, Xi2, lam2, r1, r2 = s[1], s[3], s[5], s[6], s[7]
    z1 = y - y_r[0] - r1
    alpha1 = (-(C[0] + E[0]) * z1 - xi2 - D1 * Xi2 + y_r[1] - CK[0] * r1) / B0
    z2 = lam2 - alpha1 - r2 / B0
    da_dy = -(C[0] + E[0]) / B0
    xi2_dot = -K[1] * s[0] + K[1] * y
    Xi2_dot = -K[1] * s[2] + y
    r1_dot = r2 - CK[0] * r1
    y_dot = xi2 + D1 * Xi2 + B0 * lam2
    alpha_dot = (
        da_dy * y_dot
        - xi2_dot / B0
        - D1 * Xi2_dot / B0
        + (C[0] + E[0]) / B0 * (y_r[1] + r1_dot)
        + y_r[2] / B0
        - CK[0] * r1_dot / B0
    )
    v = -(C[1] + E[1] * da_dy**2) * z2 - B0 * z1 + K[1] * s[4] + alpha_dot - CK[1] * r2 / B0
    return float(v)


def plain(horizon: float, T: float, x0: tuple[float, float], chain: Mapping[str, float]) -> dict[str, Array]:
    """The run, sample by sample: t, y, v, u, the states at samples."""
    get = {"lower": -10.0, "upper": 10.0, **chain}
    zone, own = get.get("dead_zone", 0.0), get.get("dead_zone_plant", get.get("dead_zone", 0.0))
    lag, delay, behind = get.get("lag"), get.get("delay", 0.0), int(get.get("delay_samples", 0))
    seed, jitter = get.get("seed", 0), get.get("jitter", 0.0)
    A0 = np.array([[-K[0], 1.0], [-K[1], 0.0]])
    Ar = np.array([[-CK[0], 1.0], [0.0, -CK[1]]])
    F0, G0 = holds(A0, np.eye(2), T)
    Fr, Gr = holds(Ar, np.eye(2), T)
    if lag is None:
        A, B = np.array([[0.0, 1.0], [D1, 0.0]]), np.array([[0.0], [B0]])
    else:
        A = np.array([[0.0, 1.0, 0.0], [D1, 0.0, B0], [0.0, 0.0, -1.0 / lag]])
        B = np.array([[0.0], [0.0], [1.0 / lag]])
    x, s = np.array([*x0, *([0.0] if lag else [])]), np.zeros(8)
    count = round(horizon / T)
    instants = [k * T + (jitter * uniform(seed, k, 0) if jitter and k else 0.0) for k in range(count + 1)]
    commands: list[float] = []
    found: dict[str, list[Any]] = {name: [] for name in ("t", "x", "s", "v", "u", "y_m", "y_f")}
    before, y_f = 0.0, 0.0
    for k in range(count):
        t = instants[k]
        y_m = x[0] + (get["noise"] * normal(seed, k) if get.get("noise") else 0.0)
        if get.get("resolution"):
            y_m = np.round(y_m / get["resolution"]) * get["resolution"]
        a = get.get("filter")
        y_f = y_m if k == 0 or a is None else y_f + (1.0 - math.exp(-a * T)) * (y_m - y_f)
        v = law(y_f, s, (math.sin(k * T), math.cos(k * T), -math.sin(k * T)))
        q = v + zone * np.sign(v)
        if "rate" in get:
            q = min(max(q, before - get["rate"] * T), before + get["rate"] * T)
        before = q = min(max(q, get["lower"]), get["upper"])
        commands.append(q)
        u = dead(q, zone)
        for name, value in (("t", t), ("x", x), ("s", s), ("v", v), ("u", u), ("y_m", y_m), ("y_f", y_f)):
            found[name].append(value)
        k_vector = np.array(K)
        s = np.concatenate(
            [
                F0 @ s[0:2] + G0 @ (k_vector * y_f),
                F0 @ s[2:4] + G0 @ np.array([0.0, y_f]),
                F0 @ s[4:6] + G0 @ np.array([0.0, u]),
                Fr @ s[6:8] + Gr @ np.array([0.0, B0 * (u - v)]),
            ]
        )
        changes = [
            t,
            *(i + delay for i in instants[: k + 1] if t < i + delay < instants[k + 1]),
            instants[k + 1],
        ]
        for start, end in itertools.pairwise(changes):
            middle = 0.5 * (start + end)
            acted = [j for j in range(k + 1) if instants[j] + delay <= middle]
            source = acted[-1] - behind if acted else -1
            valve = dead(commands[source], own) if source >= 0 else 0.0
            F, G = holds(A, B, end - start)
            x = F @ x + G[:, 0] * valve
    return {name: np.array(values) for name, values in found.items()}


def numbers(tables: Mapping[str, str]) -> dict[str, float]:
    lines = "\n".join(tables.values()).splitlines()
    return {key.strip(): float(value) for key, value in (line.split("=") for line in lines)}


CASES: dict[str, dict[str, str]] = {
    "limits": {"actuator": "lower = -0.5\nupper = 2\nrate = 1e6"},
    "one-sided": {"actuator": "lower = 0\nupper = 2\nrate = 50"},
    "dead zone": {"actuator": "limit = 4\ndead_zone = 0.7"},
    "rate": {"actuator": "limit = 10\nrate = 20"},
    "delay of whole samples": {"actuator": "limit = 10\ndelay = 0.01"},
    "delay": {"actuator": "limit = 10\ndelay = 0.0133"},
    "delay_samples": {"actuator": "limit = 10", "simulation": "delay_samples = 2"},
    "jitter": {"actuator": "limit = 10", "sensor": "seed = 3", "simulation": "jitter = 0.002"},
    "sensor": {"actuator": "limit = 10", "sensor": "resolution = 0.0015\nnoise = 0.001\nseed = 7"},
    "filter": {"actuator": "limit = 10", "sensor": "filter = 100"},
    "lag": {"actuator": "limit = 10\nlag = 0.02\nrate = 1e9"},
    "bench": {
        "actuator": "limit = 10\nrate = 40\ndelay = 0.0033",
        "sensor": "resolution = 0.0015\nnoise = 0.001\nseed = 11",
    },
    "everything": EVERYTHING,
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_equals_a_plain_loop(case: str, tmp_path: Path, cache: Path) -> None:
    tables, T = CASES[case], 0.005
    loop = ClosedLoop.load(write(tmp_path, tables), notify=lambda line: None)
    run = loop.simulate(controller="sampled", output_step=T, tolerance=1e-14)
    chain = numbers(tables)
    if "limit" in chain:
        chain |= {"lower": -chain["limit"], "upper": chain["limit"]}
    expected = plain(2.0, T, (0.5, 0.0), chain)
    rows = slice(0, len(expected["t"]))
    # A row shows the sample at or before it: with jitter the one before.
    shift = 1 if "jitter" in chain else 0
    own, theirs = slice(shift, rows.stop), slice(0, rows.stop - shift)
    for name in (
        "v",
        "u",
        *(["y_m"] if "y_m" in run.columns else []),
        *(["y_f"] if "y_f" in run.columns else []),
    ):
        scale = max(1.0, float(np.max(np.abs(expected[name]))))
        assert np.max(np.abs(run[name][own] - expected[name][theirs])) <= 1e-12 * scale, name
    controller = np.column_stack([run[item.name] for item in loop.manifest.states[loop.manifest.nx :]])
    assert np.max(np.abs(controller[own] - expected["s"][theirs])) <= 1e-12
    if not shift:
        plant = np.column_stack([run[item.name] for item in loop.manifest.states[: loop.manifest.nx]])
        assert np.max(np.abs(plant[rows] - expected["x"])) <= 1e-12


def test_the_interpreted_run_has_the_same_bits(tmp_path: Path, cache: Path) -> None:
    path = write(tmp_path, EVERYTHING, horizon=0.6)
    runs = [
        ClosedLoop.load(path, kind, notify=lambda line: None).simulate()
        for kind in ("compiled", "interpreted")
    ]
    assert runs[0].columns == runs[1].columns
    for column in runs[0].columns:
        assert runs[0][column].tobytes() == runs[1][column].tobytes(), column
    assert runs[0].peaks == runs[1].peaks
    assert (runs[0].ise, runs[0].settling_s, runs[0].steps) == (
        runs[1].ise,
        runs[1].settling_s,
        runs[1].steps,
    )


def test_every_run_of_a_sweep_equals_the_single_run(tmp_path: Path, cache: Path) -> None:
    path = write(tmp_path, EVERYTHING)
    loop = ClosedLoop.load(path, notify=lambda line: None)
    provided = provide(path, environment=os.environ, notify=lambda line: None, lanes=True)
    axes = {
        "sample_time": (0.004, 0.005),
        "noise": (0.0, 0.002),
        "seed": (3.0, 4.0),
        "dead_zone_plant": (0.2, 0.7),
        "delay_samples": (0.0, 2.0),
    }
    plan = make_plan(tuple(f"{name}={a},{b}" for name, (a, b) in axes.items()), (), None, 0, "sobol")
    request = make_request(provided.manifest, plan, tolerance=1e-11, output_step=0.2)
    library = library_of(make_inputs(provided.folder), os.environ)
    found = simulate_chunk(library, request, plan.columns(0, plan.runs))
    columns = plan.columns(0, plan.runs)
    names = [item.name for item in loop.manifest.states]
    for i in range(plan.runs):
        values = {name: float(column[i]) for name, column in columns.items()}
        period = values.pop("sample_time")
        run = loop.simulate(parameters=values, sample_time=period, output_step=0.2, tolerance=1e-12)
        expected = np.column_stack([run[name] for name in (*names, "v", "e")])
        assert np.max(np.abs(found.trajectories[i] - expected)) <= 1e-9 * np.max(np.abs(expected))
        assert found.table[i, Column.MAX_ABS_V] == pytest.approx(run.peaks["v"][0], rel=1e-9)
        assert found.table[i, Column.ISE] == pytest.approx(run.ise, rel=1e-8)


def test_continuous_control_sees_the_valve_and_the_lag(tmp_path: Path, cache: Path) -> None:
    """Against SciPy: the same law, the valve as its definition says, no event search."""
    tables = {"actuator": "lower = -2\nupper = 5\ndead_zone = 0.5\nlag = 0.02"}
    path = write(tmp_path, tables, horizon=1.0)
    loop = ClosedLoop.load(path, notify=lambda line: None)
    run = loop.simulate(parameters={"dead_zone_plant": 0.7}, output_step=0.01, tolerance=1e-12)

    def rates(t: float, X: Array) -> Array:
        y, s = X[0], X[3:]
        v = law(y, s, (math.sin(t), math.cos(t), -math.sin(t)))
        q = min(max(v + 0.5 * np.sign(v), -2.0), 5.0)
        u, valve = dead(q, 0.5), dead(q, 0.7)
        xi, Xi, lam, r = s[0:2], s[2:4], s[4:6], s[6:8]
        return np.array(
            [
                *(X[1], D1 * y + B0 * X[2], (valve - X[2]) / 0.02),
                *(xi[1] + K[0] * (y - xi[0]), K[1] * (y - xi[0])),
                *(Xi[1] - K[0] * Xi[0], y - K[1] * Xi[0]),
                *(lam[1] - K[0] * lam[0], u - K[1] * lam[0]),
                *(r[1] - CK[0] * r[0], B0 * (u - v) - CK[1] * r[1]),
            ]
        )

    start = np.array([0.5, *[0.0] * 10])
    found = solve_ivp(rates, (0.0, 1.0), start, "DOP853", run.t, rtol=1e-11, atol=1e-12, max_step=1e-3).y.T
    assert np.max(np.abs(run.states - found)) < 2e-6  # SciPy steps over the valve's jumps
    assert run["u_command"].min() == -2.0
    assert np.any((run["u"] != 0.0) & (run["u_valve"] == 0.0))


def test_a_sweep_of_the_continuous_loop_has_each_run_s_valve(tmp_path: Path, cache: Path) -> None:
    tables = {"actuator": "lower = -2\nupper = 5\ndead_zone = 0.5"}
    path = write(tmp_path, tables)
    loop = ClosedLoop.load(path, notify=lambda line: None)
    provided = provide(path, environment=os.environ, notify=lambda line: None, lanes=True)
    plan = make_plan(("dead_zone_plant=0.2,0.5,0.9", "upper=0.3,2,5"), (), None, 0, "sobol")
    request = make_request(provided.manifest, plan, tolerance=1e-11, output_step=0.1)
    library, columns = library_of(make_inputs(provided.folder), os.environ), plan.columns(0, plan.runs)
    found = simulate_chunk(library, request, columns).trajectories
    for i in range(plan.runs):
        values = {name: float(column[i]) for name, column in columns.items()}
        run = loop.simulate(parameters=values, output_step=0.1, tolerance=1e-12)
        expected = np.column_stack([run.states, run["v"], run["e"]])
        assert np.max(np.abs(found[i] - expected)) <= 1e-9 * np.max(np.abs(expected)), values


def test_the_continuous_controller_leaves_out_what_needs_a_clock_and_says_so(
    tmp_path: Path, cache: Path
) -> None:
    loop = ClosedLoop.load(write(tmp_path, EVERYTHING), notify=lambda line: None)
    ideal = loop.simulate(controller="continuous")
    assert ideal.summary["left_out"] == [
        *("rate", "delay", "resolution", "noise", "seed", "filter", "delay_samples", "jitter")
    ]
    assert np.array_equal(ideal["y_m"], ideal["y"])
    assert loop.simulate().summary["left_out"] == []
    assert loop.simulate().settings.controller == "sampled"


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"rate": 0.0}, "rate: is 0; allowed: a number greater than 0"),
        ({"dead_zone": -1.0}, "dead_zone: is -1; allowed: a number, 0 or greater"),
        ({"seed": 1.5}, "seed: is 1.5; allowed: a whole number, 0 or greater"),
        ({"delay_samples": -1.0}, "delay_samples: is -1; allowed: a whole number, 0 or greater"),
        ({"upper": -4.0}, "upper: no room is left for u: upper - lower = -1; allowed: lower below upper"),
        ({"lower": 1.0}, "lower: a dead zone lies around 0: -lower = -1"),
        ({"jitter": 0.005}, "jitter: is 0.005 s, and the sample time 0.005 s"),
        ({"delay": 6000.0}, "delay: is 6000, more than 1000000 samples; allowed: at most 5000"),
        ({"delay_samples": 2e6}, "delay_samples: is 2e+06, more than 1000000 samples"),
    ],
)
def test_a_bad_value_is_one_line(
    parameters: dict[str, float], told: str, tmp_path: Path, cache: Path
) -> None:
    loop = ClosedLoop.load(write(tmp_path, EVERYTHING), "interpreted", notify=lambda line: None)
    with pytest.raises(UsageError) as caught:
        loop.simulate(parameters=parameters)
    assert str(caught.value).startswith(told)
