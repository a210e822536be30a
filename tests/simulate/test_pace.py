"""The warning that a law is too fast for its sample time, and its remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.simulate.pace import LIMIT, too_fast

JOINTS = ("joint", "joint-damped", "joint-exact", "joint-lag", "third-order")


def values(loop: ClosedLoop, **changes: float) -> dict[str, float]:
    return {item.name: item.value for item in loop.manifest.parameters} | changes


@pytest.fixture(scope="module")
def lag() -> ClosedLoop:
    return ClosedLoop.load("joint-lag")


@pytest.mark.parametrize("sample_time", [0.005, 0.01])
def test_the_joint_with_lag_is_too_fast_in_volts(lag: ClosedLoop, sample_time: float) -> None:
    """What the line warns of happens, and its remedy, the model's own scale, removes both."""
    line = too_fast(lag.manifest, values(lag, input_scale=1.0), sample_time)
    assert line is not None and "\n" not in line
    assert line.startswith("b_m/input_scale is 436 1/s") and 'input_scale = "auto", which is 436' in line
    try:
        run = lag.simulate(controller="sampled", sample_time=sample_time, parameters={"input_scale": 1.0})
        assert not run.summary["held"] or run.summary["max_abs_e"] > 1
    except SimulationError:
        pass
    assert too_fast(lag.manifest, values(lag), sample_time) is None
    assert lag.simulate(controller="sampled", sample_time=sample_time).summary["held"]


def test_a_fast_pole_is_named_with_a_sample_time_that_suffices(lag: ClosedLoop) -> None:
    fast = values(lag, k1=900.0, k2=270000.0, k3=27e6)
    line = too_fast(lag.manifest, fast, 0.01)
    assert line is not None and line.startswith("the fastest pole of the filters is 300 1/s")
    assert "slower gains" in line and "at most 0.0014 s" in line
    assert too_fast(lag.manifest, fast, 0.0013) is None
    line = too_fast(lag.manifest, values(lag, c2=200.0), 0.01)
    assert line is not None and line.startswith("the fastest rate of the errors z is 200 1/s")


@pytest.mark.parametrize("name", ("paper", *JOINTS))
def test_no_shipped_model_is_too_fast_for_10_ms(name: str) -> None:
    loop = ClosedLoop.load(name)
    assert too_fast(loop.manifest, values(loop), 0.01) is None
    assert too_fast(loop.manifest, values(loop), 0.01 * 3 * LIMIT / 0.15) is not None


@pytest.mark.parametrize("sample_time", [None, 0.001, 0.005, 0.01])
@pytest.mark.parametrize("name", JOINTS)
def test_every_joint_tracks_at_the_rate_of_a_bench(name: str, sample_time: float | None) -> None:
    """Max |e| <= 5e-3 rad from t = 1 s on, continuous and sampled."""
    loop = ClosedLoop.load(name)
    if sample_time is None:
        run = loop.simulate()
    else:
        run = loop.simulate(controller="sampled", sample_time=sample_time)
    assert run.summary["status"] == "done" and run.t[-1] == run.settings.horizon
    assert np.abs(run["e"][run.t >= 1.0]).max() <= 5e-3


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_auto_is_the_same_model_in_the_unit_in_which_b_m_is_1(
    root: Path, tmp_path: Path, controller: str
) -> None:
    """third-order in a unit of u that is b_m times smaller, written by hand: b/b_m, b_m u_max, scale 1."""
    text = (root / "models" / "third-order.toml").read_text()
    b_m = 43.6 * 0.05 / 0.1
    text = text.replace('name   = "third-order"', 'name = "by-hand"').replace('"auto"', "1")
    text = text.replace("value = 43.6,", f"value = {43.6 / b_m!r},").replace(
        "u_max = { value = 5.0,", f"u_max = {{ value = {5.0 * b_m!r},"
    )
    file = tmp_path / "by-hand.toml"
    file.write_text(text)
    sample_time = 0.005 if controller == "sampled" else None
    own, hand = (
        ClosedLoop.load(model).simulate(controller=controller, sample_time=sample_time)
        for model in ("third-order", str(file))
    )
    for name, factor in {"x1": 1.0, "x2": 1.0, "v": b_m, "u": b_m, "z1": 1.0, "z2": b_m, "r1": 1.0}.items():
        difference = np.abs(factor * own[name] - hand[name]).max()
        assert difference <= 1e-9 * np.abs(hand[name]).max(), name
