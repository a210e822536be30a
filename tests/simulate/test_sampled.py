"""The sampled loop: C and its twin bit for bit, the tolerance, peaks, the integral, how a run may end."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels import compiled, interpreted
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import Settings, make_settings

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")
ADAPTIVE = ("paper-adaptive", "joint-load")
EPSILON = np.finfo(float).eps


def settings(evaluator: Evaluator, **asked: Any) -> Settings:
    return make_settings(evaluator.manifest, controller="sampled", **asked)


def simulate(evaluator: Evaluator, **asked: Any) -> Run:
    return run(evaluator, settings(evaluator, **asked))


def pair(root: Path, cache: Path, model: str) -> tuple[Evaluator, Evaluator]:
    """The same model compiled and interpreted."""
    pytest.importorskip("casadi")
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    folder = root / "generated" / model
    manifest = Manifest.read(folder)
    return compiled.load(folder, manifest, compiler, cache), interpreted.load(folder, manifest)


def assert_same(one: Run, other: Run) -> None:
    for name in ("status", "message", "switches", "initial_mode", "peaks", "steps"):
        assert getattr(one, name) == getattr(other, name), name
    assert np.array_equal(one.ise, other.ise, equal_nan=True)
    for name in ("t", "states", "signals"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize(
    "asked",
    [
        {"horizon": 0.3},
        {"horizon": 0.5, "sample_time": 0.05, "output_step": 0.013},
        {"horizon": 0.4, "sample_time": 0.2, "output_step": 0.17, "tolerance": 1e-13},
        {"horizon": 0.0123, "sample_time": 0.01, "output_step": 0.0004},
    ],
    ids=["1 ms", "50 ms", "200 ms", "ends in a hold"],
)
@pytest.mark.parametrize("model", (*MODELS, *ADAPTIVE))
def test_c_and_python_give_the_same_bits(root: Path, cache: Path, model: str, asked: dict[str, Any]) -> None:
    one, other = pair(root, cache, model)
    assert_same(simulate(one, **asked), simulate(other, **asked))


@pytest.mark.parametrize(
    ("limits", "asked", "status"),
    [
        ({"divergence": 1e3}, {"x0": [150.0, 0.0], "horizon": 9.0}, Status.DIVERGED),
        ({"divergence": 1.49}, {"horizon": 0.5}, Status.DIVERGED),  # X(0) is beyond it
        ({"divergence": 1e3}, {"x0": [150.0, 0.0], "horizon": 6.0, "sample_time": 0.001}, Status.DIVERGED),
        ({"max_steps": 25}, {"sample_time": 0.001, "output_step": 0.5}, Status.TOO_MANY_STEPS),
        ({"max_steps": 1}, {"horizon": 0.5, "sample_time": 0.2}, Status.TOO_MANY_STEPS),
        ({"max_switches": 1}, {"horizon": 0.5}, Status.TOO_MANY_SWITCHES),
        ({}, {"horizon": 0.5, "parameters": {"b0": 1e-300}}, Status.NON_FINITE),
        ({"divergence": np.inf}, {"horizon": 0.5, "x0": [1e300, 1e300]}, Status.NON_FINITE),
    ],
)
def test_c_and_python_end_alike(
    root: Path, cache: Path, limits: dict[str, Any], asked: dict[str, Any], status: Status
) -> None:
    one, other = pair(root, cache, "paper")
    wanted = replace(settings(one, **{"sample_time": 0.01, **asked}), **limits)
    found = run(one, wanted)
    assert found.status == status
    assert_same(found, run(other, wanted))


@pytest.mark.parametrize("sample_time", [0.001, 0.03])
@pytest.mark.parametrize(
    ("model", "start"),
    [
        ("paper", (1.5, 0.0)),
        ("paper", (0.1, -0.8)),  # a late peak of x2 alone
        ("paper", (-0.4, 1.6)),  # a late peak of e alone
        ("third-order", (1.9, 0.2)),
    ],
)
def test_rows_do_not_change_the_run(
    root: Path, cache: Path, model: str, start: tuple[float, float], sample_time: float
) -> None:
    """With a row in every hold each sample goes the long way through the C; with one row hardly any does.

    The twin has one way only.
    """
    evaluator, twin = pair(root, cache, model)
    x0 = np.zeros(evaluator.manifest.nx)
    x0[:2] = start
    asked: dict[str, Any] = {"horizon": 4.0, "sample_time": sample_time, "x0": x0}
    many = simulate(evaluator, **asked, output_step=0.7 * sample_time)
    few = simulate(evaluator, **asked, output_step=4.0)
    assert_same(few, simulate(twin, **asked, output_step=4.0))
    np.testing.assert_array_equal(many.states[-1], few.states[-1])
    for name in ("peaks", "ise", "switches", "steps", "status"):
        assert getattr(many, name) == getattr(few, name)


@pytest.mark.parametrize("sample_time", [0.001, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("model", (*MODELS, *ADAPTIVE))
def test_the_error_is_what_the_tolerance_allows(
    root: Path, cache: Path, model: str, sample_time: float
) -> None:
    """Each step adds less than the tolerance; the law carries it on by a factor that no tolerance changes."""
    evaluator, _ = pair(root, cache, model)
    horizon = min(10 * sample_time, 0.5)
    asked: dict[str, Any] = {"horizon": horizon, "sample_time": sample_time, "output_step": horizon / 7}
    best = simulate(evaluator, **asked, tolerance=1e-14)
    size = np.maximum(1.0, np.max(np.abs(best.states), axis=0))
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        found = simulate(evaluator, **asked, tolerance=tolerance)
        rounding = 1e4 * EPSILON
        assert len(found.t) == len(best.t)
        error = np.max(np.abs(found.states - best.states) / size)
        assert error <= tolerance * found.steps + rounding
        assert found.ise == pytest.approx(best.ise, rel=10 * tolerance * found.steps + 1e-9)


@pytest.mark.parametrize("sample_time", [0.001, 0.01, 0.05])
@pytest.mark.parametrize(
    "x0", [(1.5, 0.0), (-0.16, -1.75), (0.05, 1.8)], ids=["at rest", "x1 turns", "e turns"]
)
def test_peaks_and_the_integral_are_those_of_the_motion_in_between(
    compiled_paper: Evaluator, x0: tuple[float, float], sample_time: float
) -> None:
    """Against the plant's rows at 400 instants in every hold, from another path through the loop."""
    inside, horizon = 400, 0.4
    asked: dict[str, Any] = {"horizon": horizon, "sample_time": sample_time, "x0": x0}
    found = simulate(compiled_paper, **asked, output_step=horizon)
    dense = simulate(compiled_paper, **asked, output_step=sample_time / inside)
    step = sample_time / inside
    for name in ("x1", "x2", "e"):
        values = np.abs(dense[name])
        largest, instant = found.peaks[name]
        curvature = np.max(np.abs(np.diff(dense[name], 2))) / step**2  # a kink of x2' counts as curvature
        assert np.max(values) <= largest * (1 + 4 * EPSILON)
        assert largest <= np.max(values) + curvature * step**2 + 4 * EPSILON
        assert np.interp(instant, dense.t, values) == pytest.approx(largest, abs=curvature * step**2)
    held = simulate(compiled_paper, **asked, output_step=sample_time)
    for name in ("xi1", "lambda2", "r2", "v"):  # change at samples, where alone they can be seen
        assert found.peaks[name][0] == np.max(np.abs(held[name]))
        assert found.peaks[name][1] == held.t[np.argmax(np.abs(held[name]))]
    nodes, weights = leggauss(12)
    total = 0.0
    for k in range(round(horizon / sample_time)):
        rows = slice(k * inside, (k + 1) * inside + 1)
        t = dense.t[rows]
        fit = np.polynomial.Chebyshev.fit(t[::16], dense["e"][rows][::16], 14)
        at = t[0] + (nodes + 1) / 2 * (t[-1] - t[0])
        total += float(weights @ fit(at) ** 2) / 2 * (t[-1] - t[0])
    assert found.ise == pytest.approx(total, rel=1e-9)


