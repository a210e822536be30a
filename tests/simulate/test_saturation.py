"""Braking and the other kinds: loaded, run, swept and refused."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.main import run as pmjoint
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.provision import provide
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import simulate_chunk
from pmjoint_codegen.sweep.plan import CODES, make_plan
from pmjoint_codegen.sweep.request import make_request

GAINS = {"ck1": 12.0, "ck2": 12.0}


def load(saturation: str | None, evaluator: str | None = None, model: str = "paper") -> ClosedLoop:
    return ClosedLoop.load(model, evaluator, saturation=saturation, notify=lambda line: None)


@pytest.fixture(scope="module")
def braking() -> ClosedLoop:
    return load("braking")


def document(root: Path, name: str = "paper", **design: Any) -> dict[str, Any]:
    found = read_document(root / "models" / f"{name}.toml")
    kept = {key: value for key, value in found["design"].items() if key != "compensator"}
    return {**found, "design": {**kept, **design}}


def test_the_papers_joint_brakes(braking: ClosedLoop) -> None:
    run = braking.simulate(start="matched", parameters=GAINS, horizon=20.0)
    assert run.ise == pytest.approx(0.418, abs=5e-4)
    assert run.settling_s == pytest.approx(0.63, abs=5e-3)
    assert run.peaks["v"][0] == pytest.approx(26.0, abs=0.5)
    assert run.summary["saturation"] == "braking"
    assert run.summary["parameters"]["braking"] == 0.5


def test_the_curve_follows_from_its_definition(braking: ClosedLoop) -> None:
    """r1' + g(r1) = r2 along a run, with g written here: central differences of the dense output."""
    step = 1e-4
    run = braking.simulate(start="matched", parameters=GAINS, horizon=0.2, output_step=step)
    r1, r2 = run["r1"], run["r2"]
    reach = 2 * 0.5 * 2.0 * 10.0 / 12.0**2
    g = 12.0 * r1 / (1 + (r1 / reach) ** 2) ** 0.25
    rate = (r1[2:] - r1[:-2]) / (2 * step)
    np.testing.assert_allclose(rate, (r2 - g)[1:-1], atol=1e-4)
    assert np.max(np.abs(r1)) > 5 * reach  # far on the curve


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_an_unbounded_limit_is_the_compensator(braking: ClosedLoop, controller: str) -> None:
    linear, known = (
        loop.simulate(
            start="matched",
            parameters={**GAINS, **more},
            horizon=2.0,
            controller=controller,
            sample_time=1e-3,
        )
        for loop, more in ((braking, {"braking": 1e100}), (load("compensator"), {}))
    )
    # Sampled, r1 has a fixed-step method: (ck1 T)^5/120 a hold
    np.testing.assert_allclose(linear.states, known.states, atol=1e-8 if controller == "continuous" else 1e-6)


def test_its_sampled_run_tends_to_the_continuous_one(braking: ClosedLoop) -> None:
    exact = braking.simulate(start="matched", parameters=GAINS, horizon=1.0)
    gaps = []
    for period in (2e-3, 1e-3):
        run = braking.simulate(
            start="matched", parameters=GAINS, horizon=1.0, controller="sampled", sample_time=period
        )
        gaps.append(float(np.max(np.abs(run["r1"] - exact["r1"]))))
    assert gaps[1] < 0.7 * gaps[0] < 0.1  # the hold of y and u is what is left: first order


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_interpreted_runs_have_the_same_bits(braking: ClosedLoop, controller: str) -> None:
    one, two = (
        loop.simulate(start="matched", parameters=GAINS, horizon=0.5, controller=controller)
        for loop in (braking, load("braking", "interpreted"))
    )
    np.testing.assert_array_equal(one.states, two.states)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_one_axis_of_a_sweep_is_all_three_kinds(controller: str) -> None:
    if find_compiler(os.environ) is None:
        pytest.skip("the lanes are compiled")
    provided = provide(
        "paper", saturation="braking", environment=os.environ, notify=lambda line: None, lanes=True
    )
    plan = make_plan(("saturation=braking,clip,compensator",), (), None, 0, "latin-hypercube")
    asked: dict[str, Any] = {
        "start": "matched",
        "parameters": GAINS,
        "horizon": 3.0,
        "controller": controller,
    }
    request = make_request(provided.manifest, plan, output_step=3.0, **asked)
    library = library_of(make_inputs(provided.folder), os.environ)
    rows = simulate_chunk(library, request, plan.columns(0, plan.runs)).trajectories[:, -1]
    for row, word in zip(rows, ("braking", "clip", "compensator"), strict=True):
        run = load(word).simulate(**asked)
        assert run.summary["saturation"] == word
        np.testing.assert_allclose(row[: run.manifest.nX], run.states[-1], atol=2e-5, err_msg=word)
    assert plan.saturation == "braking"
    assert set(CODES) == {"clip", "compensator", "braking"}


