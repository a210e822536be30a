"""Runs against heyoka: the model's own, drawn ones, and those of high gain."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen.check import trajectory
from pmjoint_codegen.check.gates import independent
from pmjoint_codegen.check.inputs.drawn import draws
from pmjoint_codegen.check.oracles import heyoka_loop
from pmjoint_codegen.check.oracles.heyoka_kinks import SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.heyoka_loop import Loop, without_narrow_modes
from pmjoint_codegen.check.oracles.program import compile_program, operation_count
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.loops import continuous, polynomial
from pmjoint_codegen.loops.guard import Discs
from pmjoint_codegen.loops.modes import Actuator, make_actuator
from pmjoint_codegen.loops.stepper import Stepper
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.provision import provide, provide_document
from pmjoint_codegen.simulate import fixed
from pmjoint_codegen.simulate.run import run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.start import initial_state


@pytest.fixture(scope="module")
def heyoka() -> Any:
    """The module, where it is installed."""
    return pytest.importorskip("heyoka")


def subject_of(root: Path, model: str) -> Subject:
    """A shipped model."""
    return load_subject(root / "models" / f"{model}.toml", os.environ, lambda _line: None)


@pytest.mark.usefixtures("heyoka")
@pytest.mark.parametrize("model", ["paper", "joint-lag"])  # `pmjoint check` in CI runs it on the others
def test_a_shipped_model_is_held_where_u_saturates(root: Path, cache: Path, model: str) -> None:
    subject = subject_of(root, model)
    if subject.compiler is None:
        pytest.skip("no C compiler")
    result = independent.check(subject)
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)
    assert f"{independent.RUNS[1]} drawn runs with" in result.detail


@pytest.mark.usefixtures("heyoka", "no_ziglang")
def test_a_threshold_that_is_left_by_a_rounding_unseen_is_noticed(
    root: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two limits of a joint round apart for most u_max, not for the model's own; v may stand between them."""

    def exact_zeros_alone(q: Sequence[float], _h: float) -> int:
        return next((k for k, value in enumerate(q) if value != 0.0), len(q) - 1)

    subject = subject_of(root, "joint-damped")
    interpreted = dataclasses.replace(subject, environment={**os.environ, "PATH": ""})
    assert independent.check(interpreted).verdict is Verdict.PASSED
    monkeypatch.setattr(polynomial, "leading_zeros", exact_zeros_alone)
    found = independent.check(interpreted)
    assert found.verdict is Verdict.FAILED
    assert "--set u_max=" in found.detail and "--x0=" in found.detail


