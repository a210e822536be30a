"""The search: better than the model, the same for the same seed, within what was asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops.batch import BatchLibrary
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.tune.comparison import compare, summary_table
from pmjoint_codegen.tune.cost import BEYOND, CostFunction
from pmjoint_codegen.tune.request import make_request
from pmjoint_codegen.tune.search import search


def test_a_search_beats_the_model_within_the_limit_on_every_plant(
    library: BatchLibrary, paper: Manifest
) -> None:
    asked = make_request(
        paper, max_v=120.0, perturb=("x1~uniform(0.5,2)",), plants=3, generations=8, horizon=8.0
    )
    costing = CostFunction(library, asked)
    found = search(costing)
    assert found.before > BEYOND  # the paper's own gains peak at 226 V
    both = compare(costing, found).metrics
    assert np.all(both[1, :, Column.MAX_ABS_V] <= 120.0)
    assert np.max(both[1, :, Column.ISE]) == found.cost  # what is reported is what was written
    assert found.cost < 0.5 * np.max(both[0, :, Column.ISE])


def test_the_seed_decides_and_the_threads_do_not(library: BatchLibrary, paper: Manifest) -> None:
    def gains(seed: int, threads: int) -> object:
        asked = make_request(paper, gains=("c", "ck"), generations=3, seed=seed, horizon=4.0)
        return search(CostFunction(library, asked, threads)).gains

    assert gains(1, 1) == gains(1, 2)
    assert gains(1, 1) != gains(2, 1)


def test_an_optimum_that_is_known_is_found(library: BatchLibrary, paper: Manifest) -> None:
    """At t = 0 with all filters at rest, |v| grows with c1: the least peak lies at its lower bound."""
    asked = make_request(paper, gains=("c1=5:30",), objective="max_abs_v", generations=40, horizon=0.5)
    found = search(CostFunction(library, asked))
    assert found.gains["c1"] == pytest.approx(5.0, rel=0.02)
    assert found.edges == ("c1",)


def test_where_nothing_is_better_that_is_said(library: BatchLibrary, paper: Manifest) -> None:
    """With the model's own c1 as lower bound, no c1 has a smaller peak of v: see above."""
    asked = make_request(paper, gains=("c1=15:30",), objective="max_abs_v", generations=2, horizon=0.5)
    with pytest.raises(UsageError, match="better than the model's own"):
        search(CostFunction(library, asked))


@dataclass(frozen=True)
class Recorder(CostFunction):
    """Evaluates designs, and keeps them."""

    tried: list[dict[str, list[float]]] = field(default_factory=list)

    def __call__(self, gains: Mapping[str, Array]) -> Array:
        self.tried.append({name: values.tolist() for name, values in gains.items()})
        return super().__call__(gains)


def test_the_models_own_design_is_in_the_first_generation(library: BatchLibrary, paper: Manifest) -> None:
    asked = make_request(paper, gains=("c",), generations=1, population=4, horizon=1.0)
    costing = Recorder(library, asked)
    search(costing)
    first = costing.tried[1]  # after the model itself
    assert len(first["c1"]) == 8
    assert (first["c1"][0], first["c2"][0]) == pytest.approx((15.0, 15.0), rel=1e-4)  # five digits


def test_progress_counts_designs(library: BatchLibrary, paper: Manifest) -> None:
    asked = make_request(paper, gains=("c",), generations=2, population=4, horizon=1.0)
    told: list[int] = []
    found = search(CostFunction(library, asked), told.append)
    assert told == [8, 16, 24]
    assert found.designs == asked.most_designs == 24


def test_the_impossible_is_said(library: BatchLibrary, paper: Manifest) -> None:
    asked = make_request(paper, gains=("c1",), max_v=0.1, generations=1, horizon=1.0)
    with pytest.raises(UsageError, match=r"keeps \|v\| <= 0.1"):
        search(CostFunction(library, asked))


def test_what_the_best_design_lacks_is_named_whatever_was_asked(
    library: BatchLibrary, paper: Manifest
) -> None:
    huge = make_request(paper, gains=("c1",), objective="1e15*ise", generations=1, horizon=1.0)
    with pytest.raises(UsageError, match=r"none of \d+ designs has an objective below 1e\+12; give smaller"):
        search(CostFunction(library, huge))
    stiff = make_request(paper, gains=("poles=1e160:1e170",), generations=1, horizon=1.0)
    with pytest.raises(UsageError, match=r"none of .* satisfies the rules of the design"):
        search(CostFunction(library, stiff))


def test_the_mean_that_is_minimised_is_told(library: BatchLibrary, paper: Manifest) -> None:
    perturb = ("b0~uniform(1.6,2.4)",)
    asked = make_request(paper, perturb=perturb, plants=3, over="mean", generations=2, horizon=4.0)
    costing = CostFunction(library, asked)
    found = search(costing)
    told = summary_table(compare(costing, found))
    assert told["mean"]["objective"] == {"before": found.before, "after": found.cost}
    assert told["worst"]["objective"]["after"] > found.cost
