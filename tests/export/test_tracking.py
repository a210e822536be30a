"""The bound on what single precision does to tracking, against the single-precision C in the loop."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.cli.main import run
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.tracking import SAMPLES, Loop, plant_of, tracking_of
from pmjoint_codegen.export.tree import DOUBLE, FLOAT

SMALL = 0.05  # of |y|: a bound beyond it would say nothing


@pytest.mark.parametrize("name", ["paper", "joint-lag", "chain"])
def test_the_c_in_single_precision_stays_within_the_bound(
    name: str, exports: Callable[..., Export], cache: Path
) -> None:
    compiler = find_compiler(os.environ)
    if compiler is None:
        pytest.skip("no C compiler")
    export = exports(name, "float")
    program, plant = export.program, plant_of(export.program)
    T = program.derivation.model.simulation.sample_time
    exact = Loop.of(program, plant, SAMPLES, T).Z
    loaded, x, found = Exported.load(export, compiler, cache), plant.rest, []
    for k in range(SAMPLES):
        if k == 0:
            loaded.init(float(x[0]), plant.y_r(0.0))
        else:
            x = plant.hold(x, float(loaded.output.u), T)
        assert loaded.step(float(x[0]), plant.y_r(k * T)) == 0
        found.append(x[0])
    measured = float(np.max(np.abs(np.array(found) - exact[:, 0])))
    cost = tracking_of(program, FLOAT)
    assert cost.largest == np.max(np.abs(exact[:, 0]))
    assert 0.0 < measured <= cost.y <= SMALL * cost.largest


def test_double_precision_costs_what_its_roundoff_is_smaller(exports: Callable[..., Export]) -> None:
    program = exports("paper").program
    ratio = tracking_of(program, FLOAT).y / tracking_of(program, DOUBLE).y
    assert 1.0 < ratio / (FLOAT.roundoff / DOUBLE.roundoff) < 10.0  # single rounds parameters and inputs too


def test_the_command_prints_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["export", "paper", "--target", "c", "--precision", "float", "--out", str(tmp_path)]
    assert run([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert 0.0 < record["y_error_bound"] < 0.01 * record["y_largest"]
    assert run(words) == 0
    assert "float moves y in closed loop by at most" in capsys.readouterr().out
