"""Of how many runs of a sweep the law is too fast for their clock: each run counts with its own values."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.simulate.pace import too_fast
from pmjoint_codegen.sweep import pace
from pmjoint_codegen.sweep.chunks import fill_in
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import Request, make_request


@pytest.fixture(scope="module")
def lag(root: Path) -> Manifest:
    return Manifest.read(root / "generated" / "joint-lag")


def asked(manifest: Manifest, grid: tuple[str, ...], sample: tuple[str, ...] = (), draws: int = 7) -> Request:
    plan = make_plan(grid, sample, draws if sample else None, 3, "sobol")
    own = {} if "sample_time" in plan.names else {"sample_time": 0.01}
    return make_request(manifest, plan, controller="sampled", **own)  # type: ignore[arg-type]


def one_by_one(manifest: Manifest, request: Request) -> int:
    """The same count by the warning of single runs."""
    columns = request.plan.columns(0, request.plan.runs)
    _, p = fill_in(manifest, request, columns)
    periods = columns.get("sample_time", [request.sample_time] * len(p))
    rows = (dict(zip(manifest.parameter_names, row, strict=False)) for row in p.tolist())
    return sum(too_fast(manifest, row, float(T)) is not None for row, T in zip(rows, periods, strict=True))


@pytest.mark.parametrize(
    ("grid", "sample"),
    [
        (("c2=20:90:8",), ()),
        (("input_scale=1,50,436,900", "theta=0:0.1:3"), ()),
        (("sample_time=0.002,0.005,0.01,0.02",), ("J~uniform(0.01,0.2)",)),
        (("k1=60:240:4", "sample_time=0.002,0.02"), ("b_v~uniform(0.05,0.2)",)),
    ],
)
def test_every_run_is_judged_with_its_own_values(
    lag: Manifest, grid: tuple[str, ...], sample: tuple[str, ...]
) -> None:
    request = asked(lag, grid, sample)
    count = one_by_one(lag, request)
    assert 0 < count < request.plan.runs
    line = pace.too_fast_runs(lag, request)
    assert line is not None and "\n" not in line
    assert line.startswith(f"in {count} of {request.plan.runs} runs the law may be too fast; in the worst, ")


def test_runs_that_no_rule_allows_are_not_counted(lag: Manifest) -> None:
    request = asked(lag, ("c2=-5,40,200,300",))
    line = pace.too_fast_runs(lag, request)
    assert line is not None and line.startswith("in 2 of 4 runs") and "is 300 1/s" in line


def test_a_large_sweep_is_judged_in_part(lag: Manifest, monkeypatch: pytest.MonkeyPatch) -> None:
    request = asked(lag, ("c2=1:100:1000", "theta=0:1:9"))
    exact = one_by_one(lag, asked(lag, ("c2=1:100:1000",))) * 9
    assert str(pace.too_fast_runs(lag, request)).startswith(f"in {exact} of 9000 runs")
    monkeypatch.setattr(pace, "MOST_JUDGED", 500)
    line = pace.too_fast_runs(lag, request)
    assert line is not None and line.startswith("in about ")
    assert int(line.split()[2]) == pytest.approx(exact, abs=3 * 9000 * 0.5 / 500**0.5)


def test_nothing_is_said_where_nothing_is_too_fast_or_no_clock_ticks(lag: Manifest) -> None:
    assert pace.too_fast_runs(lag, asked(lag, ("c2=20,30",))) is None
    plan = make_plan(("c2=20,900",), (), None, 0, "sobol")
    assert pace.too_fast_runs(lag, make_request(lag, plan, controller="continuous")) is None
