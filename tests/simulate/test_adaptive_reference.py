"""Runs with estimates against two independent solutions, and against numbers that the theory gives.

The references are from a law written by hand with Taylor steps of order 20, and from a general derivation
with DOP853 at 2.3e-14, both with located saturation. They agree to 4e-12, in v to 5e-10.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.logits import reported_states
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import Settings, make_settings
from pmjoint_codegen.simulate.start import make_start

FOLDER = Path(__file__).parent.parent / "reference"
SWITCHES = {  # s, and the mode that begins; u is at its lower limit from 0 on
    "adaptive_sin": [
        (0.05362738714888613, 0),
        (0.05488163916508325, 1),
        (0.20890924516992015, 0),
    ],
    "adaptive_load": [
        (0.035613286367520765, 0),
        (0.03657960656242089, 1),
        (0.11593889590833903, 0),
        (0.13153559751844754, -1),
        (0.1813527108002644, 0),
    ],
}


@pytest.fixture(scope="module", params=["compiled", "interpreted"])
def kind(request: pytest.FixtureRequest) -> str:
    if request.param == "interpreted":
        pytest.importorskip("casadi")
    return str(request.param)


def exact(evaluator: Evaluator, output_step: float) -> Settings:
    """Tight settings; the interpreter takes a row where the reference has its last."""
    return make_settings(
        evaluator.manifest, controller="continuous", tolerance=1e-12, output_step=output_step
    )


def from_state(
    evaluator: Evaluator, settings: Settings, monkeypatch: pytest.MonkeyPatch, **own: float
) -> Run:
    """A run from a state that no setting gives: some entries of X(0) are set."""

    def moved(*arguments: Any) -> Array:
        state = make_start(*arguments)
        for name, value in own.items():
            state[[item.name for item in evaluator.manifest.states].index(name)] = value
        return state

    monkeypatch.setattr("pmjoint_codegen.simulate.run.make_start", moved)
    return run(evaluator, settings)


def assert_agrees(found: Run, name: str) -> None:
    """Every column to 2e-8, v to 1e-7 of its size, switches to 1e-9 s."""
    reference = np.genfromtxt(FOLDER / f"{name}.csv", delimiter=",", names=True)
    assert found.status == Status.DONE
    rows = np.rint(reference["t"] / 0.01).astype(int)
    np.testing.assert_allclose(found.t[rows], reference["t"], rtol=0, atol=1e-12)
    columns = reference.dtype.names or ()
    assert {*columns} >= {*reported_states(found.manifest)}  # estimates, not their logits
    for column in columns[1:]:
        rtol, atol = (1e-7, 1e-9) if column == "v" else (0, 2e-8)
        np.testing.assert_allclose(
            found[column][rows], reference[column], rtol=rtol, atol=atol, err_msg=column
        )
    assert found.initial_mode == -1
    assert [mode for _, mode in found.switches] == [mode for _, mode in SWITCHES[name]]
    times = [[t for t, _ in switches] for switches in (found.switches, SWITCHES[name])]
    np.testing.assert_allclose(times[0], times[1], rtol=0, atol=1e-9)


def test_the_paper_with_two_estimates_agrees(kind: str) -> None:
    """Form "divide", gains that vanish at the ends of the ranges, no leakage."""
    evaluator = ClosedLoop.load("paper-adaptive", kind).evaluator
    found = run(evaluator, exact(evaluator, 0.01))
    assert_agrees(found, "adaptive_sin")
    assert found["v"][0] == pytest.approx(-554.888917824, rel=1e-11)


@pytest.fixture(scope="module")
def load_model() -> Path:
    return FOLDER / "adaptive-load.toml"


def test_an_estimate_of_the_inverse_leakage_and_a_load_agree(
    kind: str, load_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From xi_1(0) = y(0) and all else 0, which is neither start of the settings."""
    evaluator = ClosedLoop.load(load_model, kind, notify=lambda line: None).evaluator
    found = from_state(evaluator, exact(evaluator, 0.01), monkeypatch, xi1=1.5)
    assert_agrees(found, "adaptive_load")
    assert found["v"][0] == pytest.approx(-1247.97266782, rel=1e-11)
    assert "V" in {item.name for item in found.manifest.signals}
