"""What captions and the table say that a run was made with."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.assumptions import assumed, changes, sentence, stated


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({}, ()),
        ({"b0": 2.0}, ()),
        ({"b0": 3.0}, ("b0 = 3",)),
        ({"b0_plant": 3.0}, ("b0_plant = 3",)),
        ({"b0": 3.0, "b0_plant": 2.0}, ("b0 = 3", "b0_plant = 2")),  # the plant as the file has it
        ({"compensator": 0.0}, ("compensator off",)),
    ],
)
def test_what_differs_is_said(parameters: Mapping[str, float], said: tuple[str, ...]) -> None:
    run = ClosedLoop.load("paper").simulate(parameters=parameters)
    assert changes(run) == said


def test_only_the_papers_silence_is_called_an_assumption() -> None:
    paper = ClosedLoop.load("paper").simulate(x0=[1.0, 0.0])
    assert sentence(paper) == (
        "Assumed, not stated in the paper: y_r = sin(t), horizon 20 s. Changed: x(0) = (1, 0)."
    )
    joint = ClosedLoop.load("joint").simulate(horizon=0.1, controller="sampled", sample_time=0.002)
    assert sentence(joint).startswith("Settings: y_r = ")
    assert sentence(joint).endswith("horizon 0.1 s, sample time 0.002 s.")


def test_what_is_given_for_a_run_is_no_assumption() -> None:
    loop = ClosedLoop.load("paper")
    short = loop.simulate(horizon=0.1, controller="sampled")
    assert assumed(short) == ("y_r = sin(t)", "sample time 0.001 s")
    assert changes(short) == ("horizon 0.1 s",)
    coarse = loop.simulate(controller="sampled", sample_time=0.002)
    assert assumed(coarse) == ("y_r = sin(t)", "horizon 20 s")
    assert changes(coarse) == ("sample time 0.002 s",)
    other = ClosedLoop.load("paper", reference="cos(t)").simulate(horizon=0.1)
    assert assumed(other) == stated(other) == ()
    assert sentence(other) == "Changed: y_r = cos(t), horizon 0.1 s."
