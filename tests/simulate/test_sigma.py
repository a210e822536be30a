"""A run that meets a zero of sigma, where no input acts, ends with a status and finite rows, not with NaN."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import run
from pmjoint_codegen.simulate.settings import make_settings


@pytest.fixture(scope="module")
def vanishing(root: Path, tmp_path_factory: pytest.TempPathFactory) -> ClosedLoop:
    """Return the paper's loop with an input that fades out towards y = 1.2, the reference beyond."""
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    text = text.replace('sigma = "1"', 'sigma = "1.2 - y"').replace(
        "x0          = [1.5, 0.0]", "x0 = [0.5, 0.0]"
    )
    text = text.replace('"sin(t)"', '"2*sin(t)"').replace("0.1*sin(x2)*cos(t)", "0")
    path = tmp_path_factory.mktemp("sigma") / "vanishing.toml"
    path.write_text(text, encoding="utf-8")
    return ClosedLoop.load(path, "interpreted")


def test_the_continuous_controller_stops_at_the_zero(vanishing: ClosedLoop) -> None:
    with pytest.raises(SimulationError, match="sigma") as caught:
        vanishing.simulate(horizon=3.0)
    found = caught.value.run
    assert found is not None
    assert found.status in (Status.STALLED, Status.NON_FINITE)  # type: ignore[attr-defined]
    assert np.all(np.isfinite(found.states))  # type: ignore[attr-defined]
    assert 1.19 < found["y"][-1] <= 1.2  # type: ignore[index]


def test_starting_on_the_zero_is_a_status(vanishing: ClosedLoop) -> None:
    for controller in ("continuous", "sampled"):
        settings = make_settings(vanishing.manifest, x0=[1.2, 0.0], horizon=0.1, controller=controller)
        found = run(vanishing.evaluator, settings)
        assert found.status == Status.NON_FINITE
        assert np.all(np.isfinite(found.states))


def test_the_sampled_controller_never_hides_a_nan(vanishing: ClosedLoop) -> None:
    settings = make_settings(vanishing.manifest, horizon=3.0, controller="sampled", sample_time=0.01)
    found = run(vanishing.evaluator, settings)
    assert np.all(np.isfinite(found.states))
    assert np.all(np.isfinite(found["u"]))