def test_the_disturbance_acts_between_samples_too(compiled_paper: Evaluator) -> None:
    """D follows the plant's states and the clock at every row, not those of the last sample."""
    found = simulate(compiled_paper, horizon=0.4, sample_time=0.02, output_step=0.005)
    stated = 0.1 * np.sin(found["x2"]) * np.cos(found.t)  # (37)
    assert np.ptp(stated) > 0.1
    assert np.max(np.abs(found["D2"] - stated)) <= 2 * EPSILON
    assert found.summary["disturbance_range"]["D2"] == [found["D2"].min(), found["D2"].max()]


@pytest.mark.parametrize(("model", "period"), [("joint", 0.02), ("joint-damped", 0.02), ("joint-lag", 0.002)])
def test_the_disturbance_of_a_joint_is_that_of_the_held_input(
    root: Path, cache: Path, model: str, period: float
) -> None:
    """D is what x' holds beyond the design's model, with the input that acts there: (12)."""
    loop = ClosedLoop.load(root / "models" / f"{model}.toml", "compiled")
    n, nx, nw = loop.manifest.n, loop.manifest.nx, loop.manifest.nw
    found = loop.simulate(controller="sampled", sample_time=period, output_step=period / 4, horizon=0.2)
    p, t, x = found.settings.p, found.t[:, np.newaxis], found.states[:, :nx]
    limits = loop.evaluator.call("actuation", p)[0].reshape(nw, 4)
    v = found["v"]
    w = np.column_stack([np.clip(o + s * v, low, high) for o, s, low, high in limits])
    sides = np.ones((len(t), dict(loop.manifest.function("plant").inputs)["w"] - nw))
    rates = loop.evaluator.call("plant", t, x, np.column_stack([w, sides]), p)[0]
    values = found.settings.parameters
    a = values["b_v"] / values["J"]
    y, u = found["y"], w[:, 0]
    d1, b0 = coefficients(values)
    if n == 2:
        damping = a if model != "joint" else 0.0
        known = [x[:, 1] - damping * y, d1 * y + b0 * u]
    else:
        tau = values["tau"]
        known = [x[:, 1] - (a + 1 / tau) * y, x[:, 2] + (d1 - a / tau) * y, d1 / tau * y + b0 / tau * u]
    for i, rate in enumerate(known):
        scale = np.max(np.abs(rates[:, i])) + np.max(np.abs(rate))
        assert np.max(np.abs(found[f"D{i + 1}"] - (rates[:, i] - rate))) <= 1e-13 * scale


