"""Costs: the objective where it exists, and tiers that put every failure in its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.metrics import INVALID
from pmjoint_codegen.tune.cost import BEYOND, BROKEN, LOST, CostFunction, cost
from pmjoint_codegen.tune.request import Request, make_request


@pytest.fixture
def request_(paper: Manifest) -> Request:
    return make_request(paper, max_v=10.0, perturb=("b0~uniform(1.6,2.4)",), plants=1, horizon=2.0)


def run(status: int = Status.DONE, ise: float = 1.0, v: float = 5.0, t_end: float = 2.0) -> Array:
    row = np.zeros(len(Column))
    row[[Column.STATUS, Column.ISE, Column.MAX_ABS_V, Column.T_END]] = status, ise, v, t_end
    return row


def test_failures_cost_more_the_worse_they_are(request_: Request) -> None:
    good, nan = run(), float("nan")
    designs = [
        [good, run(ise=1e11)],
        [good, run(v=11.0)],
        [good, run(v=1e200)],
        [good, run(Status.DIVERGED, t_end=1.5, ise=nan)],
        [good, run(Status.DIVERGED, t_end=0.5, ise=nan)],
        [run(Status.NON_FINITE, t_end=0.1, ise=nan, v=nan)] * 2,
        [run(INVALID, ise=nan, v=nan, t_end=nan)] * 2,
    ]
    costs = cost(np.array(designs), request_)
    assert np.all(np.isfinite(costs))
    assert np.all(np.diff(costs) > 0)
    assert costs[0] < BEYOND < costs[1] < costs[2] < LOST < costs[3]
    assert costs[5] < BROKEN == costs[6]


def test_a_peak_just_at_the_limit_keeps_it(request_: Request) -> None:
    assert cost(np.array([[run(v=10.0), run()]]), request_) == 1.0
    assert cost(np.array([[run(v=np.nextafter(10.0, 11.0)), run()]]), request_) >= BEYOND


def test_worst_and_mean(request_: Request) -> None:
    designs = np.array([[run(ise=1.0), run(ise=3.0)]])
    assert cost(designs, request_) == 3.0
    assert cost(designs, replace(request_, over="mean")) == 2.0


def test_an_undefined_objective_is_said(request_: Request) -> None:
    design = run()
    design[Column.SETTLING_S] = np.nan
    asked = make_request_with_settling(request_)
    with pytest.raises(UsageError, match="no settling time"):
        cost(np.array([[design, design]]), asked)


def make_request_with_settling(request_: Request) -> Request:
    from pmjoint_codegen.tune.objective import read_objective

    return replace(request_, objective=read_objective("settling_s"))


def test_every_design_meets_every_plant_whatever_the_threads(library: BatchLibrary, paper: Manifest) -> None:
    asked = make_request(paper, perturb=("x1~uniform(-3,3)",), plants=4, seed=5, horizon=2.0)
    gains = {"c1": np.array([15.0, 30.0, 7.0])}
    one = CostFunction(library, asked, 1).metrics(gains)
    np.testing.assert_array_equal(one, CostFunction(library, asked, 3).metrics(gains))
    assert one.shape[:2] == (3, 5)
    own = CostFunction(library, make_request(paper, horizon=2.0)).metrics(gains)
    np.testing.assert_array_equal(one[:, :1], own)  # the first plant is the model's own
    largest = np.abs(asked.plants["x1"])
    assert np.all(one[..., Column.MAX_ABS_E] >= largest)  # y_r(0) = 0, so e(0) = x1(0)


def test_a_design_whose_filter_is_unstable_is_refused_at_a_finite_cost(
    library: BatchLibrary, paper: Manifest
) -> None:
    asked = make_request(paper, gains=("k=1:100",), horizon=1.0)
    costs = CostFunction(library, asked)({"k1": np.array([-1.0, 6.0]), "k2": np.array([8.0, 8.0])})
    assert costs[0] == BROKEN
    assert costs[1] < BEYOND
