"""A disturbance with a kink: refused where it would go unseen, simulated where the controller is sampled."""

from __future__ import annotations

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import ModelError, UsageError

FRICTION = ["0", "-0.3*sign(x2) - abs(x1)/10"]


@pytest.fixture(scope="module")
def rough() -> ClosedLoop:
    """Return the paper's loop with dry friction in place of (37)."""
    return ClosedLoop.load("paper", disturbance=FRICTION)


def test_the_continuous_integrator_refuses_it_with_the_reason(rough: ClosedLoop) -> None:
    assert not rough.manifest.analytic
    with pytest.raises(UsageError, match=r"has a kink .* use the sampled controller"):
        rough.simulate(horizon=0.1)


def test_the_sampled_controller_meets_the_friction_that_was_stated(rough: ClosedLoop) -> None:
    run = rough.simulate(controller="sampled", horizon=2.0)
    expected = -0.3 * np.sign(run["x2"]) - np.abs(run["x1"]) / 10
    moving = np.abs(run["x2"]) > 0
    np.testing.assert_allclose(run["D2"][moving], expected[moving], rtol=1e-14)
    assert np.any(run["D2"] > 0) and np.any(run["D2"] < 0)


def test_a_smooth_stand_in_agrees_to_a_hold_s_accuracy(rough: ClosedLoop) -> None:
    """Each time x2 meets its kink, friction may turn one hold late: 2*0.3*T in speed, once for the start."""
    horizon, period = 1.0, 1e-3
    smooth = ClosedLoop.load("paper", disturbance=["0", "-0.3*tanh(x2/1e-5) - abs(x1)/10"])
    first, second = (
        loop.simulate(controller="sampled", horizon=horizon, sample_time=period) for loop in (rough, smooth)
    )
    turns = 1 + np.count_nonzero(np.diff(np.sign(first["x2"])))
    assert np.max(np.abs(first["x1"] - second["x1"])) <= turns * 2 * 0.3 * period * horizon


def test_what_the_controller_knows_must_stay_smooth() -> None:
    with pytest.raises(ModelError, match="abs has a kink"):
        ClosedLoop.load("paper", reference="abs(sin(t))")
