"""Stick in lanes: as in single runs, whatever runs beside it, at every vector width."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.kernels.processor import usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.batch import BatchLibrary, Outcome, Runs
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.provision import provide

from .conftest import sampled

COMPILER = find_compiler(os.environ)
pytestmark = pytest.mark.skipif(COMPILER is None, reason="the batch loops are compiled")

REFERENCE = "0.3*sin(2*t)"
FORCE = ("0", "-(0.6 + 0.2*exp(-(x2/0.05)**2) + 0.2*(1 - sign(x2)**2))*sign(x2) + 0.3*sign(t - 1.3)")
STARTS = [(0.0, 0.0), (0.3, -0.4), (0.0, 1.5), (-0.5, 0.0), (0.1, 0.0), (0.7, 0.7)]
PERIODS = [0.0, 0.01]


def lanes(
    cache: Path, level: str = "", force: tuple[str, str] = FORCE, reference: str = REFERENCE
) -> BatchLibrary:
    provided = provide(
        "paper",
        reference=reference,
        disturbance=force,
        environment=os.environ,
        notify=lambda line: None,
        lanes=True,
    )
    assert COMPILER is not None
    levels = usable_levels({"PMJOINT_VECTOR_LEVEL": level} if level else {})
    return batch.load(batch.batch_sources(provided.folder), provided.manifest, levels, COMPILER, cache)


def runs_of(
    one: BatchLibrary, starts: list[tuple[float, float]], period: float, horizon: float = 3.0
) -> Runs:
    own = np.array([item.value for item in one.manifest.parameters])
    x0 = np.zeros((len(starts), one.manifest.nX))
    x0[:, :2] = starts
    times = np.linspace(0.0, horizon, 301)
    runs = Runs(x0, np.tile(own, (len(starts), 1)), horizon, 1e-9, 0.0, np.empty((0, 0)), times, 1e6, 100_000)
    return sampled(one, runs, period) if period else runs


def same(one: Outcome, other: Outcome) -> bool:
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes()
        for name in ("metrics", "final", "trajectories")
    )


@pytest.mark.parametrize("period", PERIODS)
def test_lanes_rest_where_single_runs_do(cache: Path, period: float) -> None:
    one = lanes(cache)
    outcome = one.simulate(runs_of(one, STARTS, period))
    loop = ClosedLoop.load(
        "paper", "compiled", reference=REFERENCE, disturbance=FORCE, notify=lambda line: None
    )
    rested = 0
    for i, start in enumerate(STARTS):
        run = loop.simulate(
            x0=start,
            horizon=3.0,
            output_step=0.01,
            controller="sampled" if period else "continuous",
            sample_time=period or 0.01,
        )
        assert outcome.metrics[i, Column.STATUS] == Status.DONE
        found = outcome.trajectories[i, :, : one.manifest.nX]
        scale = 1.0 + np.max(np.abs(run.states), axis=0)
        assert np.max(np.abs(found - run.states) / scale) < 2e-8
        assert np.array_equal(found[:, 1] == 0.0, run["x2"] == 0.0)
        assert outcome.metrics[i, Column.ISE] == pytest.approx(run.ise, rel=1e-7)
        assert outcome.metrics[i, Column.STICKS] == len(run.sticks)
        assert outcome.metrics[i, Column.STUCK_S] == pytest.approx(run.summary["stuck_s"], abs=1e-7)
        rested += len(run.sticks)
    assert rested > len(STARTS)


@pytest.mark.parametrize("period", PERIODS)
def test_a_run_is_the_same_in_any_company(cache: Path, period: float) -> None:
    one = lanes(cache)
    together = one.simulate(runs_of(one, STARTS, period))
    back = one.simulate(runs_of(one, STARTS[::-1], period))
    turned = replace(
        back, metrics=back.metrics[::-1], final=back.final[::-1], trajectories=back.trajectories[::-1]
    )
    assert same(together, turned)
    alone = one.simulate(runs_of(one, STARTS[:1], period))
    assert alone.trajectories.tobytes() == together.trajectories[:1].tobytes()


@pytest.mark.parametrize("period", PERIODS)
def test_every_vector_width_gives_the_same_bits(cache: Path, period: float) -> None:
    first, *others = (
        lib.simulate(runs_of(lib, STARTS, period))
        for lib in (lanes(cache, level.name) for level in usable_levels({}))
    )
    assert all(same(first, other) for other in others)


@pytest.mark.parametrize("period", PERIODS)
def test_more_friction_at_rest_holds_a_start_at_rest(cache: Path, period: float) -> None:
    """A force of 0.4 between 0.2 in motion and 0.5 at rest; without input nothing else acts."""
    one = lanes(cache, force=("0", "0.4 - (0.2 + 0.3*(1 - sign(x2)**2))*sign(x2)"))
    runs = runs_of(one, [(0.1, 0.0), (0.1, 1e-3)], period)
    names = list(one.manifest.parameter_names)
    runs.p[:, names.index("b0_plant")], runs.p[:, names.index("d1_plant")] = 1e-12, 0.0
    rests, slides = one.simulate(runs).trajectories[:, :, :2]
    assert np.all(rests == [0.1, 0.0])
    assert slides[-1, 1] == pytest.approx(1e-3 + 0.2 * 3.0, abs=1e-7)


@pytest.mark.parametrize(
    ("force", "period"),
    [("0.3*abs(x2 - 0.7*x1 + 0.21)", 0.0), ("0.038*abs(x2 - 0.51*x1 + 0.1521) - 0.1*sign(x2)", 0.001)],
)
def test_a_run_may_come_to_rest_on_a_kink_without_a_jump(cache: Path, force: str, period: float) -> None:
    one = lanes(cache, force=("0", force), reference="0.3")
    outcome = one.simulate(runs_of(one, [(0.2, 1.0), (0.3, 0.0), (1.0, 0.0), (0.0, 0.0)], period, 60.0))
    assert np.all(outcome.metrics[:, Column.STATUS] == Status.DONE)
