"""The batch loops: every run as if it were alone, at every vector width, and as a single run has it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.compile.library import build
from pmjoint_codegen.kernels.declarations import load_module, to_module
from pmjoint_codegen.kernels.processor import known_levels, usable_levels
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.batch import BatchLibrary, Runs
from pmjoint_codegen.loops.constants import DEFECT
from pmjoint_codegen.loops.metrics import Column
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.provision import provide

from .conftest import designed, library, make_runs, sampled

COMPILER = find_compiler(os.environ)
pytestmark = pytest.mark.skipif(COMPILER is None, reason="the batch loops are compiled")


@pytest.fixture(scope="module")
def paper(root: Path, cache: Path) -> BatchLibrary:
    return library(root, cache, "paper", known_levels()[0].name)


def some(runs: Runs, rows: slice | list[int]) -> Runs:
    hold = runs.hold[rows] if len(runs.hold) > 1 else runs.hold
    x0, p, hold = (np.ascontiguousarray(part) for part in (runs.x0[rows], runs.p[rows], hold))
    return replace(runs, x0=x0, p=p, hold=hold)


@pytest.mark.parametrize("sample_time", [0.0, 0.004])
def test_a_run_is_the_same_alone_in_any_company_and_in_any_order(
    paper: BatchLibrary, sample_time: float
) -> None:
    runs = make_runs(paper, 37, horizon=4.0)
    runs = sampled(paper, runs, sample_time) if sample_time else runs
    together = paper.simulate(runs)
    order = np.random.default_rng(1).permutation(37).tolist()
    shuffled = paper.simulate(some(runs, order))
    assert shuffled.metrics.tobytes() == together.metrics[order].tobytes()
    assert shuffled.final.tobytes() == together.final[order].tobytes()
    for i in range(0, 37, 5):
        alone = paper.simulate(some(runs, [i]))
        assert alone.metrics.tobytes() == together.metrics[i : i + 1].tobytes()
        assert alone.final.tobytes() == together.final[i : i + 1].tobytes()


@pytest.mark.parametrize("model", ["paper", "joint-exact"])
@pytest.mark.parametrize("sample_time", [0.0, 0.004])
def test_every_vector_width_gives_the_same_bits(
    root: Path, cache: Path, model: str, sample_time: float
) -> None:
    results = []
    for level in usable_levels({}):
        one = library(root, cache, model, level.name)
        assert one.width == level.width
        runs = make_runs(one, 21, horizon=2.0)
        results.append(one.simulate(sampled(one, runs, sample_time) if sample_time else runs))
    for result in results[1:]:
        assert result.metrics.tobytes() == results[0].metrics.tobytes()
        assert result.final.tobytes() == results[0].final.tobytes()


@pytest.mark.parametrize("model", ["paper", "joint-exact", "third-order"])
def test_continuous_runs_agree_with_single_ones(root: Path, cache: Path, model: str) -> None:
    one = library(root, cache, model, known_levels()[0].name)
    runs = make_runs(one, 6)
    outcome = one.simulate(designed(one, runs))
    loop = ClosedLoop.load(model)
    for i in range(len(runs.p)):
        p = dict(zip(one.manifest.parameter_names, runs.p[i].tolist(), strict=True))
        run = loop.simulate(parameters=p, x0=runs.x0[i, : one.manifest.nx], tolerance=1e-12)
        metrics, summary = outcome.metrics[i], run.summary
        assert metrics[Column.STATUS] == Status.DONE
        bound = DEFECT * runs.tolerance * metrics[Column.STEPS]  # every step may add what the defect allows
        assert metrics[Column.SWITCHES] == len(run.switches)
        assert metrics[Column.FINAL_SATURATED] == abs(
            run.switches[-1][1] if run.switches else run.initial_mode
        )
        assert metrics[Column.MAX_ABS_V] == pytest.approx(summary["max_abs_v"], rel=bound, abs=bound)
        assert metrics[Column.ISE] == pytest.approx(summary["ise"], rel=bound, abs=bound * summary["horizon"])
        assert metrics[Column.SATURATED_S] == pytest.approx(summary["saturated_s"], abs=bound)
        assert metrics[Column.FINAL_E] == pytest.approx(summary["final_e"], abs=bound)
        np.testing.assert_allclose(outcome.final[i], run.states[-1], rtol=bound, atol=bound)
        # The dense output sees what lies between two output instants, and no less.
        assert metrics[Column.MAX_ABS_E] >= summary["max_abs_e"] - bound
        if summary["settling_s"] is not None and summary["settling_s"] < run.t[-1]:
            assert metrics[Column.SETTLING_S] == pytest.approx(summary["settling_s"], abs=1e-4)


@pytest.mark.parametrize("sample_time", [0.001, 0.03, 1.0])  # the last: some forty steps a hold
def test_sampled_runs_agree_with_single_ones(paper: BatchLibrary, sample_time: float) -> None:
    runs = make_runs(paper, 4, horizon=3.0, divergence=1e9, tolerance=1e-11)
    outcome = paper.simulate(sampled(paper, runs, sample_time))
    loop = ClosedLoop.load("paper")
    for i in range(len(runs.p)):
        p = dict(zip(paper.manifest.parameter_names, runs.p[i].tolist(), strict=True))
        run = loop.simulate(
            parameters=p,
            x0=runs.x0[i, :2],
            tolerance=1e-12,
            horizon=3.0,
            controller="sampled",
            sample_time=sample_time,
            divergence=1e9,
        )
        metrics, summary = outcome.metrics[i], run.summary
        bound = DEFECT * runs.tolerance * metrics[Column.STEPS]
        assert metrics[Column.STATUS] == Status.DONE
        assert metrics[Column.SWITCHES] == len(run.switches)
        assert metrics[Column.FINAL_SATURATED] == abs(
            run.switches[-1][1] if run.switches else run.initial_mode
        )
        assert metrics[Column.SATURATED_S] == pytest.approx(summary["saturated_s"], abs=1e-9)
        assert metrics[Column.ISE] == pytest.approx(summary["ise"], rel=bound)
        assert metrics[Column.MAX_ABS_E] == pytest.approx(run.peaks["e"][0], rel=bound)
        assert metrics[Column.MAX_ABS_V] == pytest.approx(run.peaks["v"][0], rel=bound)
        assert -1e-6 <= metrics[Column.SETTLING_S] - (summary["settling_s"] or 3.0) <= summary["output_step"]
        assert metrics[Column.FINAL_E] == pytest.approx(summary["final_e"], abs=bound)
        np.testing.assert_allclose(outcome.final[i], run.states[-1], rtol=bound, atol=bound)


@pytest.mark.parametrize("model", ["paper", "third-order"])
def test_over_short_holds_single_runs_and_batches_differ_by_rounding_alone(
    root: Path, cache: Path, model: str
) -> None:
    """Both follow the polynomials of one kernel; sines and quotients are rounded otherwise."""
    one = library(root, cache, model, known_levels()[0].name)
    outcome = one.simulate(sampled(one, make_runs(one, 1, horizon=2.0, tolerance=1e-10), 0.001))
    run = ClosedLoop.load(model).simulate(
        horizon=2.0, output_step=2.0, controller="sampled", sample_time=0.001
    )
    operations = one.manifest.function("sample").operations
    size = max(1.0, *(value for value, _ in run.peaks.values()))
    bound = outcome.metrics[0, Column.STEPS] * operations * np.finfo(float).eps * size
    np.testing.assert_allclose(outcome.final[0], run.states[-1], rtol=0, atol=bound)
    assert outcome.metrics[0, Column.MAX_ABS_E] == pytest.approx(run.peaks["e"][0], rel=bound)
    assert outcome.metrics[0, Column.ISE] == pytest.approx(run.ise, rel=bound)
    assert outcome.metrics[0, Column.MAX_ABS_V] == pytest.approx(run.peaks["v"][0], rel=bound)
    assert bound < 1e-6


def test_the_error_shrinks_with_the_tolerance(paper: BatchLibrary) -> None:
    runs = make_runs(paper, 16)
    best = paper.simulate(replace(runs, tolerance=1e-12)).final
    errors = [
        np.max(np.abs(paper.simulate(replace(runs, tolerance=tol)).final - best))
        for tol in (1e-4, 1e-6, 1e-8)
    ]
    assert errors[1] < errors[0] / 10
    assert errors[2] < errors[1] / 10


def test_a_diverging_run_ends_and_leaves_its_neighbours_alone(paper: BatchLibrary) -> None:
    runs = make_runs(paper, 24, divergence=1e4)
    calm = paper.simulate(runs)
    wild = replace(runs, x0=runs.x0.copy())
    wild.x0[::5, 0] = 130.0  # beyond what the actuator can hold
    wild.x0[7, 0] = np.inf
    outcome = paper.simulate(wild)
    lost = np.isin(np.arange(24), [0, 5, 7, 10, 15, 20])
    assert set(outcome.metrics[lost, Column.STATUS].tolist()) == {
        float(Status.DIVERGED),
        float(Status.NON_FINITE),
    }
    assert np.all(outcome.metrics[::5, Column.T_END] < 20.0)
    assert outcome.metrics[~lost].tobytes() == calm.metrics[~lost].tobytes()


def test_a_run_that_overflows_ends_before_it_does_and_leaves_its_neighbours_alone(
    paper: BatchLibrary,
) -> None:
    """A step whose end is not a number fits nowhere."""
    runs = make_runs(paper, 12, divergence=np.inf)
    calm = paper.simulate(runs)
    wild = replace(runs, x0=runs.x0.copy())
    wild.x0[3, 0] = 1e302
    outcome = paper.simulate(wild)
    assert outcome.metrics[3, Column.STATUS] == Status.NON_FINITE
    assert outcome.metrics[3, Column.T_END] < runs.horizon
    assert np.all(np.isfinite(outcome.final[3]))
    others = np.arange(12) != 3
    assert outcome.metrics[others].tobytes() == calm.metrics[others].tobytes()


def test_steps_run_out(paper: BatchLibrary) -> None:
    outcome = paper.simulate(make_runs(paper, 3, max_steps=10))
    assert outcome.metrics[:, Column.STATUS].tolist() == [float(Status.TOO_MANY_STEPS)] * 3
    assert np.all(outcome.metrics[:, Column.T_END] < 20.0)


@pytest.mark.parametrize("sample_time", [0.0, 0.003])
def test_trajectories_are_the_single_run_s(paper: BatchLibrary, sample_time: float) -> None:
    times = np.append(np.arange(100) * 0.02, 2.0)
    runs = make_runs(paper, 3, horizon=2.0, times=times)
    outcome = paper.simulate(sampled(paper, runs, sample_time) if sample_time else runs)
    loop = ClosedLoop.load("paper")
    more = {"controller": "sampled", "sample_time": sample_time} if sample_time else {}
    run = loop.simulate(horizon=2.0, output_step=0.02, tolerance=1e-12, **more)  # type: ignore[arg-type]
    found = outcome.trajectories[0]
    bound = (
        DEFECT
        * runs.tolerance
        * outcome.metrics[0, Column.STEPS]
        * np.maximum(1.0, np.max(np.abs(found), axis=0))
    )
    wanted = np.column_stack([run.states, run["v"], run["e"]])
    assert np.all(np.abs(found - wanted) <= bound)


def test_matrices_are_the_kernels_own(paper: BatchLibrary) -> None:
    p = make_runs(paper, 11).p
    loop = ClosedLoop.load("paper")
    wanted = np.hstack([loop.evaluator.call(name, p)[0] for name in ("filter_matrix", "compensator_matrix")])
    np.testing.assert_array_equal(paper.matrices(p), wanted)


FUNCTIONS = {
    "sin": (np.sin, 2),
    "cos": (np.cos, 2),
    "tan": (np.tan, 4),
    "exp": (np.exp, 2),
    "log": (np.log, 2),
    "tanh": (np.tanh, 3),
    "atan": (np.arctan, 1),
    "sinh": (np.sinh, 3),
    "cosh": (np.cosh, 3),
    "sqrt": (np.sqrt, 0),
}


def test_limits_of_two_channels_a_rounding_apart_are_passed_together(root: Path, cache: Path) -> None:
    one = library(root, cache, "joint-damped", known_levels()[0].name)
    runs = make_runs(one, 3, horizon=0.3)
    limit = one.manifest.parameter_names.index("u_max")
    runs.p[:] = runs.p[0]
    runs.p[:, limit] = np.nextafter(2.8942391573287445, [0.0, 3.0, 2.8942391573287445])
    runs.x0[:] = 0.0
    runs.x0[:, 0] = 0.3
    outcome = one.simulate(designed(one, runs))
    loop = ClosedLoop.load("joint-damped")
    for i in range(len(runs.p)):
        u_max = runs.p[i, limit]
        run = loop.simulate(parameters={"u_max": u_max}, x0=[0.3, 0.0], horizon=0.3, tolerance=1e-12)
        assert outcome.metrics[i, Column.SWITCHES] == len(run.switches)
        np.testing.assert_allclose(outcome.final[i], run.states[-1], rtol=1e-6, atol=1e-6)


def test_elementary_functions_are_right_to_units_in_the_last_place(root: Path, cache: Path) -> None:
    assert COMPILER is not None
    lines = [
        f"void each_{name}(const double *x, double *y, long long n)\n{{\n"
        f"    for (long long i = 0; i < n; ++i) {{ y[i] = pmj_{name}(pmj_all(x[i]))[0]; }}\n}}\n"
        for name in FUNCTIONS
    ]
    header = root / "pmjoint_codegen" / "loops" / "c_batch" / "pmjoint_lanes.h"
    source = '#include "pmjoint_lanes.h"\n' + "\n".join(lines)
    declared = "\n".join(f"void each_{name}(const double *x, double *y, long long n);" for name in FUNCTIONS)
    folder = build({"each.c": source.encode(), header.name: header.read_bytes()}, COMPILER, cache)
    ffi = load_module(to_module(declared))
    lib = ffi.dlopen(str(folder / "kernels.so"))
    generator = np.random.default_rng(0)
    sizes = np.concatenate(
        [generator.uniform(0, 3, 4000), 10.0 ** generator.uniform(-300, 8, 4000), [0.0, 5e-324]]
    )
    x = np.concatenate([sizes, -sizes, [np.nan, np.inf, -np.inf]])
    for name, (exact, ulps) in FUNCTIONS.items():
        y = np.empty_like(x)
        getattr(lib, f"each_{name}")(ffi.from_buffer("double[]", x), ffi.from_buffer("double[]", y), len(x))
        with np.errstate(all="ignore"):
            wanted = exact(x)
            finite = np.isfinite(wanted)
            assert np.array_equal(np.isnan(y), np.isnan(wanted)), name
            assert np.array_equal(y[~finite], wanted[~finite], equal_nan=True), name
            assert np.max(np.abs(y - wanted)[finite] / np.spacing(np.abs(wanted[finite]))) <= ulps, name


def test_levels_follow_the_processor_and_the_variable() -> None:
    names = [level.name for level in known_levels()]
    old = "flags : fpu sse2 ssse3 sse4_1\n"
    middle = "flags : avx avx2 bmi1 bmi2 f16c fma abm movbe sse2\n"
    assert [level.name for level in usable_levels({}, old)] == names[2:]
    assert [level.name for level in usable_levels({}, middle)] == names[1:]
    assert [level.name for level in usable_levels({}, middle + old)] == names[
        2:
    ]  # the weakest processor counts
    assert [level.name for level in usable_levels({"PMJOINT_VECTOR_LEVEL": "baseline"}, middle)] == names[2:]
    with pytest.raises(Exception, match="PMJOINT_VECTOR_LEVEL: is 'fast'; allowed: x86-64-v4"):
        usable_levels({"PMJOINT_VECTOR_LEVEL": "fast"}, old)


FEATURES = {
    "window of the reference at rest": ("0.25*(tanh(50*(t-5)) - tanh(50*(t-7)))", None, [0.0, 0.0]),
    "millisecond of disturbance": ("0", ("0", "9*exp(-((t-3.3)/0.001)**2)"), [0.0, 0.0]),
    "bump over the angle": ("sin(t)", ("0", "3*exp(-10000*(x1-0.5)**2)"), [1.5, 0.0]),
    "friction": ("sin(t)", ("0", "-0.5*tanh(100*x2)"), [1.5, 0.0]),
    "kinks": ("sin(t)", ("0", "0.2*abs(abs(x1)-0.5) - max(0, x2-1) + sign(t-2.0305)"), [1.5, 0.0]),
    "a pulse's threshold": ("0", ("0", "sign(exp(-((t-2)/0.02)**2) - 0.5)"), [0.3, 0.0]),
}


@pytest.mark.parametrize("sample_time", [0.0, 0.01])
@pytest.mark.parametrize("name", FEATURES)
def test_lanes_see_what_is_inside_their_steps(cache: Path, name: str, sample_time: float) -> None:
    """As a single run does, whatever stands in the neighbouring lanes."""
    reference, disturbance, x0 = FEATURES[name]
    one, loop = changed(cache, reference, disturbance)
    start = np.zeros((5, one.manifest.nX))
    start[:, :2] = [x0, [0.2, -0.3], x0, [1.0, 1.0], x0]
    runs = replace(make_runs(one, 5, horizon=6.0), x0=start, p=np.tile(own_values(one), (5, 1)))
    runs = sampled(one, runs, sample_time) if sample_time else runs
    outcome = one.simulate(runs)
    kind = {"controller": "sampled", "sample_time": sample_time} if sample_time else {}
    run = loop.simulate(x0=x0, horizon=6.0, tolerance=1e-11, **kind)  # type: ignore[arg-type]
    scale = 1.0 + max(run.peaks[state.name][0] for state in one.manifest.states)
    assert outcome.metrics[0, Column.STATUS] == Status.DONE
    assert np.max(np.abs(outcome.final[0] - run.states[-1])) <= 2e-7 * scale
    assert outcome.metrics[0, Column.MAX_ABS_V] == pytest.approx(run.peaks["v"][0], rel=1e-6)
    assert outcome.metrics[0, Column.ISE] == pytest.approx(run.ise, rel=1e-5, abs=1e-12)
    for row in (2, 4):
        assert outcome.metrics[row].tobytes() == outcome.metrics[0].tobytes()
        assert outcome.final[row].tobytes() == outcome.final[0].tobytes()


@pytest.mark.parametrize("sample_time", [0.0, 0.01])
def test_a_lane_that_sticks_to_a_kink_ends_with_that_status(cache: Path, sample_time: float) -> None:
    one, _ = changed(cache, "0", ("0", "-0.25*sign(x2)*(1 + sign(x2)*sign(x1 - 500))"))
    runs = make_runs(one, 3, horizon=20.0)
    runs = sampled(one, runs, sample_time) if sample_time else runs
    outcome = one.simulate(runs)
    assert outcome.metrics[1, Column.STATUS] == Status.SLIDING  # the others are kept moving
    assert outcome.metrics[1, Column.T_END] < 20.0


def test_beyond_a_kink_a_lane_s_hold_is_looked_at_anew(cache: Path) -> None:
    """A bump that one side has and the other has not, narrower than a hold, right behind the kink."""
    ise = []
    bump = "30*exp(-((x1-0.002+{})/0.00002)**2)"
    for force in (bump.format("5*(1-sign(x1))"), bump.format("0"), "0"):
        one, _ = changed(cache, "sin(t)", ("0", force))
        start = np.zeros((1, one.manifest.nX))
        start[0, 0] = -0.3
        runs = make_runs(one, 1, horizon=1.0, tolerance=1e-8)
        runs = sampled(one, replace(runs, x0=start, p=own_values(one)[None].copy()), 0.001)
        ise.append(one.simulate(runs).metrics[0, Column.ISE])
    behind, everywhere, nowhere = ise
    met = abs(everywhere - nowhere)
    assert met > 1e-5 * nowhere
    assert abs(behind - everywhere) < 1e-3 * met


@pytest.mark.parametrize("sample_time", [0.0, 0.01])
def test_no_step_of_a_lane_is_longer_than_was_asked(paper: BatchLibrary, sample_time: float) -> None:
    runs = make_runs(paper, 3, horizon=1.0, max_step=1e-3)
    runs = sampled(paper, runs, sample_time) if sample_time else runs
    assert np.all(paper.simulate(runs).metrics[:, Column.STEPS] >= 1000)


def own_values(library: BatchLibrary) -> np.ndarray:
    return np.array([item.value for item in library.manifest.parameters])


def changed(
    cache: Path, reference: str, disturbance: tuple[str, str] | None
) -> tuple[BatchLibrary, ClosedLoop]:
    """The paper's model with another reference and disturbance, over lanes and for single runs."""
    provided = provide(
        "paper",
        reference=reference,
        disturbance=disturbance,
        environment=os.environ,
        notify=lambda line: None,
        lanes=True,
    )
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("the batch loops are compiled")
    sources = batch.batch_sources(provided.folder)
    one = batch.load(sources, provided.manifest, usable_levels(os.environ), compiler, cache)
    return one, ClosedLoop.load(
        "paper", "compiled", reference=reference, disturbance=disturbance, notify=lambda line: None
    )
