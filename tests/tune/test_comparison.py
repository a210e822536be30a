"""Both designs side by side: how long the beginning is that is shown enlarged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.tune.comparison import TRANSIENT, compare, traces, transient
from pmjoint_codegen.tune.cost import CostFunction
from pmjoint_codegen.tune.figure import _STYLE, draw
from pmjoint_codegen.tune.request import make_request
from pmjoint_codegen.tune.search import Found
from tests.figure_texts import flaws


def test_the_beginning_follows_the_saturation_within_bounds(library: BatchLibrary, paper: Manifest) -> None:
    costing = CostFunction(library, make_request(paper, gains=("c1",), horizon=8.0))
    both = compare(costing, Found({"c1": 10.0}, 1.0, 2.0, 3, 1, True, ()))

    def shown(saturated: float) -> float:
        metrics = both.metrics.copy()
        metrics[..., Column.SATURATED_S] = saturated
        return transient(replace(both, metrics=metrics))

    low, high = (part * 8.0 for part in TRANSIENT)
    between = (low + high) / 2
    assert shown(between / 3) == pytest.approx(between)
    assert shown(0.0) == shown(np.nan) == low
    assert shown(8.0) == high
    assert flaws(draw(costing, both), _STYLE) == []
    drawn = traces(costing, both, transient(both))
    assert drawn.t[-1] == transient(both)
    assert np.all(np.isfinite(drawn.e))
