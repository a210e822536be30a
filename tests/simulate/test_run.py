"""A run as a record: columns, summary, files, and how failures show."""

from __future__ import annotations

import csv
import io
import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.errors import SimulationError, UsageError
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.logs import text as csv_text
from pmjoint_codegen.loops.status import Status, sentence
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.simulate.summary import saturated_time

COLUMNS = "t,y,y_r,e,x1,x2,xi1,xi2,Xi11,Xi21,lambda1,lambda2,r1,r2,z1,z2,alpha1,v,u,x_hat1,x_hat2,D1,D2"
KEYS = {
    *("model", "model_hash", "parameters", "controller", "evaluator", "status", "message", "steps", "wall_s"),
    *("saturation_switches", "saturated_s", "max_abs_v", "ise", "max_abs_e", "settling_s", "final_e"),
}


@pytest.fixture(scope="module")
def short(compiled_paper: Evaluator) -> Run:
    return run(compiled_paper, make_settings(compiled_paper.manifest, horizon=0.5))


def test_columns_are_views_by_name(short: Run) -> None:
    assert short.columns[0] == "t"
    assert set(COLUMNS.split(",")) == set(short.columns)
    for name in short.columns:
        assert short[name].shape == (51,)
        assert short[name].base is not None
    np.testing.assert_array_equal(short["y"], short["x1"])
    with pytest.raises(KeyError, match="x_hat1"):
        short["x9"]


@pytest.mark.parametrize("block", [1, 50, 51, 4096])
def test_the_csv_keeps_every_double_and_the_agreed_columns(
    short: Run, tmp_path: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_text, "_BLOCK", block)
    path = tmp_path / "trajectory.csv"
    short.to_csv(path)
    text = path.read_text()
    assert text.endswith("\n")
    assert text.splitlines()[0] == COLUMNS
    rows = list(csv.reader(io.StringIO(text)))[1:]
    for index, name in enumerate(COLUMNS.split(",")):
        assert [float(row[index]) for row in rows] == short[name].tolist()
    with pytest.raises(UsageError):
        short.to_csv(path / "below-a-file.csv")


def test_the_summary_is_json_with_the_agreed_keys(short: Run) -> None:
    summary = json.loads(json.dumps(short.summary, allow_nan=False))
    assert set(summary) >= KEYS
    assert summary["parameters"]["c1"] == 15.0
    assert summary["saturation_switches"] == [[t, mode] for t, mode in short.switches]
    assert summary["final_e"] == short["e"][-1]
    assert summary["wall_s"] > 0.0


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_settling_is_the_last_time_outside_two_percent(paper: Evaluator, controller: str) -> None:
    settings = make_settings(
        paper.manifest, horizon=9.0, output_step=1e-3, controller=controller, sample_time=0.01
    )
    found = run(paper, settings)
    outside = np.flatnonzero(np.abs(found["e"]) > 0.02 * abs(found["e"][0]))
    assert found.settling_s is not None
    assert found.t[outside[-1]] <= found.settling_s <= found.t[outside[-1] + 1]
    on_target = run(paper, replace(settings, x0=np.zeros(2), horizon=0.1))
    assert on_target.settling_s is None  # no band: e(0) = 0


def test_saturated_time_counts_what_lies_behind_the_last_row(short: Run) -> None:
    """A run that ends between two rows has switches later than its last row."""
    leaves, enters = (t for t, _ in short.switches[:2])
    assert saturated_time(short) == pytest.approx(leaves + short.switches[2][0] - enters)
    ended = replace(short, t=short.t[:1], switches=short.switches[:2])
    assert saturated_time(ended) == leaves


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_diverging_run_keeps_its_trajectory_and_says_why(paper: Evaluator, controller: str) -> None:
    settings = make_settings(
        paper.manifest,
        x0=[105.0, 0.0],
        horizon=40.0,
        controller=controller,
        sample_time=0.01,
        output_step=0.5,
    )
    found = run(paper, replace(settings, divergence=1e4))
    assert found.status == Status.DIVERGED
    assert "10000" in found.message
    assert 2 < len(found.t) < settings.rows
    assert np.all(np.isfinite(found.states))
    assert found.summary["status"] == "diverged"
    assert found.settling_s is None and found.summary["settling_s"] is None
    # Beyond 100 no |u| <= 10 holds the joint: x1 grows by exp(sqrt(d1) t) and faster than any bound allows.
    assert found.peaks["x1"][0] > 105.0


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_numbers_beyond_floating_point_end_the_run_not_in_silence(paper: Evaluator, controller: str) -> None:
    found = run(paper, make_settings(paper.manifest, parameters={"b0": 1e-300}, controller=controller))
    assert found.status == Status.NON_FINITE
    assert found.t.tolist() == [0.0]
    assert "finite" in found.message
    assert json.loads(json.dumps(found.summary, allow_nan=False))["max_abs_v"] is None


def test_every_status_has_a_sentence() -> None:
    lines = {sentence(status, t=1.0, divergence=1e9, max_steps=5, max_switches=6) for status in Status}
    assert len(lines) == len(Status)


def test_a_run_survives_the_way_between_processes(short: Run) -> None:
    error = pickle.loads(pickle.dumps(SimulationError("ended", run=short)))
    np.testing.assert_array_equal(error.run["x1"], short["x1"])


def test_columns_cannot_change_the_run() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.1)
    for column in ("t", "x1", "v"):
        with pytest.raises(ValueError, match="read-only"):
            run[column][0] = 7.0
