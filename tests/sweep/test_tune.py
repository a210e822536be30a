"""Tuning: what it promises of the gains that it finds, and the model file that it writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.spec.reader import read_document
from pmjoint_codegen.sweep.plan import Plan, read_axis
from pmjoint_codegen.sweep.request import make_request
from pmjoint_codegen.sweep.tune import BROKEN, Goal, Tuned, check_goal, perturbed, tune, with_gains

from .conftest import Case

BOUNDS = {"c1": (2.0, 40.0), "ck1": (0.5, 20.0)}


def search(case: Case, goal: Goal, generations: int = 8, **settings: object) -> Tuned:
    request = make_request(case.manifest, Plan((read_axis("c1=1"),)), **{"horizon": 8.0, **settings})  # type: ignore[arg-type]
    check_goal(case.manifest, goal)
    return tune(case.library, request, goal, seed=1, generations=generations, tell=lambda fraction: None)


def goal_of(case: Case, **changes: object) -> Goal:
    own = {item.name: item.value for item in case.manifest.parameters}
    draws = {"d1": np.array([0.15, 0.25]), "b0": np.array([1.8, 2.2])}
    goal = Goal(BOUNDS, {"ise": 1.0}, float("inf"), perturbed(own, draws))
    return replace(goal, **changes)  # type: ignore[arg-type]


def test_what_is_found_is_better_within_bounds_and_as_a_single_run_has_it(case: Case) -> None:
    found = search(case, goal_of(case))
    assert found.cost < 0.5 * found.cost_before
    assert found.cost_before == pytest.approx(1.0, rel=1e-12)
    assert all(BOUNDS[name][0] <= value <= BOUNDS[name][1] for name, value in found.gains.items())
    loop = ClosedLoop.load("paper")
    plants = [{}, {"d1": 0.15, "b0": 1.8}, {"d1": 0.25, "b0": 2.2}]
    runs = [loop.simulate(parameters={**plant, **found.gains}, horizon=8.0) for plant in plants]
    assert found.after["ise"] == pytest.approx(np.mean([run.ise for run in runs]), rel=1e-5)
    assert found.peak_after == pytest.approx(max(run.peaks["v"][0] for run in runs), rel=1e-6)


def test_the_same_seed_finds_the_same(case: Case) -> None:
    assert search(case, goal_of(case), 3) == search(case, goal_of(case), 3)


def test_a_limit_on_v_holds_on_every_plant(case: Case) -> None:
    free = search(case, goal_of(case, weights={"max_abs_e": 1.0}))
    limit = 0.8 * min(free.peak_before, free.peak_after)
    bound = search(case, goal_of(case, limit=limit))
    assert bound.peak_after <= limit < bound.peak_before
    assert bound.cost < BROKEN <= bound.cost_before


def test_gains_that_lose_every_plant_are_nothing_to_compare_with(case: Case) -> None:
    with pytest.raises(SimulationError, match="lose the joint on every plant"):
        search(case, goal_of(case), x0=(150.0, 0.0), horizon=20.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bounds": {}}, "nothing is free"),
        ({"bounds": {"d1": (0.1, 0.2)}}, "no gain 'd1'"),
        ({"bounds": {"c1": (0.0, 2.0)}}, "0 < LOW < HIGH"),
        ({"weights": {"beauty": 1.0}}, "--weight"),
        ({"weights": {"ise": -1.0}}, "--weight"),
        ({"limit": 0.0}, "--limit-v"),
    ],
)
def test_a_goal_that_cannot_be_is_refused(case: Case, changes: dict[str, object], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        check_goal(case.manifest, goal_of(case, **changes))


def test_a_model_file_gets_its_gains_and_keeps_all_else(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "joint.toml").read_text()
    design = {
        key: read_document(root / "models" / "joint.toml")["design"][key] for key in ("c", "e", "ck", "k")
    }
    path = tmp_path / "joint.toml"
    path.write_text(with_gains(text, {"c2": 1 / 3, "k1": 41.5}, design))
    changed = read_document(path)
    assert changed["design"]["c"] == [design["c"][0], 1 / 3]
    assert changed["design"]["k"] == [41.5, design["k"][1]]
    assert "both poles of A0" in path.read_text()
    changed["design"] = {**changed["design"], "c": design["c"], "k": design["k"]}
    assert changed == read_document(root / "models" / "joint.toml")
    with pytest.raises(UsageError, match="one line"):
        with_gains("[design]\nc = [\n1, 2]\n", {"c1": 1.0}, {"c": [1, 2]})
