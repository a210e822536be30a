"""Which runs a sweep makes, from the options of the command line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.sweep.plan import Plan, make_plan, read_axis, read_sample
from pmjoint_codegen.sweep.request import varied_names

GRID = ("x1=-1:1:3", "c1=5,10")
SAMPLE = ("J~normal(2,0.5)", "r~uniform(1,3)", "b~loguniform(0.1,10)")


def test_runs_are_numbered_row_by_row_with_the_draws_fastest() -> None:
    plan = make_plan(GRID, SAMPLE[:1], 4, 1, "latin-hypercube")
    assert plan.dimensions == {"x1": 3, "c1": 2, "draw": 4}
    columns = plan.columns(0, plan.runs)
    assert columns["x1"].reshape(3, 2, 4)[:, 1, 2].tolist() == [-1.0, 0.0, 1.0]
    assert columns["c1"].reshape(3, 2, 4)[2, :, 0].tolist() == [5.0, 10.0]
    assert np.array_equal(columns["J"].reshape(3, 2, 4)[1, 0], plan.drawn["J"])


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_any_part_is_that_part_of_the_whole_and_a_seed_is_a_sample(method: str) -> None:
    plan = make_plan(GRID, SAMPLE, 50, 7, method)
    whole = plan.columns(0, plan.runs)
    part = make_plan(GRID, SAMPLE, 50, 7, method).columns(123, 217)
    other = make_plan(GRID, SAMPLE, 50, 8, method).columns(123, 217)
    for name, values in part.items():
        assert np.array_equal(values, whole[name][123:217])
    assert not np.array_equal(part["J"], other["J"])


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_draws_have_the_distribution_that_was_asked_for(method: str) -> None:
    drawn = make_plan((), SAMPLE, 1024, 3, method).drawn
    u = (np.arange(1024) + 0.5) / 1024
    # A stratified sample of n has one point in each n-th, so no quantile is off by more than one stratum.
    for name, exact in {"r": 1 + 2 * u, "b": 0.1 * 100**u}.items():
        ordered = np.sort(drawn[name])
        step = np.max(np.diff(exact))
        assert np.all(np.abs(ordered - exact) <= step)
    assert np.mean(drawn["J"]) == pytest.approx(2, abs=0.01)
    assert np.std(drawn["J"]) == pytest.approx(0.5, rel=0.02)


def test_an_axis_may_list_its_values() -> None:
    assert read_axis("compensator=0,1").values == (0.0, 1.0)
    assert read_axis("x1=2:2:1").values == (2.0,)
    assert Plan((read_axis("a=1,2,3"),)).runs == 3


@pytest.mark.parametrize(
    "text",
    [
        "x1",
        "x1=",
        "=1:2:3",
        "x1=1:2",
        "x1=1:2:0",
        "x1=1:2:2.5",
        "x1=a,b",
        "x1=1:nan:3",
        "x1=1,inf",
        "x1=1,2,1",
    ],
)
def test_an_axis_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--grid"):
        read_axis(text)


@pytest.mark.parametrize(
    "text",
    [
        "J",
        "J~normal",
        "J~normal(1)",
        "J~cauchy(0,1)",
        "J~normal(1,0)",
        "J~uniform(2,1)",
        "J~loguniform(0,1)",
        "J~normal(1,x)",
        "J~uniform(0,inf)",
        "J~uniform(-1e308,1e308)",
    ],
)
def test_a_sample_that_cannot_be_read_or_is_no_distribution_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--sample"):
        read_sample(text)


@pytest.mark.parametrize(
    ("grid", "sample", "draws", "seed", "words"),
    [
        ((), (), None, 0, "nothing is varied"),
        (("J=1,2",), ("J~normal(1,1)",), 5, 0, "J is varied twice"),
        ((), ("J~normal(1,1)",), None, 0, "--sample and --runs"),
        (("J=1,2",), (), 5, 0, "--sample and --runs"),
        ((), ("J~normal(1,1)",), 0, 0, "asks for 0 runs"),
        ((), ("J~normal(1,1)",), -5, 0, "asks for -5 runs"),
        ((), ("J~normal(1,1)",), 5, -1, "--seed: is -1"),
        ((), ("J~normal(1,1)",), 5, 2**63, "--seed: is 9223372036854775808"),
        (
            ("a=0:1:100000", "b=0:1:100000"),
            (),
            None,
            0,
            "asks for 10000000000 runs; allowed: 1 to 100000000",
        ),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(
    grid: tuple[str, ...], sample: tuple[str, ...], draws: int | None, seed: int, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        make_plan(grid, sample, draws, seed, "sobol")


def test_an_axis_may_span_more_than_a_double_holds() -> None:
    assert read_axis("x1=-1e308:1e308:3").values == (-1e308, 0.0, 1e308)
    assert read_axis("x1=1.7e308:-1.7e308:2").values == (1.7e308, -1.7e308)


def test_what_does_not_fit_is_refused_at_once_with_what_does() -> None:
    with pytest.raises(UsageError, match="at most 1000000 values fit"):
        read_axis("x1=0:1:100000000")
    with pytest.raises(UsageError, match="at most 10000000 draws fit"):
        make_plan((), ("a~uniform(0,1)", "b~uniform(0,1)"), 10_000_001, 0, "sobol")
    with pytest.raises(UsageError, match="allowed: 1 to 100000000"):
        make_plan(("x1=0:1:1000000", "x2=0:1:101"), (), None, 0, "sobol")


@pytest.mark.parametrize("grid", [(), ("x1",)])
def test_what_a_refusal_advises_can_be_done_with_every_model(grid: tuple[str, ...], root: Path) -> None:
    with pytest.raises(UsageError) as caught:
        make_plan(grid, (), None, 0, "sobol")
    advised = set(re.findall(r"([a-z]\w*)[=~][-a-z\d]", caught.value.remedy))
    manifests = [Manifest.read(path.parent) for path in sorted(root.glob("generated/*/model.json"))]
    assert advised and len(manifests) > 3
    for manifest in manifests:
        assert advised <= set(varied_names(manifest)), manifest.name