def coefficients(values: Mapping[str, float]) -> tuple[float, float]:
    """d1 and b0 of (8), without the second k0 that it prints."""
    C1, C2, C3, eps0 = (values[name] for name in ("C1", "C2", "C3", "eps0"))
    J, r, l0, k0, u0, k_u = (values[name] for name in ("J", "r", "l0", "k0", "u0", "k_u"))
    return 2 * k0 * r**2 * u0 * (2 * C1 * eps0 + C2) / (J * l0), 2 * k_u * r * (
        C1 * eps0**2 + C2 * eps0 + C3
    ) / J


def test_a_peak_inside_a_hold_is_found_with_its_instant(undisturbed_joint: ClosedLoop) -> None:
    """D = 0, d1 = 0: under held u the joint is a parabola, so that its turning point is known."""
    period, start, speed = 0.2, 1.0, 0.8
    found = undisturbed_joint.simulate(
        controller="sampled",
        sample_time=period,
        horizon=period,
        output_step=period,
        x0=[start, speed],
        parameters={"d1": 1e-12, "u_max": 3.0},
    )
    assert found["u"][0] == -3.0
    acceleration = 2.0 * -3.0  # b0 u
    assert found.peaks["x1"][0] == pytest.approx(start - speed**2 / (2 * acceleration), rel=1e-11)
    assert found.peaks["x1"][1] == pytest.approx(-speed / acceleration, rel=1e-6)


@pytest.fixture
def undisturbed_joint(root: Path) -> ClosedLoop:
    """Give the paper's model with D = 0."""
    pytest.importorskip("sympy")
    return ClosedLoop.load(root / "models" / "paper.toml", disturbance=["0", "0"])


@pytest.mark.parametrize("expression", ["0.1*sign(x2)", "0.2*abs(x1) - 0.1*sign(x2)*cos(t)"])
def test_kinks_are_followed_alike(expression: str) -> None:
    pytest.importorskip("sympy")
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    one, other = (
        ClosedLoop.load("paper", kind, disturbance=["0", expression]).evaluator
        for kind in ("compiled", "interpreted")
    )
    asked: dict[str, Any] = {"horizon": 0.4, "sample_time": 0.004, "x0": [0.1, 0.0]}
    assert_same(simulate(one, **asked), simulate(other, **asked))


def test_holds_of_a_millisecond_take_one_step_each_in_the_shipped_models(root: Path, cache: Path) -> None:
    runs = {
        name: simulate(evaluator, sample_time=0.001)
        for name in MODELS
        for evaluator in [pair(root, cache, name)[0]]
    }
    holds = {name: round(done.t[-1] / 0.001) for name, done in runs.items()}
    assert sum(holds.values()) == 80_000  # as docs/design.md says
    assert {name: done.steps for name, done in runs.items()} == holds


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
@pytest.mark.parametrize("name", ["joint-damped", "joint-lag"])
def test_the_peak_of_a_joint_s_velocity_does_not_depend_on_the_output(
    root: Path, cache: Path, name: str, controller: str
) -> None:
    both = pair(root, cache, name)
    fine, coarse = (
        run(both[0], make_settings(both[0].manifest, controller=controller, horizon=5.0, output_step=step))
        for step in (0.0005, 5.0)
    )
    assert fine.peaks == coarse.peaks
    peak, when = fine.peaks["theta_dot"]
    column = np.abs(fine["theta_dot"])
    at = int(np.argmax(column))
    assert column[at] <= peak * (1 + 1e-12)
    assert peak - column[at] < 1e-4 * peak and abs(when - fine.t[at]) <= 0.0005
    twin = run(both[1], make_settings(both[1].manifest, controller=controller, horizon=0.2, output_step=0.1))
    assert_same(
        run(both[0], make_settings(both[0].manifest, controller=controller, horizon=0.2, output_step=0.1)),
        twin,
    )
