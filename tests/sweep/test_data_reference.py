"""Sweeps whose reference is data: lanes against single runs, and new numbers without a compilation."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.provision import Provided, provide
from pmjoint_codegen.sweep.build_inputs import library_of, make_inputs
from pmjoint_codegen.sweep.chunks import Result, simulate_chunk
from pmjoint_codegen.sweep.metrics import settled
from pmjoint_codegen.sweep.plan import make_plan
from pmjoint_codegen.sweep.request import make_request

pytest.importorskip("sympy")
pytest.importorskip("casadi")

JUMPS: dict[str, Any] = {"steps": [[0.0, 0.2], [0.5, 1.0], [1.2345, -0.5]]}
SMOOTH: dict[str, Any] = {**JUMPS, "filter": 9.0}
TABLE: dict[str, Any] = {"table": [[0.1 * k, float(np.sin(0.3 * k))] for k in range(31)]}
HOLDS: dict[str, Any] = {"controller": "sampled", "sample_time": 0.003}  # break points fall inside
GAINS = (10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0)


def provided(root: Path, reference: dict[str, Any]) -> Provided:
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    return provide(
        root / "models" / "paper.toml",
        reference=reference,
        environment=os.environ,
        notify=lambda line: None,
        lanes=True,
    )


def swept(made: Provided, runs: slice, **asked: Any) -> Result:
    plan = make_plan(("c1=" + ",".join(map(str, GAINS)),), (), None, 0, "latin-hypercube")
    request = make_request(made.manifest, plan, horizon=1.6, output_step=0.01, **asked)
    columns = {name: values[runs] for name, values in plan.columns(0, plan.runs).items()}
    return simulate_chunk(library_of(make_inputs(made.folder), os.environ), request, columns)


@pytest.mark.parametrize("reference", [JUMPS, SMOOTH, TABLE])
@pytest.mark.parametrize(
    "asked", [{}, {"controller": "sampled"}, {"controller": "sampled", "sample_time": 0.02}]
)
def test_lanes_follow_single_runs(
    root: Path, cache: Path, reference: dict[str, Any], asked: dict[str, Any]
) -> None:
    made = provided(root, reference)
    found = swept(made, slice(None), tolerance=1e-10, **asked)
    loop = ClosedLoop.load(root / "models" / "paper.toml", "compiled", reference=reference)
    for i, gain in enumerate(GAINS):
        run = loop.simulate(horizon=1.6, parameters={"c1": gain}, **asked)
        np.testing.assert_allclose(found.trajectories[i, :, :-2], run.states, rtol=0, atol=2e-8)
        assert found.table[i, Column.ISE] == pytest.approx(run.ise, rel=1e-8)
        assert found.table[i, Column.MAX_ABS_E] == pytest.approx(run.peaks["e"][0], rel=1e-8)
        assert found.table[i, Column.MAX_ABS_V] == pytest.approx(run.peaks["v"][0], rel=1e-8)
        settling = np.nan if run.settling_s is None else run.settling_s
        assert settled(found.table[i], 1.6) == pytest.approx(settling, abs=1e-6, nan_ok=True)


@pytest.mark.parametrize("asked", [{}, HOLDS])
def test_a_run_is_the_same_in_any_chunk(root: Path, cache: Path, asked: dict[str, Any]) -> None:
    made = provided(root, JUMPS)
    whole = swept(made, slice(None), **asked)
    for i in range(len(GAINS)):
        alone = swept(made, slice(i, i + 1), **asked)
        np.testing.assert_array_equal(alone.table[0], whole.table[i])
        np.testing.assert_array_equal(alone.trajectories[0], whole.trajectories[i])


def test_new_numbers_derive_and_compile_nothing(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "cache"  # of this test alone
    cache.mkdir(mode=0o700)
    monkeypatch.setenv("PMJOINT_CACHE", str(cache))
    first = swept(provided(root, JUMPS), slice(None))

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("derived")

    monkeypatch.setattr("pmjoint_codegen.emit.pipeline.generate", refuse)
    before = set(cache.rglob("*"))
    second = swept(provided(root, TABLE), slice(None))
    assert set(cache.rglob("*")) == before
    assert not np.array_equal(first.table, second.table)
    with pytest.raises(AssertionError, match="derived"):
        provide(
            root / "models" / "paper.toml",
            reference="cos(7*t)",
            environment=os.environ,
            notify=lambda line: None,
            lanes=True,
        )
