"""What captions and the table say that a run was made with."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.simulate.assumptions import changes, sentence


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
    run = ClosedLoop.load("paper").simulate(horizon=0.1, parameters=parameters)
    assert changes(run) == said


def test_only_the_papers_silence_is_called_an_assumption() -> None:
    paper = ClosedLoop.load("paper").simulate(horizon=0.1, x0=[1.0, 0.0])
    assert sentence(paper) == (
        "Assumed, not stated in the paper: y_r = sin(t), horizon 0.1 s. Changed: x(0) = (1, 0)."
    )
    joint = ClosedLoop.load("joint").simulate(horizon=0.1, controller="sampled", sample_time=0.002)
    assert sentence(joint).startswith("Settings: y_r = ")
    assert sentence(joint).endswith("horizon 0.1 s, sample time 0.002 s.")
