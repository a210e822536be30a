"""What keys do to each other: a sensor and the start, a clock and break points, units and the input scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop

MODEL = """
schema = 1
name = "together"
parameters = { d1 = { value = -4.0 }, b0 = { value = 20.0 }, u_max = { value = 3.0 } }
[plant]
order = 2
Phi = [["0"], ["y"]]
theta = ["d1"]
b = ["b0"]
[actuator]
limit = "u_max"
[design]
bandwidth = 6
input_scale = "auto"
start = "matched"
[simulation]
reference = { steps = [[0, 0.3], [0.2, 0.5]], filter = 40 }
x0 = [0.33, 0.6]
horizon = 0.4
output_step = 0.005
sample_time = 0.005
"""
READ = "[sensor]\nresolution = 0.1\n"


@pytest.fixture(params=["compiled", "interpreted"])
def evaluator(request: pytest.FixtureRequest) -> str:
    if request.param == "interpreted":
        pytest.importorskip("casadi")
    return str(request.param)


def loaded(folder: Path, text: str, evaluator: str) -> ClosedLoop:
    file = folder / "together.toml"
    file.write_text(text, encoding="utf-8")
    return ClosedLoop.load(file, evaluator=evaluator)


def test_a_matched_start_takes_what_the_sensor_reads(tmp_path: Path, evaluator: str) -> None:
    run = loaded(tmp_path, MODEL + READ, evaluator).simulate()
    assert run["y"][0] == 0.33
    assert run["y_m"][0] == run["x_hat1"][0] == pytest.approx(0.3, abs=1e-15)
    assert run["z1"][0] == pytest.approx(0.0, abs=1e-15)
    ideal = loaded(tmp_path, MODEL + READ, evaluator).simulate(controller="continuous")
    assert ideal["x_hat1"][0] == 0.33


def test_late_samples_take_the_reference_of_the_controllers_own_clock(tmp_path: Path, evaluator: str) -> None:
    """A break point between k T and the late sample is passed for the plant, and not for the controller."""
    text = MODEL.replace("[0.2, 0.5]", "[0.20001, 0.5]") + "jitter = 0.0008\n[sensor]\nseed = 3\n"
    run = loaded(tmp_path, text, evaluator).simulate()
    late = run.t >= 0.2
    assert np.max(np.abs(np.diff(run["y_r"][late]))) > 0.01  # the break point is among the samples
    np.testing.assert_array_equal(run["u"], np.clip(run["v"], -3.0, 3.0))  # what was sent, and v at k T


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_auto_is_a_joint_in_the_unit_in_which_b_m_is_1(controller: str) -> None:
    """The unit of u enters a joint by k_u and u_max alone."""
    loop = ClosedLoop.load("joint-lag")
    values = {item.name: item.value for item in loop.manifest.parameters}
    kappa = values["input_scale"]
    hand = {"k_u": values["k_u"] / kappa, "u_max": values["u_max"] * kappa, "input_scale": 1.0}
    auto, other = (
        loop.simulate(parameters=given, controller=controller, sample_time=0.005, horizon=6.0)
        for given in (None, hand)
    )
    for name, factor in (("y", 1.0), ("v", kappa), ("z2", kappa), ("r3", 1.0)):
        peak = np.max(np.abs(other[name]))
        assert np.max(np.abs(factor * auto[name] - other[name])) <= 1e-9 * peak, name
