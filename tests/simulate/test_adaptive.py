"""Runs with estimates: the sampled scheme, both evaluators, chains, states saved, other commands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, compare, tune
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.loops.logits import place_of
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.settings import make_settings
from tests.sampled_runs import loaded

MODELS = ("paper-adaptive", "joint-load", "lag-adaptive")


def assert_same(one: Run, other: Run) -> None:
    assert (one.status, one.switches, one.steps, one.peaks) == (
        other.status,
        other.switches,
        other.steps,
        other.peaks,
    )
    for name in ("t", "states", "signals"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize("model", MODELS)
def test_continuous_runs_have_the_same_bits(model: str) -> None:
    asked: dict[str, Any] = {"controller": "continuous", "horizon": 0.3, "output_step": 0.0037}
    one, other = (loaded(model, kind).simulate(**asked) for kind in ("compiled", "interpreted"))
    assert_same(one, other)


@pytest.fixture(scope="module")
def chained(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's example with sensor, filter, delay, rate and jitter, as a model file."""
    text = (root / "models" / "paper-adaptive.toml").read_text(encoding="utf-8")
    file = tmp_path_factory.mktemp("chained") / "chained.toml"
    limit = 'limit = "u_max"\ndelay = 0.0013\nrate = 4000\n'
    sensor = "[sensor]\nresolution = 0.001\nnoise = 0.0005\nseed = 3\nfilter = 500\n"
    text = text.replace('limit = "u_max"\n', f"{limit}{sensor}", 1).replace('"paper-adaptive"', '"chained"')
    file.write_text(f"{text}jitter = 0.0002\n", encoding="utf-8")
    return file


def test_a_chained_loop_has_the_same_bits(chained: Path) -> None:
    """And its estimates stay near those of the loop without a chain."""
    quiet = {"notify": lambda line: None}
    one, other = (ClosedLoop.load(chained, kind, **quiet) for kind in ("compiled", "interpreted"))  # type: ignore[arg-type]
    asked: dict[str, Any] = {"horizon": 0.4, "output_step": 0.013}
    run = one.simulate(**asked)
    assert_same(run, other.simulate(**asked))
    assert np.ptp(run["b0_hat"]) > 0.1 and run.switches
    longer = one.simulate(horizon=20.0, start="matched", parameters={"ck1": 5.0, "ck2": 5.0})
    bare = loaded("paper-adaptive").simulate(
        controller="sampled", start="matched", parameters={"ck1": 5.0, "ck2": 5.0}
    )
    assert longer["d1_hat"][-1] == pytest.approx(bare["d1_hat"][-1], abs=0.05)


@pytest.mark.parametrize("sample_time", [0.001, 0.03, 0.3, 1.0])
@pytest.mark.parametrize("gain", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("model", MODELS)
def test_a_sampled_estimate_never_leaves_its_range(model: str, gain: float, sample_time: float) -> None:
    """However long the sample, large the gain and large what moves it, 200 samples in a row."""
    loop, random = loaded(model), np.random.default_rng(7)
    manifest = loop.manifest
    names = [item.name.removesuffix("_logit") for item in manifest.states[slice(*manifest.blocks["Theta"])]]
    p = make_settings(manifest, parameters={f"gamma_{name}": gain for name in names}).p
    values = dict(zip(manifest.parameter_names, p.tolist(), strict=True))
    low, high = (np.array([values[f"{name}_{end}"] for name in names]) for end in ("low", "high"))
    h = hold_matrices(loop.evaluator, p, sample_time)
    guess = np.array([values[f"{name}_guess"] for name in names])
    logits = np.zeros((50, len(names)))
    first, last = (place - manifest.nx for place in manifest.blocks["Theta"])
    for _ in range(200):
        sizes = 10.0 ** random.uniform(-3.0, 6.0, (50, 1))
        s = random.uniform(-1.0, 1.0, (50, manifest.nX - manifest.nx)) * sizes
        s[:, first:last] = logits
        y, u, v = (random.uniform(-2.0, 2.0, (50, 1)) for _ in range(3))
        y_r = random.uniform(-2.0, 2.0, (50, manifest.rho + 1))
        s_next = loop.evaluator.call("sampled_update", y, s, y_r, u, v, h, p)[0]
        logits = s_next[:, first:last]
        hats = place_of(logits, guess, low, high)
        assert np.all((low < hats) & (hats < high))
    assert np.ptp(hats, axis=0).max() > 0.5 * (high - low).min()


def test_the_sampled_scheme_tends_to_the_continuous_loop() -> None:
    """To first order in the sample time: a tenth of it leaves a tenth of the difference."""
    loop = loaded("paper-adaptive")
    asked: dict[str, Any] = {"horizon": 2.0, "output_step": 0.1, "start": "matched"}
    exact = loop.simulate(controller="continuous", **asked)
    gaps = []
    for sample_time in (1e-3, 1e-4):
        run = loop.simulate(controller="sampled", sample_time=sample_time, **asked)
        gaps.append(max(np.max(np.abs(run[name] - exact[name])) for name in ("b0_hat", "d1_hat", "y")))
    assert 7 < gaps[0] / gaps[1] < 13


def test_a_saved_state_has_the_estimates() -> None:
    """A controller restored in the middle goes on with the same bits; a reset one forgets."""
    loop = loaded("paper-adaptive")
    one, other = loop.controller(sample_time=0.002), loop.controller(sample_time=0.002)
    readings = [1.5 - 0.01 * k for k in range(40)]
    for y in readings[:20]:
        one.step(y)
    other.state = one.state
    assert [one.step(y) for y in readings[20:]] == [other.step(y) for y in readings[20:]]
    first = loop.manifest.blocks["Theta"][0] - loop.manifest.nx
    assert one.s[first] != 0.0
    other.reset(1.5)
    other.step(1.5)
    assert other.s[first] == 0.0  # at the guess


def test_other_guesses_need_no_new_kernels() -> None:
    run = loaded("paper-adaptive").simulate(horizon=0.1, parameters={"d1_guess": 0.4, "b0_guess": 2.5})
    assert run["b0_hat"][0] == 2.5 and run["d1_hat"][0] == 0.4
    assert "d1_guess" in run.summary["parameters"]


def test_a_true_value_outside_its_range_runs_without_v() -> None:
    run = loaded("paper-adaptive").simulate(horizon=1.0, parameters={"b0": 7.0}, controller="sampled")
    assert np.all(np.isnan(run["V"])) and np.all(np.isfinite(run.states))
    assert run.summary["status"] == "done"


def test_gains_are_chosen_and_runs_compared_as_for_other_models() -> None:
    """And the frozen law, whose gains of the estimates are 0, is another run of the same kernels."""
    quiet: dict[str, Any] = {"notify": lambda line: None}
    found = tune(
        "paper-adaptive",
        gains={"c1": (5.0, 30.0), "c2": (5.0, 30.0)},
        generations=2,
        population=4,
        start="matched",
        horizon=5.0,
        **quiet,
    )
    assert "c1" in str(found)
    loop = loaded("paper-adaptive")
    frozen = loop.simulate(horizon=1.0, parameters={"gamma_b0": 0.0, "gamma_d1": 0.0})
    assert np.ptp(frozen["b0_hat"]) == 0.0
    shown = str(compare(loop.simulate(horizon=1.0), frozen))
    assert "gamma_b0" in shown and "ISE" in shown