def test_clipping_is_the_switch_whatever_the_model(braking: ClosedLoop) -> None:
    plain = load("clip")
    assert plain.evaluator.manifest.simulation.compensator is False
    one, two = plain.simulate(horizon=1.0), braking.simulate(horizon=1.0, compensator=False)
    assert one.summary["saturation"] == two.summary["saturation"] == "clip"
    np.testing.assert_allclose(one.states, two.states, atol=1e-9)


def test_one_state_has_nothing_to_brake(root: Path) -> None:
    third = document(root, "third-order")
    plant = {**third["plant"], "b": ["1", "3", "2"]}
    one = {key: third["design"][key][:1] for key in ("c", "e", "ck")}
    design = {**third["design"], **one, "saturation": "braking"}
    assert model_of({**third, "plant": plant, "design": design}, "m.toml").gains.braking is None


@pytest.mark.parametrize(
    ("name", "design", "message"),
    [
        ("joint-lag", {"saturation": "braking"}, "relative degree 2 only, and this model has 3"),
        ("paper", {"saturation": "braking", "compensator": False}, "is 'braking', but compensator is false"),
        ("paper", {"saturation": "clip", "compensator": True}, "is 'clip', but compensator is true"),
        ("paper", {"braking": 0.5}, "design.braking: has no effect"),
        ("paper", {"saturation": "braking", "braking": 0.0}, "design.braking"),
        ("paper", {"saturation": "coast"}, "design.saturation"),
        ("paper", {"start": "warm"}, "design.start"),
    ],
)
def test_what_makes_no_sense_is_refused(root: Path, name: str, design: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError) as caught:
        model_of(document(root, name, **design), "m.toml")
    assert message in str(caught.value)


def test_two_spellings_that_agree_are_one(root: Path) -> None:
    gains = [
        model_of(document(root, **design), "m.toml").gains
        for design in (
            {"saturation": "clip"},
            {"compensator": False},
            {"saturation": "clip", "compensator": False},
        )
    ]
    assert gains[0] == gains[1] == gains[2]
    assert not gains[0].compensator


def test_options_that_contradict_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    options = ["simulate", "paper", "--no-figures", "--out", str(tmp_path)]
    assert pmjoint([*options, "--saturation", "braking", "--no-compensator"]) == 2
    assert "--no-compensator contradicts --saturation braking" in capsys.readouterr().err
    assert pmjoint([*options, "--saturation", "clip", "--no-compensator"]) == 0


def test_braking_beyond_two_names_the_option(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code = pmjoint(
        ["simulate", "joint-lag", "--no-figures", "--out", str(tmp_path), "--saturation", "braking"]
    )
    assert code != 0
    assert "--saturation: braking is derived for relative degree 2 only" in capsys.readouterr().err


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(UsageError, match="saturation: is 'coast'; allowed: compensator, clip, braking"):
        load("coast")


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (("saturation=1,2",), "is '1'; allowed: clip, compensator, braking"),
        (("saturation=braking",), "paper is not designed to brake"),
        (("saturation=clip", "compensator=0,1"), "saturation and compensator are both given"),
    ],
)
def test_an_axis_that_makes_no_sense_is_refused(grid: tuple[str, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make_request(load(None).manifest, make_plan(grid, (), None, 0, "latin-hypercube"))


def test_braking_is_positive(braking: ClosedLoop) -> None:
    with pytest.raises(UsageError, match="braking: is -1; allowed: a number greater than 0"):
        braking.simulate(parameters={"braking": -1.0})
