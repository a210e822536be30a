"""Windows of holds: one look of the guard serves many holds, where the guard does not look at w.

The compiled loop takes the same way, so its runs agree bit for bit with those whose looks are counted here.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.kernels import interpreted
from pmjoint_codegen.loops import sampled
from pmjoint_codegen.manifest import Manifest

MODELS = {  # whether one look serves many holds
    "paper": True,
    "third-order": True,
    "joint-lag": True,
    "joint": False,
    "joint-damped": False,
    "joint-exact": False,
}


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts of what the interpreted loop does at its holds."""
    count: Counter[str] = Counter()
    plain = {
        name: getattr(sampled.SampledLoop, name) for name in ("shown", "covered", "hold_miss", "long_hold")
    }

    def shown(self: Any, c: Any, w: Any, length: float) -> bool:
        before = Counter(count)
        found: bool = plain["shown"](self, c, w, length)
        count["hold"] += 1
        looked = count["look"] - before["look"]
        way = "seen" if not looked else f"look {looked}" if found else "nothing"
        count[way] += 1
        return found

    def covered(self: Any, *arguments: Any) -> bool:
        count["window"] += 1
        found: bool = plain["covered"](self, *arguments)
        return found

    def hold_miss(self: Any, *arguments: Any) -> float:
        count["look"] += 1
        found: float = plain["hold_miss"](self, *arguments)
        return found

    def long_hold(self: Any, *arguments: Any) -> None:
        count["long"] += 1
        plain["long_hold"](self, *arguments)

    for name, watched in (
        ("shown", shown),
        ("covered", covered),
        ("hold_miss", hold_miss),
        ("long_hold", long_hold),
    ):
        monkeypatch.setattr(sampled.SampledLoop, name, watched)
    return count


def both(model: str, given: dict[str, Any], settings: dict[str, Any]) -> int:
    """Run a model interpreted and compiled, compare, and give the number of steps."""
    one, other = (
        ClosedLoop.load(model, kind, notify=lambda line: None, **given).simulate(
            controller="sampled", **settings
        )
        for kind in ("interpreted", "compiled")
    )
    assert np.array_equal(one.states, other.states)
    assert (one.steps, one.ise, one.settling_s) == (other.steps, other.ise, other.settling_s)
    assert one.peaks == other.peaks
    return one.steps


@pytest.mark.parametrize("model", MODELS)
def test_a_guard_serves_many_holds_only_where_no_w_changes_it(root: Path, model: str) -> None:
    folder = root / "generated" / model
    manifest = Manifest.read(folder)
    evaluator = interpreted.load(folder, manifest)
    p = np.array([item.value for item in manifest.parameters])
    point = np.array([0.3]), np.full(manifest.nx, 0.1)
    discs = p, np.array([0.01]), np.full(manifest.nx, 0.02)
    at_rest, driven = (
        evaluator.call("plant_guard", *point, np.full(manifest.nw, w), *discs)[0] for w in (0.0, 3.0)
    )
    assert np.array_equal(at_rest, driven) == MODELS[model] == manifest.windows


def test_one_look_serves_holds_under_other_w(looks: Counter[str]) -> None:
    steps = both("paper", {}, dict(x0=[1.5, 0.0], horizon=1.0, sample_time=0.002))
    assert steps == looks["hold"] == 500
    assert looks["seen"] > 5 * looks["look 1"] > 0
    assert looks["nothing"] == looks["long"] == 0


def test_a_guard_that_looks_at_w_looks_at_every_hold(looks: Counter[str]) -> None:
    both("joint-damped", {}, dict(horizon=0.2, sample_time=0.002))
    assert 0 < looks["hold"] <= looks["look"]
    assert looks["window"] == looks["seen"] == 0


def test_where_a_window_is_too_wide_a_hold_looks_at_its_own_discs(looks: Counter[str]) -> None:
    """A bump of 20 ms: a window of 32 holds around it sees it, a hold beside it need not."""
    bump = {"disturbance": ("0", "0.5*exp(-((t-0.5)/0.02)**2)")}
    both("paper", bump, dict(x0=[0.0, 0.0], horizon=1.0, sample_time=0.002))
    own = looks["look 2"] + looks["look 3"] + looks["look 4"]
    assert own > 0 and looks["seen"] > 0 and looks["look 1"] > 0


def test_where_no_disc_shows_a_hold_it_takes_the_longer_way(looks: Counter[str]) -> None:
    pulse = {"disturbance": ("0", "5*exp(-((t-0.1237)/0.0005)**2)")}
    steps = both("paper", pulse, dict(x0=[0.0, 0.0], horizon=0.2, sample_time=0.002))
    assert 0 < looks["nothing"] <= looks["long"]  # in some the coefficients themselves forbid one step
    assert looks["look"] >= 4 * looks["nothing"]  # the window and three discs
    assert steps > looks["hold"]


def test_after_the_longer_way_there_is_a_window_again(looks: Counter[str]) -> None:
    both("paper", {"disturbance": ("0", "0.1*sign(t-0.1003)")}, dict(horizon=0.3, sample_time=0.002))
    assert looks["long"] == 2  # that of the kink and the next, which a disc as wide would reach
    assert looks["look 1"] >= 2  # before the kink and behind it
