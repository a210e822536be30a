"""ADRC against its observer and law typed in again, and what it does on a joint read by an encoder."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop, sweep
from pmjoint_codegen.errors import ModelError, UsageError

JOINT = Path(__file__).with_name("joint-adrc.toml")
Load = Callable[..., ClosedLoop]


@pytest.fixture(scope="module")
def load(tmp_path_factory: pytest.TempPathFactory) -> Load:
    environment = {**os.environ, "PMJOINT_CACHE": str(tmp_path_factory.mktemp("cache"))}
    return lambda file, evaluator=None: ClosedLoop.load(
        file, evaluator=evaluator, environment=environment, notify=lambda line: None
    )


@pytest.fixture(scope="module")
def joint(load: Load) -> ClosedLoop:
    return load(JOINT)


@dataclass(frozen=True)
class Case:
    """A plant of order n, and its loop by hand: drift_i(y), b_0 sigma(y), eta_i and the known part."""

    order: int
    plant: str
    drift: Callable[[float], tuple[float, ...]]
    drive: Callable[[float], float]
    derivatives: Callable[[Any], tuple[float, ...]]  # of x_hat -> eta_0 ... eta_n
    limit: float = 4.0


def _second(x: Any) -> tuple[float, ...]:
    # y' = x2 - y^2, y'' = x3' - 2 y y' with x2' = 0.2 y
    rate = x[1] - x[0] ** 2
    return x[0], rate, 0.2 * x[0] - 2 * x[0] * rate


def _third(x: Any) -> tuple[float, ...]:
    # y' = x2 - 0.5 y, x2' = x3 + sin y, x3' = 0.3 y
    first = x[1] - 0.5 * x[0]
    second = x[2] + np.sin(x[0]) - 0.5 * first
    return x[0], first, second, 0.3 * x[0] + np.cos(x[0]) * first - 0.5 * second


CASES = (
    Case(
        1,
        'order = 1\nphi = ["0.2*y"]\nb = ["b0"]\nsigma = "2 + sin(y)"\ndisturbance = ["0.5"]',
        lambda y: (0.2 * y,),
        lambda y: 2.0 * (2 + np.sin(y)),
        lambda x: (x[0], 0.2 * x[0]),
        0.3,
    ),
    Case(
        2,
        'order = 2\nphi = ["-y**2", "0"]\nPhi = [["0"], ["y"]]\ntheta = ["d1"]\nb = ["b0"]\n'
        'disturbance = ["0", "0.5"]',
        lambda y: (-(y**2), 0.2 * y),
        lambda y: 2.0,
        _second,
    ),
    Case(
        3,
        'order = 3\nphi = ["-0.5*y", "sin(y)", "0.3*y"]\nb = ["b0"]\ndisturbance = ["0", "0", "0.5"]',
        lambda y: (-0.5 * y, np.sin(y), 0.3 * y),
        lambda y: 2.0,
        _third,
    ),
)
TEXT = """
schema = 1
name   = "adrc-{n}"
[parameters]
d1    = {{ value = 0.2 }}
b0    = {{ value = 2.0 }}
u_max = {{ value = {limit} }}
[plant]
{plant}
[actuator]
limit = "u_max"
[design]
law = "adrc"
c = {c}
observer = 12
[simulation]
reference = "sin(t)"
x0 = {x0}
horizon = 3.0
output_step = 0.1
"""
C, OBSERVER = (4.0, 3.0, 2.0), 12.0
BINOMIAL = {1: (2, 1), 2: (3, 3, 1), 3: (4, 6, 4, 1)}


def _file(case: Case, folder: Path) -> Path:
    n = case.order
    x0 = [0.6, 0.2, 0.0][:n]
    text = TEXT.format(n=n, plant=case.plant, c=list(C[:n]), x0=x0, limit=case.limit)
    file = folder / f"adrc-{n}.toml"
    file.write_text(text, encoding="utf-8")
    return file


def _law(case: Case, t: float, y: float, s: np.ndarray) -> float:
    n = case.order
    eta = case.derivatives(s)
    y_r = [np.sin(t + i * np.pi / 2) for i in range(n + 1)]
    a = np.poly([-c for c in C[:n]])[1:][::-1]  # of s^0, s^1, ...
    wanted = y_r[n] - sum(a[i] * (eta[i] - y_r[i]) for i in range(n))
    v = (wanted - eta[n] - s[n]) / case.drive(y)
    return float(np.clip(v, -case.limit, case.limit))


def _observer(case: Case, y: float, u: float, s: np.ndarray) -> np.ndarray:
    n = case.order
    gains = np.array([count * OBSERVER**i for i, count in enumerate(BINOMIAL[n], start=1)])
    known = np.array([*case.drift(y), 0.0])
    known[n - 1] += case.drive(y) * u
    return np.asarray(np.array([*s[1:], 0.0]) + known + gains * (y - s[0]))


def _plant(case: Case, x: np.ndarray, u: float) -> np.ndarray:
    found = np.asarray(np.array([*x[1:], 0.0]) + np.array(case.drift(x[0])))
    found[-1] += case.drive(x[0]) * u + 0.5
    return found


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"n = {case.order}")
@pytest.mark.parametrize("evaluator", ["compiled", "interpreted"])
def test_continuous_runs_agree_with_the_loop_typed_in(
    case: Case, evaluator: str, load: Load, tmp_path: Path
) -> None:
    n = case.order

    def rates(t: float, X: np.ndarray) -> np.ndarray:
        x, s = X[:n], X[n:]
        u = _law(case, t, x[0], s)
        return np.concatenate([_plant(case, x, u), _observer(case, x[0], u, s)])

    loop = load(_file(case, tmp_path), evaluator)
    run = loop.simulate()
    start = np.concatenate([[0.6, 0.2, 0.0][:n], np.zeros(n + 1)])
    exact = solve_ivp(rates, (0.0, 3.0), start, method="LSODA", t_eval=run.t, rtol=1e-11, atol=1e-12)
    names = [*(f"x{i}" for i in range(1, n + 1)), *(f"eso{i}" for i in range(1, n + 2))]
    assert [item.name for item in loop.manifest.states] == names
    assert run.summary["saturation_switches"]  # the start from 0 saturates
    np.testing.assert_allclose(np.stack([run[name] for name in names]), exact.y, atol=2e-6)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"n = {case.order}")
def test_sampled_runs_step_the_observer_along_its_rate(case: Case, load: Load, tmp_path: Path) -> None:
    n, T = case.order, 0.01
    run = load(_file(case, tmp_path)).simulate(controller="sampled", sample_time=T, output_step=T)
    x, s = np.array([0.6, 0.2, 0.0][:n]), np.zeros(n + 1)
    for k in range(200):
        u = _law(case, k * T, x[0], s)
        found = [
            run[name][k]
            for name in (*(f"x{i + 1}" for i in range(n)), *(f"eso{i + 1}" for i in range(n + 1)))
        ]
        np.testing.assert_allclose(found, [*x, *s], atol=1e-8)
        s = s + T * _observer(case, x[0], u, s)
        held = solve_ivp(lambda t, X, u=u: _plant(case, X, u), (0, T), x, rtol=1e-12, atol=1e-13)
        x = held.y[:, -1]


def late(joint: ClosedLoop, **values: float) -> tuple[float, float]:
    """Rms of e in degrees over the last 5 s, and of the change of u from sample to sample, bar."""
    run = joint.simulate(controller="sampled", parameters=values)
    last = run.t > 15 - 1e-9
    rms = float(np.sqrt(np.mean(run["e"][last] ** 2)))
    return float(np.rad2deg(rms)), float(np.sqrt(np.mean(np.diff(run["u"][last]) ** 2)))


HEAVY = {"b0_plant": 87 / 1.5, "d1_plant": -127 / 1.5}


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ({}, 0.009),
        (HEAVY, 0.025),
        ({**HEAVY, "load": -15.0, "drag": 2.2 / 1.5}, 0.047),
        ({**HEAVY, "load": -15.0, "drag": 2.2}, 0.061),
        ({"b0_plant": 0.46 * 87}, 0.644),
        ({"b0_plant": 1.84 * 87}, 0.262),
        ({"d1_plant": -40.0}, 0.424),
    ],
)
def test_the_joint_at_one_kilohertz_with_an_encoder(
    joint: ClosedLoop, values: dict[str, float], wanted: float
) -> None:
    assert round(late(joint, **values)[0], 3) == wanted


def test_half_the_bandwidth_calms_the_valve(joint: ClosedLoop) -> None:
    fast, slow = late(joint)[1], late(joint, observer=60.0)[1]
    assert round(fast, 3) == 0.018 and round(slow, 3) == 0.003


def test_an_unmodelled_lag_of_10_ms_does_no_harm(load: Load, tmp_path: Path) -> None:
    text = JOINT.read_text(encoding="utf-8").replace('limit = "u_max"', 'limit = "u_max"\nlag = 0.01')
    file = tmp_path / "lag.toml"
    file.write_text(text, encoding="utf-8")
    found = late(load(file), **HEAVY, load=-15.0, drag=2.2 / 1.5)[0]
    assert round(found, 3) == 0.062


def test_a_sweep_computes_what_single_runs_do(joint: ClosedLoop, tmp_path: Path) -> None:
    import pmjoint_codegen

    asked: dict[str, Any] = {"controller": "sampled", "horizon": 1.0}
    data = pmjoint_codegen.sweep(JOINT, grid={"observer": [60.0, 120.0]}, out=tmp_path / "runs", **asked)
    single = [joint.simulate(parameters={"observer": w}, **asked).summary["ise"] for w in (60.0, 120.0)]
    np.testing.assert_allclose(np.ravel(data["ise"]), single, rtol=1e-9)


def test_the_controller_steps_like_the_run(joint: ClosedLoop) -> None:
    run = joint.simulate(controller="sampled", horizon=0.2)
    control = joint.controller(sample_time=1e-3)
    found = [control.step(float(y)) for y in run["y_m"][:-1]]
    np.testing.assert_allclose(found, run["u"][:-1], atol=1e-12)


def test_the_matched_start_is_that_of_a_plant_at_rest(load: Load, tmp_path: Path) -> None:
    run = load(_file(CASES[1], tmp_path)).simulate(start="matched", horizon=0.1)
    found = [run[f"eso{i}"][0] for i in (1, 2, 3)]
    np.testing.assert_allclose(found, [0.6, 0.36, 0.0], rtol=1e-15)  # 0 = x2 - y^2


def test_an_export_is_refused(tmp_path: Path) -> None:
    from pmjoint_codegen.export.statements import program_of
    from pmjoint_codegen.modelfile import model_of
    from pmjoint_codegen.modelfile.reader import read_document
    from pmjoint_derive import derive

    with pytest.raises(ModelError, match=r'law = "adrc" is not exported.*give law = "backstepping"'):
        program_of(derive(model_of(read_document(JOINT), "")))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("compensator", 1.0, r'compensator: law = "adrc" is clipped plainly; allowed: 0 \(off\)'),
        ("input_scale", 3.0, 'input_scale: means nothing to law = "adrc"; allowed: the model\'s own'),
    ],
)
def test_a_run_refuses_what_means_nothing_to_the_law(
    joint: ClosedLoop, name: str, value: float, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        joint.simulate(parameters={name: value})
    own = joint.manifest.written({item.name: item.value for item in joint.manifest.parameters})[name]
    assert joint.simulate(parameters={name: own}, horizon=0.1).steps


def test_a_run_refuses_a_compensator_that_the_law_has_not(joint: ClosedLoop, load: Load) -> None:
    with pytest.raises(UsageError, match='compensator: law = "adrc" is clipped plainly'):
        joint.simulate(compensator=True)
    with pytest.raises(UsageError, match='saturation: law = "adrc" is clipped plainly'):
        ClosedLoop.load(JOINT, saturation="compensator")
    assert joint.simulate(compensator=False, horizon=0.1).summary["saturation"] == "clip"
    assert ClosedLoop.load(JOINT, saturation="clip").simulate(horizon=0.1).summary["saturation"] == "clip"


@pytest.mark.parametrize(
    ("varied", "message"),
    [
        ({"grid": {"compensator": [0, 1]}}, 'compensator: law = "adrc" is clipped plainly'),
        ({"grid": {"saturation": ["clip", "compensator"]}}, 'saturation: law = "adrc" is clipped plainly'),
        ({"grid": {"input_scale": [1, 2]}}, 'input_scale: means nothing to law = "adrc"'),
        (
            {"sample": {"input_scale": "uniform(1,2)"}, "runs": 4},
            'input_scale: means nothing to law = "adrc"',
        ),
    ],
)
def test_a_sweep_refuses_to_vary_what_means_nothing_to_the_law(
    varied: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=message):
        sweep(str(JOINT), out=tmp_path / "sweep", **varied)
