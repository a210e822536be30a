"""Joints with other muscles than the paper's, against their physics typed once more and integrated by SciPy.

A sampled run holds u between samples, so the reference needs nothing of the controller but u: it integrates
(1) with the muscles' own forces from hold to hold. Pressures are clipped as in (4).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.summary_table import summary_table
from pmjoint_codegen.simulate.run import Run

Numbers = dict[str, float]
Acceleration = Callable[[float, float, float, float], float]
MODEL = Path(__file__).resolve().parents[2] / "models" / "joint-exact.toml"
J, B_V, R, L0, EPS0 = 0.05, 0.109, 0.015, 0.185, 0.15
C1, C2, C3 = 8.032e-3, -1.285e-2, 3.2e-3


def joint_text(
    *, without: str = "", keep: str = '"damping", "gain"', joint: str = "", parameters: str = ""
) -> str:
    """The file of joint-exact with lines left out and others added."""
    text = MODEL.read_text(encoding="utf-8").replace(
        'keep  = ["damping", "quadratic_gain"]', f"keep = [{keep}]"
    )
    for name in without.split():
        text, count = re.subn(rf"(?m)^{name} +=.*\n", "", text)
        assert count == 1
    text = text.replace("\n[parameters]\n", f"\n{joint}\n[parameters]\n{parameters}\n")
    return text.replace('name   = "joint-exact"', 'name   = "muscles"')


def loaded(folder: Path, text: str, evaluator: str = "interpreted") -> ClosedLoop:
    path = folder / "muscles.toml"
    path.write_text(text, encoding="utf-8")
    return ClosedLoop.load(path, evaluator)


def balance(first: Callable[[float, float], float], second: Callable[[float, float], float]) -> Acceleration:
    """Acceleration by the torques of two muscles, each a function of theta and its pressure."""
    return lambda theta, omega, P1, P2: (-B_V * omega + first(theta, P1) + second(theta, P2)) / J


def paper_force(P: float, eps: float, c1: float = C1) -> float:
    return P * (c1 * eps**2 + C2 * eps + C3)


def hunt_force(P: float, eps: float) -> float:
    x = eps / 0.17
    return 1500.0 * (
        0.257852586017 * (math.exp(-6.4766142989 * x) - 1) + P / 620e3 * math.exp(-1.32087718059 * x**2)
    )


def pulley(
    force: Callable[[float, float], float], side: int, r: float = R, l0: float = L0
) -> Callable[..., float]:
    return lambda theta, P: side * r * force(P, EPS0 + side * r * theta / l0)


def cam(theta: float, P: float) -> float:
    """Muscle 1 on the arm r (1 + theta/4 - theta^2/8): its travel, integrated by hand."""
    travel = R * (theta + theta**2 / 8 - theta**3 / 24)
    return R * (1 + theta / 4 - theta**2 / 8) * paper_force(P, EPS0 + travel / L0)


WITHOUT_LAW = "C1 C2 C3 C4"
AREA = math.pi * 0.012**2 / 4
BRAID = 1 / math.tan(0.42) ** 2, 1 / math.sin(0.42) ** 2
CASES: dict[str, tuple[str, Acceleration]] = {
    "hunt": (
        joint_text(without=WITHOUT_LAW, joint='force = "hunt-20"', parameters='eps_max = { value = 0.17 }'),
        balance(pulley(hunt_force, 1), pulley(hunt_force, -1)),
    ),
    "written": (
        joint_text(
            without=WITHOUT_LAW,
            joint='force = "A*P*exp(-5*eps) - H*tanh(eps) + 3"',
            parameters='A = { value = 1.5e-3, unit = "m^2" }\nH = { value = 90, unit = "N" }',
        ),
        balance(
            pulley(lambda P, eps: 1.5e-3 * P * math.exp(-5 * eps) - 90 * math.tanh(eps) + 3, 1),
            pulley(lambda P, eps: 1.5e-3 * P * math.exp(-5 * eps) - 90 * math.tanh(eps) + 3, -1),
        ),
    ),
    "braid": (
        joint_text(
            without=WITHOUT_LAW,
            joint='force = "chou-hannaford"',
            parameters='D0 = { value = 12, unit = "mm" }\nalpha0 = { value = 0.42, unit = "rad" }',
        ),
        balance(
            *(
                pulley(lambda P, eps: AREA * P * (3 * (1 - eps) ** 2 * BRAID[0] - BRAID[1]), side)
                for side in (1, -1)
            )
        ),
    ),
    "unequal": (
        joint_text(joint="muscle2 = { C1 = 0.012, l0 = 0.2 }\nr2 = 0.0145"),
        balance(
            pulley(paper_force, 1), pulley(lambda P, eps: paper_force(P, eps, 0.012), -1, r=0.0145, l0=0.2)
        ),
    ),
    "cam": (
        joint_text(joint='r1 = "r*(1 + theta/4 - theta**2/8)"'),
        balance(cam, pulley(paper_force, -1)),
    ),
}  # fmt: skip


def clip(value: float, high: float) -> float:
    return min(max(value, 0.0), high)


def reference(
    run: Run, acceleration: Acceleration, period: float, supply: float = 5e5
) -> npt.NDArray[np.float64]:
    """Angle and speed at the samples, from the run's u alone."""
    states = [[run["theta"][0], run["theta_dot"][0]]]
    for u in run["u"][:-1]:
        P1, P2 = clip(2.5e5 + 5e4 * u, supply), clip(2.5e5 - 5e4 * u, supply)

        def rates(_: float, x: npt.NDArray[np.float64], P1: float = P1, P2: float = P2) -> list[float]:
            return [x[1], acceleration(x[0], x[1], P1, P2)]

        found = solve_ivp(rates, (0, period), states[-1], method="DOP853", rtol=1e-11, atol=1e-13)
        states.append(found.y[:, -1].tolist())
    return np.array(states)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("keep", ['"damping", "gain"', ""])
