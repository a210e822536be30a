"""Chunks: the same bits however the sweep is cut, in one thread or two; invalid runs marked, not made."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import StaleError, UsageError
from pmjoint_codegen.loops.hold import hold_matrices as single_hold
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep import chunks
from pmjoint_codegen.sweep.metrics import INVALID, quantities, status_meanings, values_of
from pmjoint_codegen.sweep.plan import Axis, Plan, make_plan
from pmjoint_codegen.sweep.request import make_request, varied_names
from pmjoint_codegen.sweep.validity import valid_rows
from pmjoint_codegen.tune.request import make_request as make_tuning
from pmjoint_codegen.values import check_rules, check_values

from .conftest import Case


def table(case: Case, bounds: list[int], threads: int = 1) -> bytes:
    pairs = list(pairwise(bounds))
    with ThreadPoolExecutor(threads) as pool:
        parts = pool.map(
            lambda pair: (
                chunks.simulate_chunk(case.library, case.request, case.request.plan.columns(*pair)).table
            ),
            pairs,
        )
        return np.concatenate(list(parts)).tobytes()


def test_neither_the_cut_nor_the_threads_change_a_bit(case: Case) -> None:
    runs = case.request.plan.runs
    whole = table(case, [0, runs])
    assert table(case, [0, 1, 1000, 1003, 4444, runs]) == whole
    assert table(case, [*range(0, runs, 410), runs], threads=2) == whole


def test_values_reach_the_runs_they_belong_to(case: Case) -> None:
    x0, p = chunks.fill_in(
        case.manifest, case.request, {"x2": np.array([1.0, 2.0]), "c1": np.array([3.0, 4.0])}
    )
    names = case.manifest.parameter_names
    assert x0[:, 0].tolist() == [case.request.x0[0]] * 2
    assert x0[:, 1].tolist() == [1.0, 2.0]
    assert p[:, names.index("c1")].tolist() == [3.0, 4.0]
    assert p[1, names.index("c2")] == case.request.p[names.index("c2")]


@pytest.mark.parametrize(
    ("fixed", "varied", "believed", "true"),
    [
        ({}, "b0", [3.0, 4.0], [3.0, 4.0]),
        ({}, "b0_plant", [2.0, 2.0], [3.0, 4.0]),
        ({"b0": 5.0}, "b0_plant", [5.0, 5.0], [3.0, 4.0]),
        ({"b0": 5.0}, "c1", [5.0, 5.0], [5.0, 5.0]),
        ({"b0_plant": 2.0}, "b0", [3.0, 4.0], [2.0, 2.0]),
    ],
)
def test_the_plant_follows_what_is_believed_unless_it_is_set_or_varied(
    case: Case, fixed: dict[str, float], varied: str, believed: list[float], true: list[float]
) -> None:
    request = make_request(case.manifest, Plan((Axis(varied, (3.0, 4.0)),)), parameters=fixed)
    _, p = chunks.fill_in(case.manifest, request, {varied: np.array([3.0, 4.0])})
    names = case.manifest.parameter_names
    assert p[:, names.index("b0")].tolist() == believed
    assert p[:, names.index("b0_plant")].tolist() == true


def test_runs_outside_the_design_s_rules_are_marked_and_the_others_made(case: Case) -> None:
    plan = case.request.plan
    result = chunks.simulate_chunk(case.library, case.request, plan.columns(0, plan.runs)).table
    invalid = plan.columns(0, plan.runs)["c1"] < 0
    assert np.all(result[invalid, Column.STATUS] == INVALID)
    assert np.all(np.isnan(result[invalid, 1:]))
    assert set(result[~invalid, Column.STATUS].tolist()) == {float(Status.DONE), float(Status.DIVERGED)}


@pytest.mark.parametrize("model", ["paper", "third-order", "joint", "joint-lag", "joint-load"])
def test_rules_are_those_of_single_designs(root: Path, model: str) -> None:
    manifest, generator = Manifest.read(root / "generated" / model), np.random.default_rng(0)
    own = np.array([item.value for item in manifest.parameters])
    factors = generator.choice([1.0] * 35 + [-1.0, 0.0, 0.02, 2.0], (400, len(own)))
    p = own * factors
    p[5, 3] = np.nan
    found = valid_rows(manifest, p, np.zeros((400, manifest.nx)))
    assert 0 < np.sum(found) < 400
    for row, good in zip(p.tolist(), found.tolist(), strict=True):
        assert good == is_valid(manifest, row)
    assert not valid_rows(manifest, own[np.newaxis], np.full((1, manifest.nx), math.inf))[0]
    assert not valid_rows(manifest, np.full((1, len(own)), np.nan), np.zeros((1, manifest.nx)))[0]


def is_valid(manifest: Manifest, row: list[float]) -> bool:
    try:
        check_values(
            dict(zip(manifest.parameter_names, row, strict=True)),
            n=manifest.n,
            rho=manifest.rho,
            limit=manifest.limit,
            leading=manifest.leading if manifest.leading in manifest.parameter_names else None,
            where="",
            error=UsageError,
        )
        values = dict(zip(manifest.parameter_names, row, strict=True))
        check_rules(values, manifest.rules, error=UsageError)
    except UsageError:
        return False
    return True


def test_hold_matrices_are_the_single_run_s_and_shared_where_gains_are(case: Case) -> None:
    library = case.library
    p = np.tile(np.array(case.request.p), (5, 1))
    loop = ClosedLoop.load("paper")
    shared = chunks.hold_matrices(library, p, 0.01)
    np.testing.assert_array_equal(shared, single_hold(loop.evaluator, p[0], 0.01)[np.newaxis])
    p[3, case.manifest.parameter_names.index("k1")] = 9.0
    own = chunks.hold_matrices(library, p, 0.01)
    np.testing.assert_array_equal(own, [single_hold(loop.evaluator, row, 0.01) for row in p])


def test_every_column_has_a_name_a_unit_and_every_status_a_word(case: Case) -> None:
    items = quantities(case.manifest)
    assert not case.manifest.can_hold
    usual = [column.name for column in Column if column not in (Column.STUCK_S, Column.STICKS)]
    assert [item.name.upper() for item in items[: len(usual)]] == usual
    assert len(items) == len(usual) + 1 + case.manifest.nX
    table = np.zeros((3, len(Column) + case.manifest.nX))
    table[:, Column.STATUS] = (Status.DONE, Status.DONE, Status.DIVERGED)
    table[:, Column.SETTLING_S] = (1.5, 2.0, np.nan)
    table[:, [Column.FINAL_E, Column.MAX_ABS_E, Column.FINAL_SATURATED]] = [[1, 1, 0], [1, 1, 1], [0, 1, 0]]
    values = dict(zip((item.name for item in items), values_of(case.manifest, table, 2.0).T, strict=True))
    assert values["held"].tolist() == [1, 0, 0]  # within limits; growing at a limit; not at the horizon
    np.testing.assert_array_equal(values["settling_s"], [1.5, np.nan, np.nan])
    assert all(item.unit and item.about for item in items)
    assert set(status_meanings()) == {status.value for status in Status} - {0} | {INVALID}


def test_a_request_is_known_by_everything_that_its_result_depends_on(case: Case) -> None:
    plan = case.request.plan
    changes: list[dict[str, object]] = [
        {},
        {"parameters": {"d1": 0.21}},
        {"x0": (1.0, 0.0)},
        {"horizon": 3.0},
        {"controller": "sampled"},
        {"controller": "sampled", "sample_time": 0.002},
        {"tolerance": 1e-7},
        {"output_step": 0.5},
        {"divergence": 77.0},
    ]
    hashes = {make_request(case.manifest, plan, **change).hash for change in changes}  # type: ignore[arg-type]
    assert len(hashes) == len(changes)
    assert make_request(case.manifest, plan).hash in hashes
    assert make_request(case.manifest, make_plan(("x1=0,1",), (), None, 0, "sobol")).hash not in hashes


@pytest.mark.parametrize("change", ["loops_hash", "_sampler"])
def test_what_another_version_would_compute_is_another_sweep(
    case: Case, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    """Interrupted, updated and started again: chunks of two versions must not meet in one dataset."""
    drawn = make_plan((), ("b0~normal(2,0.1)",), 8, 0, "sobol")
    before = make_request(case.manifest, drawn).hash
    assert before == make_request(case.manifest, drawn).hash
    monkeypatch.setattr(f"pmjoint_codegen.sweep.request.{change}", lambda: "another")
    assert make_request(case.manifest, drawn).hash != before


def test_a_request_is_written_out_once_and_a_changed_one_anew(case: Case) -> None:
    request = make_request(case.manifest, make_plan(("x1=-1:1:1000",), (), None, 0, "sobol"))
    assert request.hash is request.hash  # an axis of a million values costs seconds each time
    assert request.document is request.document
    other = replace(request, horizon=2.5)
    assert other.hash != request.hash
    assert other.document["horizon"] == 2.5


def test_a_model_generated_without_lanes_is_stale(case: Case) -> None:
    old = replace(
        case.manifest, files={name: hash for name, hash in case.manifest.files.items() if name != "lanes.c"}
    )
    with pytest.raises(StaleError, match=r"no lanes\.c.*pmjoint regenerate paper"):
        make_request(old, case.request.plan)
    with pytest.raises(StaleError, match=r"no lanes\.c.*pmjoint regenerate paper"):
        make_tuning(old)


@pytest.mark.parametrize(
    ("grid", "settings", "words"),
    [
        ("xx=1,2", {}, "no 'xx' to vary; .*names: x1, x2, d1"),
        ("c1=1,2", {"parameters": {"c1": 3.0}}, "both set and varied"),
        ("compensator=0,1", {"compensator": False}, "both set and varied"),
        ("c1=0:1:100000", {"output_step": 0.001}, "--trajectories: would keep .* GiB of trajectories"),
        ("c1=1,2", {"divergence": -1.0}, "--divergence"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused(
    case: Case, grid: str, settings: dict[str, object], words: str
) -> None:
    plan = make_plan((grid,), (), None, 0, "sobol")
    with pytest.raises(UsageError, match=words):
        make_request(case.manifest, plan, **settings)  # type: ignore[arg-type]
    assert "compensator" in varied_names(case.manifest)


@pytest.mark.parametrize("name", ["draw", "ise", "final_x1"])
def test_a_parameter_that_is_named_as_a_result_cannot_be_varied(case: Case, name: str) -> None:
    known = case.manifest.parameters
    renamed = tuple(replace(item, name=item.name.replace("d1", name)) for item in known)
    manifest = replace(case.manifest, parameters=renamed)
    with pytest.raises(UsageError, match=f"has a parameter '{name}'"):
        make_request(manifest, make_plan((f"{name}=1,2",), (), None, 0, "sobol"))
    make_request(manifest, make_plan(("c1=1,2",), (), None, 0, "sobol"))
