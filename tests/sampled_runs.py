"""Sampled runs with a row for each sample, to be followed by a controller that steps."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError
from pmjoint_codegen.simulate.run import Run

T = 0.002  # s, and the output step of runs, so that each row is a sample


@cache
def loaded(model: str, evaluator: str = "compiled", saturation: str | None = None) -> ClosedLoop:
    """A model's loop, loaded once a session."""
    if evaluator == "interpreted":
        pytest.importorskip("casadi")
    return ClosedLoop.load(model, evaluator, saturation=saturation)


def sampled(loop: ClosedLoop, **asked: Any) -> Run:
    """A sampled run with a row for each sample, as far as it goes."""
    step = asked.setdefault("sample_time", T)
    try:
        return loop.simulate(controller="sampled", output_step=step, **asked)
    except SimulationError as error:
        assert isinstance(error.run, Run)
        return error.run