def test_equal_models_draw_equal_settings_within_their_ranges(paper: Subject) -> None:
    first, second = (list(islice(draws(paper.manifest), 20)) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert one.limit == other.limit and np.array_equal(one.x0, other.x0)
        assert 2 <= one.limit <= 12 and np.all((np.abs(one.x0) >= 0.01) & (np.abs(one.x0) <= 1.5))
    assert len({one.limit for one in first}) == 20


def test_a_lost_run_and_one_without_saturation_are_not_held(paper: Subject) -> None:
    still = trajectory.Trajectory(("x1", "v"), np.zeros(2), np.zeros((2, 2)), ())
    assert not independent.saturates_and_returns(still)
    assert not independent.saturates_and_returns(dataclasses.replace(still, switches=((0.1, 0), (0.2, 1))))
    returned = dataclasses.replace(still, switches=((0.1, 1), (0.2, 0)))
    assert independent.saturates_and_returns(returned)
    assert not independent.saturates_and_returns(
        dataclasses.replace(returned, values=np.full((2, 2), np.nan))
    )


def test_thresholds_that_round_apart_are_one_and_others_are_not() -> None:
    u, pressure = [0.0, 1.0, -3.0, 3.0], [5.0, 2.0, -1.0, 11.0]
    both = make_actuator(np.array([*u, *pressure]))
    assert list(both.thresholds) == [-3.0, 3.0]
    apart = np.nextafter(3.0, 4.0)
    split = make_actuator(np.array([*u, *pressure[:2], 5 - 2 * apart, 5 + 2 * apart]))
    assert len(split.thresholds) > 2
    merged: Actuator = without_narrow_modes(split)
    np.testing.assert_allclose(merged.thresholds, both.thresholds, rtol=1e-15)
    np.testing.assert_allclose(merged.modes, both.modes, rtol=1e-15)
    assert merged.labels == both.labels == (-1, 0, 1)
    wide = make_actuator(np.array([*u, *pressure[:2], -1.1, 11.1]))
    assert without_narrow_modes(wide).labels == wide.labels == (-1, -1, 0, 1, 1)


def test_v_is_held_relative_to_its_law_s_slopes(heyoka: Any, paper: Subject) -> None:
    """The paper's law is linear in the states: a slope is the difference that a state's whole size makes."""
    done = trajectory.default_run(paper.compiled or paper.interpreted)
    loop, found = Loop(heyoka, paper, done.settings.parameters), trajectory.trajectory_of(done)
    states, sizes = found.values[:, :-1], np.maximum(1.0, np.abs(found.values))
    scales, slopes = loop.scales(found, 10.0), loop.law(found.t, states, 10.0)[:, 1:]
    for i in range(done.manifest.nX):
        moved = loop.law(found.t, states + np.eye(done.manifest.nX)[i] * sizes[:, [i]], 10.0)[:, 0]
        gap = moved - found.values[:, -1] - slopes[:, i] * sizes[:, i]
        assert np.all(np.abs(gap) <= trajectory.ACCURACY * scales[:, -1])
    np.testing.assert_array_equal(scales[:, :-1], sizes[:, :-1])
    expected = sizes[:, -1] + np.sum(np.abs(slopes) * sizes[:, :-1], axis=1)
    np.testing.assert_allclose(scales[:, -1], expected, rtol=1e-15)


def test_at_high_gain_v_differs_by_more_than_the_states_do(heyoka: Any, paper: Subject) -> None:
    done = trajectory.default_run(paper.compiled or paper.interpreted, {"c1": 500.0, "c2": 500.0})
    loop = Loop(heyoka, paper, done.settings.parameters)
    expected, found = independent.reference(loop, paper, done.settings), trajectory.trajectory_of(done)
    assert trajectory.compare(expected, found, "heyoka").verdict is Verdict.FAILED
    assert independent.compare_run(loop, paper, done).verdict is Verdict.PASSED
    states = dataclasses.replace(found, values=found.values.copy())
    states.values[5, 0] += 2e-9
    scales = loop.scales(expected, 10.0)
    assert trajectory.compare(expected, states, "heyoka", scales).verdict is Verdict.FAILED


NARROW = ("reference-bump", "reference-window", "disturbance-bump-at-rest", "disturbance-window")


def narrow(root: Path, paper: Subject, name: str) -> tuple[Subject, Any]:
    """The paper's model with a narrow feature, and the case: options, columns, rows made with small steps."""
    file = root / "tests" / "reference" / "features.json"
    (case,) = (case for case in json.loads(file.read_text(encoding="utf-8")) if case["name"] == name)
    options = list(zip(case["args"][::2], case["args"][1::2], strict=True))
    (reference,) = (value for option, value in options if option == "--reference")
    disturbance = [value for option, value in options if option == "--disturbance"] or None
    x0 = [float(x) for option, value in options if option == "--x0" for x in value.split(",")]
    return changed(paper, reference, disturbance, x0), case


def changed(
    paper: Subject, reference: str, disturbance: Sequence[str] | None, x0: Sequence[float] = ()
) -> Subject:
    """The paper's model with another reference, disturbance and start."""
    document = dict(paper.document)
    document["simulation"] = {**document["simulation"], "reference": reference} | (
        {"x0": list(x0)} if x0 else {}
    )
    if disturbance:
        document["plant"] = {**document["plant"], "disturbance": list(disturbance)}
    provided = provide(
        paper.file,
        reference=reference,
        disturbance=disturbance,
        environment=paper.environment,
        notify=paper.notify,
    )
    return dataclasses.replace(
        paper, document=document, model=model_of(document, "changed"), folder=provided.folder
    )


def start_of(subject: Subject, case: Any) -> tuple[Any, Actuator, Any]:
    """Settings, actuator and state that a case begins with."""
    rows = np.array(case["rows"])
    settings = make_settings(subject.manifest, x0=rows[0, 1:3], horizon=float(rows[-1, 0]))
    limits = subject.interpreted.call("actuation", settings.p)[0]
    return settings, make_actuator(np.asarray(limits)), initial_state(subject.interpreted, settings)


@pytest.mark.parametrize("name", NARROW)
def test_the_reference_sees_what_is_narrower_than_a_step(
    heyoka: Any, root: Path, paper: Subject, name: str
) -> None:
    subject, case = narrow(root, paper, name)
    rows = np.array(case["rows"])
    settings, actuator, start = start_of(subject, case)
    loop = Loop(heyoka, subject, settings.parameters)
    found = loop.run(np.ascontiguousarray(rows[:, 0]), start, 10.0, actuator)
    order = [found.names.index(column) for column in case["columns"][1:]]
    off = np.abs(found.values[:, order] - rows[:, 1:]) / (1.0 + np.abs(rows[:, 1:]))
    assert np.max(off) <= case["tol"]


@pytest.mark.parametrize("name", NARROW[:3])  # of the last, heyoka's own steps see enough
def test_a_run_that_leaves_its_own_equations_is_no_reference(
    heyoka: Any, root: Path, paper: Subject, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a longest step heyoka passes over the feature, or over a part of it."""
    subject, case = narrow(root, paper, name)
    settings, actuator, start = start_of(subject, case)
    loop = Loop(heyoka, subject, settings.parameters)
    t = np.array([row[0] for row in case["rows"]])
    monkeypatch.setattr(heyoka_loop, "LONGEST_STEPS", (np.inf,))
    with pytest.raises(UntrustedError, match="leaves its equations by"):
        loop.run(t, start, 10.0, actuator)
    monkeypatch.setattr(heyoka_loop, "LONGEST_STEPS", (np.inf, 2e-3))  # a second try is made
    assert np.all(np.isfinite(loop.run(t, start, 10.0, actuator).values))


def test_the_gate_says_that_it_has_no_reference(
    heyoka: Any, root: Path, paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject, case = narrow(root, paper, "reference-bump")
    settings, _, _ = start_of(subject, case)
    done = run(subject.interpreted, settings)
    monkeypatch.setattr(heyoka_loop, "LONGEST_STEPS", (np.inf,))
    result = independent.compare_run(Loop(heyoka, subject, settings.parameters), subject, done)
    assert result.verdict is Verdict.NOT_RUN
    assert "heyoka's run is no reference: it leaves its equations" in result.detail


def test_a_run_that_passes_over_a_pulse_fails(heyoka: Any, root: Path, paper: Subject) -> None:
    """At rest, with a pulse of the reference ahead: a run that stays there says that all is done."""
    subject, case = narrow(root, paper, "reference-bump")
    settings, _, start = start_of(subject, case)
    done = run(subject.interpreted, settings)
    still = dataclasses.replace(
        done,
        states=np.tile(start, (len(done.t), 1)),
        signals=np.tile(done.signals[0], (len(done.t), 1)),
        switches=(),
    )
    result = independent.compare_run(Loop(heyoka, subject, settings.parameters), subject, still)
    assert result.verdict is Verdict.FAILED


KINKED = {
    "dry friction": "-0.3*sign(x2) - abs(x1)/10",
    "one inside another": "0.2*abs(abs(x1) - 0.5) - max(0, x2 - 1)",
    "over time": "sign(t-0.7305) - abs(t-2)/10 + min(max(5*(t-1.01), 0), 1)",
    "a jump of an argument": "0.2*sign(x1 + 0.3*sign(x2))",
    "stick": "-(1 + 0.5*exp(-(x2/0.1)**2) + 0.5*(1 - sign(x2)**2))*sign(x2) - 0.1*x2*abs(x2) + sign(t-4)/5",
    "stick to a belt": "-0.6*sign(x2 - 0.3*sin(t))",
}


@pytest.mark.usefixtures("heyoka")
@pytest.mark.parametrize("name", KINKED)
def test_models_with_kinks_are_held(paper: Subject, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(independent, "RUNS", (2, 8))
    result = independent.check(changed(paper, "sin(t)", ("0", KINKED[name])))
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)
    assert "8 drawn runs with" in result.detail


@pytest.mark.usefixtures("heyoka")
def test_friction_of_a_speed_of_two_states_is_held(paper: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a joint with kept damping: x1' = x2 - 2.18 x1 sticks, and lets go at a rate of rounding."""
    monkeypatch.setattr(independent, "RUNS", (2, 8))
    result = independent.check(changed(paper, "sin(t)", ("-2.18*x1", "-2*sign(x2 - 2.18*x1)")))
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)
    assert "8 drawn runs with" in result.detail


def interpreted_of(subject: Subject) -> Subject:
    """The same, as without a compiler: the loops are then Python, and can be spoiled."""
    return dataclasses.replace(subject, environment={**os.environ, "PATH": ""})


def side_ignored(self: Any, mode: int) -> Any:
    return np.concatenate([self.problem.modes[mode], np.ones(self.problem.n_kinks)])


@pytest.mark.usefixtures("heyoka", "no_ziglang")
def test_a_kernel_that_ignores_a_side_fails(paper: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    subject = interpreted_of(changed(paper, "sin(t)", ("0", KINKED["dry friction"])))
    monkeypatch.setattr(independent, "RUNS", (0, 0))
    assert independent.check(subject).verdict is Verdict.PASSED
    monkeypatch.setattr(continuous._Loop, "actuation", side_ignored)
    assert independent.check(subject).verdict is Verdict.FAILED


@pytest.mark.usefixtures("heyoka", "no_ziglang")
def test_friction_that_holds_one_percent_too_much_fails(
    paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(self: Stepper, c: Any, term_sums: Any, channel: int, h: float, tau: float) -> tuple[bool, float]:
        scaled = c.copy()
        scaled[:, channel] /= 1.01
        return lets_go(self, scaled, np.full_like(term_sums, np.inf), channel, h, tau)

    lets_go = Stepper.lets_go
    subject = interpreted_of(changed(paper, "sin(t)", ("0", KINKED["stick"])))
    monkeypatch.setattr(independent, "RUNS", (0, 0))
    result = independent.check(subject)
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)
    assert run(subject.interpreted, make_settings(subject.manifest)).sticks
    monkeypatch.setattr(Stepper, "lets_go", late)
    assert independent.check(subject).verdict is Verdict.FAILED


@pytest.mark.usefixtures("heyoka")
def test_two_limits_stick_and_a_jump_of_the_reference_agree_with_it(
    tmp_path: Path, paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the reference jumps, so does u, and with it the side that holds the joint: it breaks away."""
    document = dict(paper.document)
    document["parameters"] = {name: document["parameters"][name] for name in ("d1", "b0")}
    document["actuator"] = {"lower": -4, "upper": 6}
    document["plant"] = {**document["plant"], "disturbance": ["0", "-3*sign(x2)"]}
    steps = [[0, 0.5], [2.0, 0.2], [3.5, 0.9]]
    simulation = {**document["simulation"], "reference": {"steps": steps}, "x0": [0.5, 0.0], "horizon": 5.0}
    document |= {"name": "jumps", "simulation": simulation}
    file = tmp_path / "models" / "jumps.toml"
    provided = provide_document(file, document, environment=os.environ, notify=paper.notify)
    subject = dataclasses.replace(
        paper, file=file, document=document, model=model_of(document, "jumps"), folder=provided.folder
    )
    found = run(subject.interpreted, make_settings(subject.manifest))
    assert {2.0, 3.5} & {end for _, end in found.sticks}
    monkeypatch.setattr(independent, "RUNS", (0, 0))
    result = independent.check(subject)
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)


@pytest.mark.usefixtures("heyoka", "no_ziglang")
def test_a_step_over_a_narrow_feature_fails(paper: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disturbance of a few milliseconds, at rest: without a guard one step covers the horizon."""
    pulse = ("0", "9*exp(-((t-3.3)/0.002)**2)")
    subject = interpreted_of(changed(paper, "0", pulse, [0.0, 0.0]))
    monkeypatch.setattr(independent, "RUNS", (0, 0))
    assert independent.check(subject).verdict is Verdict.PASSED
    monkeypatch.setattr(fixed, "discs", lambda rule, tolerance: Discs((0.0,), (0.0,)))
    result = independent.check(subject)
    assert result.verdict is Verdict.FAILED
    assert result.difference is not None


@pytest.mark.usefixtures("no_ziglang")
def test_where_both_are_stuck_nothing_is_held_and_nothing_passes(
    heyoka: Any, paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reference stops: friction then holds the joint, in both, at one instant."""
    product = "-1.5*sign(x2)*(1 + sign(x2)*sign(x1 - 50))"  # of two sides: neither can be solved for
    subject = interpreted_of(changed(paper, "0.5", ("0", product), [0.0, 0.3]))
    settings = make_settings(subject.manifest, horizon=8.0, tolerance=trajectory.TOLERANCES[0])
    done = run(subject.interpreted, settings)
    loop = Loop(heyoka, subject, settings.parameters)
    with pytest.raises(SlidingError) as caught:
        independent.reference(loop, subject, settings)
    assert f"t = {caught.value.t:.6g} s" in done.message
    result = independent.compare_run(loop, subject, done)
    assert result.verdict is Verdict.NOT_RUN and "stuck to a kink" in result.detail
    early = dataclasses.replace(done, t=done.t[:-1], states=done.states[:-1], signals=done.signals[:-1])
    assert independent.compare_run(loop, subject, early).verdict is Verdict.FAILED
    monkeypatch.setattr(independent, "drawn_settings", lambda _subject, _draw: settings)
    drawn = independent.compare_drawn(loop, subject, subject.interpreted, result, 1)
    assert drawn.verdict is Verdict.NOT_RUN
    assert "no drawn run that saturates" in drawn.detail and "4 more are stuck to a kink" in drawn.detail


def test_an_argument_on_the_wrong_side_is_no_reference(heyoka: Any, paper: Subject) -> None:
    subject = changed(paper, "sin(t)", ("0", KINKED["dry friction"]))
    settings = make_settings(subject.manifest, horizon=2.0)
    blind = Loop(heyoka, subject, settings.parameters)
    blind._kinks = None
    actuator = make_actuator(np.asarray(subject.interpreted.call("actuation", settings.p)[0]))
    start = initial_state(subject.interpreted, settings)
    t = settings.times()
    blind.run(t, start, 10.0, actuator)  # the equations of one side hold all along
    whole = Loop(heyoka, subject, settings.parameters)
    whole._kinks.moving = (False,) * whole._kinks.count  # type: ignore[union-attr,misc]
    with pytest.raises(UntrustedError, match="misses a kink near t ="):
        whole.run(t, start, 10.0, actuator)


def test_what_rounding_explains_is_counted_by_operations() -> None:
    x, y = sp.symbols("x y")
    program = compile_program([x * y + sp.sin(x) + 3, x**3], [x, y], {})  # type: ignore[arg-type]
    assert operation_count(program) == 1 + 2 + 2 + 2 + 1  # product, sine, two sums, power, 3


def test_without_what_rounding_explains_high_gain_has_no_reference(
    heyoka: Any, paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains multiply the last digits of the states: rates cannot be compared more closely than that."""
    settings = make_settings(paper.manifest, parameters={"c1": 500.0, "c2": 500.0}, horizon=1.0)
    assert independent.reference(Loop(heyoka, paper, settings.parameters), paper, settings)
    monkeypatch.setattr(heyoka_loop, "UNIT", 0.0)
    with pytest.raises(UntrustedError, match="leaves its equations by"):
        independent.reference(Loop(heyoka, paper, settings.parameters), paper, settings)