def test_the_run_is_that_of_the_physics(case: str, keep: str, tmp_path: Path) -> None:
    """Whatever the design keeps: the simulated plant is the full physics."""
    text, acceleration = CASES[case]
    loop = loaded(tmp_path, text.replace('keep = ["damping", "gain"]', f"keep = [{keep}]"))
    period = 0.01
    run = loop.simulate(controller="sampled", sample_time=period, output_step=period, horizon=0.8)
    expected = reference(run, acceleration, period)
    assert np.ptp(expected[:, 0]) > 0.05  # it moves
    np.testing.assert_allclose(run["theta"], expected[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["theta_dot"], expected[:, 1], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("lines", "tables", "options"),
    [
        ("", "", {}),
        ("", "", {"controller": "sampled", "sample_time": 0.02}),
        ("tau = 0.05", "", {"controller": "sampled", "sample_time": 0.02}),
        ("", "[sensor]\nnoise = 1e-3\nseed = 1", {"sample_time": 0.02, "parameters": {"eps0_plant": 0.14}}),
        ("tau = 0.05", "[sensor]\nresolution = 1e-3", {"sample_time": 0.02}),
    ],
    ids=["continuous", "sampled", "sampled and lagging", "sensor", "sensor and lagging"],
)
def test_the_reported_forces_are_the_muscles_(
    lines: str, tables: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """At every output instant, also between samples: of the angle and the pressures there."""
    text = CASES["hunt"][0].replace("[parameters]", f"{lines}\n[parameters]", 1) + f"\n{tables}\n"
    run = loaded(tmp_path, text).simulate(horizon=0.5, output_step=0.003, **options)
    rest = run.settings.parameters.get("eps0_plant", EPS0)
    for side, name in ((1, "1"), (-1, "2")):
        eps = rest + side * R * run["theta"] / L0
        expected = [hunt_force(P, e) for P, e in zip(run[f"P{name}"], eps, strict=True)]
        np.testing.assert_allclose(run[f"F{name}"], expected, rtol=1e-11)


def test_a_muscle_that_would_have_to_push_is_said(tmp_path: Path) -> None:
    """A law does not end where the force does; so a run says where it is below 0."""
    loop = loaded(tmp_path, CASES["hunt"][0])
    stretched = loop.simulate(horizon=0.5, parameters={"eps0": 0.05})
    low, high = (float(np.min(stretched["F1"])), float(np.max(stretched["F1"])))
    table = summary_table(stretched, (), ())
    assert stretched.summary["forces"]["F1"] == {"min": low, "max": high}
    assert f"F1 = {low:.4g} to {high:.4g} N at the output instants" in table
    assert low > 0 and "slack" not in table
    slack = loop.simulate(horizon=0.5)  # at rest contracted to 0.15 of at most 0.17
    assert float(np.min(slack["F1"])) < 0
    assert "F1 is below 0: that muscle is slack there" in summary_table(slack, (), ())


def test_a_design_that_keeps_everything_leaves_nothing_to_the_disturbance(tmp_path: Path) -> None:
    run = loaded(tmp_path, CASES["hunt"][0]).simulate(horizon=1.0)
    assert float(np.max(np.abs(run["D2"]))) <= 1e-12 * float(np.max(np.abs(np.gradient(run["x2"], run["t"]))))


@pytest.mark.parametrize("law", ["written out", "equal muscles"])
def test_the_paper_s_muscles_by_other_means_are_the_paper_s(law: str, tmp_path: Path) -> None:
    """The same joint as joint-exact; rounding differs, as products are formed in another order."""
    own = "muscle{0} = {{ C1 = 8.032e-3, C2 = -1.285e-2, C3 = 3.2e-3, l0 = 0.185 }}\nr{0} = 0.015"
    text = {
        "written out": joint_text(joint='force = "P*(C1*eps**2 + C2*eps + C3) + C4"'),
        "equal muscles": joint_text(without="r l0 C1 C2 C3", joint="\n".join(map(own.format, (1, 2)))),
    }[law]
    settings: dict[str, Any] = {"horizon": 4.0, "controller": "sampled", "sample_time": 0.01}
    found = loaded(tmp_path, text).simulate(**settings)
    expected = ClosedLoop.load("joint-exact", "interpreted").simulate(**settings)
    for name in ("theta", "theta_dot", "u", "z2", "P1"):
        size = float(np.max(np.abs(expected[name])))
        np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=1e-11 * size)


HUNT = """
schema = 1
name = "hunt"
[joint]
keep = ["damping", "gain", "torque"]
force = "hunt-20"
torque = "-mgl*sin(theta)"
J = { value = 500, unit = "kg cm^2" }
b_v = { value = 0.109, unit = "N m s/rad" }
r = { value = 15, unit = "mm" }
l0 = { value = 300, unit = "mm" }
eps0 = { value = 8.5, unit = "%" }
k0 = { value = 62, unit = "kPa/V" }
u0 = { value = 5, unit = "V" }
k_u = { value = 62, unit = "kPa/V" }
range = [-1.0, 1.0]
[parameters]
eps_max = { value = 17, unit = "%" }
mgl = { value = 4.709, unit = "N m" }
u_max = { value = 5, unit = "V" }
[actuator]
limit = "u_max"
[sensor]
resolution = 0.0015707963267948967 # 4000 counts
[design]
c = [20, 20]
e = [0.1, 1e-3]
ck = [10, 10]
k = [40, 400]
input_scale = "auto"
[simulation]
reference = "0.3*(1 - cos(t))"
x0 = [0.02, 0.0]
horizon = 12.0
sample_time = 0.01
"""


def test_a_pair_of_festo_muscles_tracks_at_10_ms_with_its_encoder(tmp_path: Path) -> None:
    """Muscles that pull all along, gravity kept, 4000 counts: late error within 5e-3 rad, 0.3 degrees."""
    run = loaded(tmp_path, HUNT).simulate()
    assert run.settings.controller == "sampled" and run.settings.sample_time == 0.01
    assert float(np.max(np.abs(run["e"][run.t > 6.0]))) <= 5e-3
    assert min(float(np.min(run[name])) for name in ("F1", "F2")) > 0
