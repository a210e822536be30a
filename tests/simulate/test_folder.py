"""A run read from its folder is the run that was written."""

from __future__ import annotations

import pickle
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop, Run, compare, open_run
from pmjoint_codegen.simulate.against import Log
from pmjoint_codegen.simulate.folder import Origin, read_folder, write_run
from pmjoint_codegen.simulate.record import Record
from pmjoint_codegen.simulate.summary import summarise


def same(first: Run, second: Run) -> None:
    for field in fields(Record):
        if field.name not in ("manifest", "settings"):
            one, other = getattr(first, field.name), getattr(second, field.name)
            assert np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other, field.name
    assert first.columns == second.columns
    assert all(np.array_equal(first[name], second[name]) for name in first.columns)
    assert np.array_equal(first.settings.p, second.settings.p)
    assert np.array_equal(first.settings.x0, second.settings.x0)
    assert summarise(first) == second.summary


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_a_joints_run_comes_back_bit_for_bit(controller: str, tmp_path: Path) -> None:
    run = ClosedLoop.load("joint").simulate(horizon=0.2, controller=controller, parameters={"J_plant": 0.05})
    write_run(run, tmp_path, Origin())
    found = read_folder(tmp_path)
    same(run, found.run)
    assert found.detail is None and found.log is None
    same(pickle.loads(pickle.dumps(found.run)), found.run)


def test_a_reference_of_data_and_a_log_come_back(tmp_path: Path) -> None:
    loop = ClosedLoop.load("paper", reference={"steps": [[0, 0], [0.1, 0.3]], "filter": 20})
    run = loop.simulate(horizon=0.3)
    log = Log("l.csv", "0" * 64, np.array([0.0, 0.1]), {"y": np.array([1.5, 0.1 + 0.2])}, {"y": "angle"})
    write_run(run, tmp_path, Origin("pmjoint simulate x", "x", ("a note",)), log=log)
    found = read_folder(tmp_path)
    same(run, found.run)
    assert found.run["y_cmd"].any()
    assert found.log is not None
    assert np.array_equal(found.log.columns["y"], log.columns["y"])
    assert (found.log.file, found.log.names) == ("l.csv", {"y": "angle"})
    assert found.origin == Origin("pmjoint simulate x", "x", ("a note",))


def test_a_run_is_drawn_from_its_folder_and_compared(tmp_path: Path) -> None:
    run = ClosedLoop.load("paper").simulate(horizon=0.3)
    write_run(run, tmp_path, Origin())
    opened = open_run(tmp_path)
    comparison = compare(run, opened)
    assert not comparison.settings
    assert all(gap.size == 0.0 for gaps in comparison.signals.values() for gap in gaps)
    assert repr(comparison) == "<Comparison of 2 runs: run 1; run 2>"
    assert len(opened.plot(signals="y+y_r,e").axes) == 2
