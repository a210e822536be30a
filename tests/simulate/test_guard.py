"""Steps that see what is inside them: narrow features along whole runs, both loops, both evaluators."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.loops import continuous
from pmjoint_codegen.loops.constants import DEFECT
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run

WINDOW = "0.25*(tanh(50*(t-5)) - tanh(50*(t-7)))"
QUIET = ("0", "0")


def load(evaluator: str, reference: str, disturbance: tuple[str, str]) -> ClosedLoop:
    return ClosedLoop.load(
        "paper", evaluator, reference=reference, disturbance=disturbance, notify=lambda line: None
    )


FEATURES: dict[str, tuple[str, tuple[str, str], list[float]]] = {
    "window of the reference at rest": (WINDOW, ("0", "0.1*sin(x2)*cos(t)"), [0.0, 0.0]),
    "millisecond of disturbance": ("0", ("0", "9*exp(-((t-3.3)/0.001)**2)"), [0.0, 0.0]),
    "millisecond in motion": ("sin(t)", ("0", "9*exp(-((t-3.3)/0.001)**2)"), [1.5, 0.0]),
    "bump over the angle": ("sin(t)", ("0", "3*exp(-10000*(x1-0.5)**2)"), [1.5, 0.0]),
    "friction": ("sin(t)", ("0", "-0.5*tanh(100*x2)"), [1.5, 0.0]),
    "pulse that carries the angle over a bump": (
        "exp(-4*(t-3)**2)",
        ("0", "-2*exp(-10000*(x1-0.5)**2)"),
        [0.0, 0.0],
    ),
}


@pytest.mark.parametrize("name", FEATURES)
def test_polynomials_follow_the_right_hand_side_all_along(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 200 points of every step: what guard and points of comparison leave open, each 10 tolerances."""
    reference, disturbance, x0 = FEATURES[name]
    loop = load("interpreted", reference, disturbance)
    rates = loop.evaluator.kernel("closed_loop")
    tolerance, worst = 1e-9, 0.0
    accept = continuous._Loop.accept

    def watched(self: Any, values: Any, following: Any, tau: float, end: float) -> None:
        nonlocal worst
        g = self.actuation(self.progress.mode)
        for part in np.linspace(0.0, 1.0, 201):
            worst = max(
                worst,
                self.stepper.defect(self.c, self.progress.t, g, part * tau, tau, self.scales) / tolerance,
            )
        accept(self, values, following, tau, end)

    monkeypatch.setattr(continuous._Loop, "accept", watched)
    run = loop.simulate(x0=x0, horizon=6.0, tolerance=tolerance, output_step=1.0)
    assert run.status == Status.DONE
    assert 0.0 < worst <= 2 * DEFECT
    assert callable(rates)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_is_seen_at_default_settings(name: str, controller: str) -> None:
    """As with steps so short that none can be stepped over."""
    reference, disturbance, x0 = FEATURES[name]
    loop = load("compiled", reference, disturbance)
    settings: dict[str, Any] = dict(
        x0=x0, horizon=6.0, output_step=0.05, controller=controller, sample_time=0.01
    )
    run, fine = loop.simulate(**settings), loop.simulate(**settings, tolerance=1e-13, max_step=2e-4)
    scale = 1.0 + max(fine.peaks[state.name][0] for state in loop.manifest.states)
    assert np.max(np.abs(run.states - fine.states)) <= 2e-8 * scale
    assert run.ise == pytest.approx(fine.ise, rel=1e-7, abs=1e-12)
    assert run.peaks["v"][0] == pytest.approx(fine.peaks["v"][0], rel=1e-6)
    assert run.steps < 0.2 * fine.steps


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_the_interpreted_loop_takes_the_same_steps(controller: str) -> None:
    settings: dict[str, Any] = dict(x0=[0.0, 0.0], horizon=5.2, controller=controller, sample_time=0.05)
    one, other = (
        load(kind, WINDOW, ("0", "-0.5*tanh(100*x2)")).simulate(**settings)
        for kind in ("compiled", "interpreted")
    )
    assert np.array_equal(one.states, other.states)
    assert (one.steps, one.ise, one.settling_s) == (other.steps, other.ise, other.settling_s)
    assert one.peaks == other.peaks


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_no_step_is_longer_than_was_asked(controller: str) -> None:
    loop = load("compiled", "0", QUIET)
    run = loop.simulate(horizon=1.0, controller=controller, sample_time=0.01, max_step=1e-3)
    assert run.steps >= 1000


def test_what_e_does_is_reported_from_between_the_output_instants() -> None:
    loop = load("compiled", "sin(t)", ("0", "0.1*sin(x2)*cos(t)"))
    coarse, fine = (loop.simulate(output_step=step) for step in (5.0, 0.001))
    for key in ("max_abs_e", "settling_s", "ise", "max_abs_v", "peaks"):
        assert coarse.summary[key] == fine.summary[key]
    assert fine.summary["max_abs_e"] == pytest.approx(np.max(np.abs(fine["e"])), rel=1e-6)
    outside = fine.t[np.abs(fine["e"]) > 0.02 * abs(fine["e"][0])]
    assert outside[-1] <= fine.summary["settling_s"] <= outside[-1] + 0.001


def test_a_step_in_all_but_name_is_stepped_up_to() -> None:
    """1e-9 s wide: rounding of t is all that limits what can be seen."""
    run = load("compiled", "0", ("0", "tanh(1e9*(t-0.7))")).simulate(x0=[0.0, 0.0], horizon=1.0)
    jump = load("compiled", "0", ("0", "sign(t-0.7)")).simulate(x0=[0.0, 0.0], horizon=1.0)
    assert np.max(np.abs(run.states - jump.states)) < 1e-8


def test_what_no_step_resolves_is_said() -> None:
    loop = load("compiled", "0", ("0", "1/(t-0.5)"))
    with pytest.raises(
        SimulationError, match=r"stalled at t = 0\.5 s: no step that time can resolve"
    ) as caught:
        loop.simulate(x0=[0.0, 0.0], horizon=1.0)
    run = caught.value.run
    assert isinstance(run, Run) and run.status == Status.STALLED
