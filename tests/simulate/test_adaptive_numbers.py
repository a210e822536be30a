"""Adaptive runs against figures computed elsewhere, to the digits that they were given with."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, modelfile
from pmjoint_codegen.identity import Document
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.simulate.run import Run
from pmjoint_derive import Model

FOLDER = Path(__file__).parent.parent / "reference"
PAPER = {"ck1": 1.0, "ck2": 1.0}  # its decay rates of the compensator
FROZEN = {"gamma_b0": 0.0, "gamma_d1": 0.0}
RIGHT = {"b0_guess": 2.0, "d1_guess": 0.2}
LOAD = {"w": 1.0, "gamma_w": 100.0}
LATE = 7.0  # s before the end


def late(run: Run) -> float:
    return float(np.max(np.abs(run["e"][run.t > run.t[-1] - LATE])))


def estimates(run: Run) -> list[float]:
    return [float(run[name][-1]) for name in ("b0_hat", "d1_hat")]


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return ClosedLoop.load(FOLDER / "adaptive-divide.toml", notify=lambda line: None)


@pytest.mark.parametrize(
    ("asked", "ise", "settled", "peak", "error", "learnt"),
    [
        ({"parameters": PAPER | FROZEN | RIGHT}, 9.421, 7.46, 225.7, 0.0062, None),
        ({"parameters": PAPER | FROZEN}, 8.361, 7.96, 554.9, 0.0153, None),
        ({"parameters": PAPER | FROZEN | RIGHT, "compensator": False}, 0.4231, 1.59, 225.7, 0.0061, None),
        ({"parameters": PAPER | FROZEN, "compensator": False}, 0.5872, 1.39, 554.9, 0.0153, None),
        ({"parameters": PAPER}, 5.641, 7.26, 554.9, 0.0024, (0.827, -0.517)),
        ({"start": "matched"}, 0.5416, 1.34, 22.3, 0.0050, (1.576, -0.077)),
        ({"start": "matched", "parameters": LOAD}, 0.5356, 1.15, 22.3, 5.7e-5, (1.231, -0.490)),
    ],
    ids=["known", "wrong", "known, clip", "wrong, clip", "adaptive", "matched", "load"],
)
def test_the_papers_table(
    loop: ClosedLoop,
    asked: dict[str, Any],
    ise: float,
    settled: float,
    peak: float,
    error: float,
    learnt: tuple[float, float] | None,
) -> None:
    run = loop.simulate(**asked)
    assert run.ise == pytest.approx(ise, abs=1e-4 if ise < 1 else 1e-3)
    assert run.settling_s == pytest.approx(settled, abs=0.01)
    assert run.peaks["v"][0] == pytest.approx(peak, abs=0.05)
    assert late(run) == pytest.approx(error, rel=0.02)
    if learnt is not None:
        assert estimates(run) == pytest.approx(learnt, abs=5e-4)
    if asked.get("parameters") == LOAD:
        assert run["w_hat"][-1] == pytest.approx(0.761, abs=5e-4)


def test_plain_clipping_destroys_the_loop_that_learns(loop: ClosedLoop) -> None:
    slow = PAPER | {"gamma_b0": 0.01, "gamma_d1": 0.01}
    run = loop.simulate(parameters=slow, compensator=False)
    assert run.ise == pytest.approx(55.0, abs=0.5)
    assert run.settling_s is None and late(run) == pytest.approx(3.7, abs=0.05)
    ends = float(run["b0_hat"].min()), float(run["d1_hat"].max())
    assert ends == pytest.approx((0.3, 3.0), abs=1e-9)
    fast = loop.simulate(parameters=PAPER, compensator=False)
    assert fast.peaks["v"][0] > 5e4 and fast["d1_hat"].max() == pytest.approx(3.0, abs=1e-6)


def test_a_constant_load_needs_its_column(loop: ClosedLoop) -> None:
    """Without, ``k_1 w/k_n = 0.75`` is an error of x_hat_2 that leaves e = 0.0848; any reference."""
    quiet = {"share": 0.0, "w": 1.0} | FROZEN | RIGHT
    assert loop.simulate(parameters=quiet)["e"][-1] == pytest.approx(0.0848, abs=2e-4)
    assert late(loop.simulate(parameters=quiet | {"gamma_w": 100.0})) < 1e-9
    leaking = quiet | {"gamma_w": 100.0, "leakage": 0.01}
    assert late(loop.simulate(parameters=leaking)) == pytest.approx(5.4e-4, abs=5e-6)


def test_two_tones_excite_both_estimates(loop: ClosedLoop) -> None:
    tones: dict[str, Any] = {"start": "matched", "parameters": {"tone": 0.5}}
    run = loop.simulate(**tones)
    assert late(run) == pytest.approx(0.0066, abs=5e-5)
    assert estimates(run) == pytest.approx([1.986, 0.206], abs=5e-4)
    tones["parameters"] |= FROZEN
    assert late(loop.simulate(**tones)) == pytest.approx(0.0666, abs=5e-5)


def test_a_plant_of_relative_degree_one() -> None:
    loop = ClosedLoop.load(FOLDER / "adaptive-first-order.toml", notify=lambda line: None)
    run = loop.simulate(tolerance=1e-13, output_step=1.0)
    assert run["e"][1] == pytest.approx(0.14552726, abs=5e-9)
    assert estimates(run) == pytest.approx([1.21063361, 0.14399711], abs=5e-9)
    assert run.switches


def test_least_squares_follow_the_data_under_plain_clipping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without ranges, as the figures were computed: a model file refuses that, as b_hat may pass 0."""
    read = modelfile.model_of

    def model_of(document: Document, where: str = "") -> Model:
        model = read(document, where)
        assert model.adaptation is not None
        free = tuple(dataclasses.replace(entry, range=None) for entry in model.adaptation.entries)
        return dataclasses.replace(model, adaptation=dataclasses.replace(model.adaptation, entries=free))

    text = (FOLDER / "adaptive-divide.toml").read_text(encoding="utf-8")
    for old, new in (
        ("load    = true\n", ""),
        (', "w"]', "]"),
        (", w = 0.0", ""),
        (", w = [-5.0, 5.0]", ""),
        ("gain    = { b0 = 1.0, d1 = 1.0 }", 'estimator = "least_squares"'),
        ("leakage = 0.0", "least_squares = { kappa = 100, forgetting = 0.5, P0 = 5, k_max = 50 }"),
        ('"adaptive-divide"', '"adaptive-squares"'),
    ):
        assert old in text
        text = text.replace(old, new)
    text = "\n".join(line for line in text.splitlines() if not line.startswith("w "))
    file = tmp_path / "adaptive-squares.toml"
    file.write_text(text, encoding="utf-8")
    assert read_document(file)["adaptation"]["estimator"] == "least_squares"
    monkeypatch.setattr(modelfile, "model_of", model_of)
    monkeypatch.setenv("PMJOINT_CACHE", str(tmp_path / "cache"))  # a cached model of this hash has its ranges
    loop = ClosedLoop.load(file, notify=lambda line: None)
    run = loop.simulate(start="matched", compensator=False, parameters={"tone": 0.5})
    assert run.ise == pytest.approx(0.289, abs=5e-4)
    assert estimates(run) == pytest.approx([1.996, 0.196], abs=1e-3)
