"""What the invariants claim: of which models, and that a claim without its premise would fail."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.check.gates import invariants
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import load_subject
from pmjoint_codegen.check.trajectory import ACCURACY, default_run
from pmjoint_codegen.emit.regenerate import regenerate

CLAIM = "z does not depend on u_max"


@pytest.mark.parametrize("name", ["paper", "joint-lag", "third-order"])
def test_a_linear_law_leaves_z_alone(root: Path, name: str) -> None:
    subject = load_subject(root / "models" / f"{name}.toml", os.environ, lambda line: None)
    assert invariants.errors_are_alone(subject.derivation)


def test_z_depends_on_the_limit_through_y_where_a_partial_derivative_moves(
    root: Path, tmp_path: Path
) -> None:
    """Of a third-order nonlinear model: z with another limit differs by more than any rounding."""
    file = tmp_path / "models" / "third-nonlinear.toml"
    file.parent.mkdir()
    shutil.copy(root / "tests" / "reference" / file.name, file)
    regenerate([str(file)])
    subject = load_subject(file, os.environ, lambda line: None)
    assert not invariants.errors_are_alone(subject.derivation)
    quiet = invariants.quiet_evaluator(subject)
    claimed, judged = (
        {name: (figure, bound) for name, figure, bound in invariants.quiet_findings(quiet, bare=bare)}
        for bare in (True, False)
    )
    assert claimed[CLAIM][0] > 1e3 * claimed[CLAIM][1]
    assert CLAIM not in judged and all(figure <= bound for figure, bound in judged.values())


@pytest.mark.parametrize("name", ["joint", "joint-lag"])
def test_the_plant_of_a_joint_s_design_has_no_disturbance(root: Path, name: str) -> None:
    """The joint itself misses the exact estimation error, and its design's plant meets the limits of u."""
    subject = load_subject(root / "models" / f"{name}.toml", os.environ, lambda line: None)
    quiet = invariants.quiet_evaluator(subject)
    run = default_run(quiet)
    assert all(np.all(run[f"D{i}"] == 0.0) for i in range(1, subject.manifest.n + 1))
    assert run.switches and np.abs(invariants.estimation_errors(run)).max() > 0.1
    own = {item.name: item.value for item in subject.manifest.parameters}
    same = {item.name: item.value for item in quiet.manifest.parameters if item.name in own}
    assert {"c1", "e1", "ck1", "k1", "input_scale"} <= same.keys()
    assert all(value == own[gain] for gain, value in same.items())
    result = invariants.check(subject)
    assert result.verdict is Verdict.PASSED
    assert [line.partition(":")[0] for line in result.findings] == [
        "e = z1 + r1",
        "u_max out of reach gives r = 0",
        CLAIM,
        "x - x_hat = exp(A0 t) (x - x_hat)(0)",
    ]
    disturbed = subject.compiled or subject.interpreted
    assert invariants.estimation_gap(disturbed, default_run(disturbed)) > 1e3 * ACCURACY


def test_the_lag_of_an_actuator_is_left_out(root: Path, tmp_path: Path) -> None:
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    file = tmp_path / "models" / "lagging.toml"
    file.parent.mkdir()
    lagging = text.replace('limit = "u_max"', 'limit = "u_max"\nlag = 0.01\ndead_zone = 0.1')
    file.write_text(lagging.replace('"paper"', '"lagging"'), encoding="utf-8")
    regenerate([str(file)])
    subject = load_subject(file, os.environ, lambda line: None)
    quiet = invariants.quiet_evaluator(subject)
    assert set(quiet.manifest.chain) == {"dead_zone"}
    found = {name: (figure, bound) for name, figure, bound in invariants.quiet_findings(quiet)}
    assert all(figure <= bound for figure, bound in found.values())


def test_an_observer_with_a_wrong_guess_has_its_own_estimation_error(root: Path, tmp_path: Path) -> None:
    """An extended-state observer sums no filters; a guess that is put right leaves it no disturbance."""
    text = (root / "tests" / "simulate" / "joint-adrc.toml").read_text(encoding="utf-8")
    text = text.replace("horizon     = 20", "horizon     = 2")
    file = tmp_path / "models" / "joint-adrc.toml"
    file.parent.mkdir()
    file.write_text(f"{text}\n[adaptation]\nguess = {{ b0 = 60.0 }}\n", encoding="utf-8")
    regenerate([str(file)])
    subject = load_subject(file, os.environ, lambda line: None)
    assert invariants.check(subject).verdict is Verdict.PASSED
    quiet = invariants.quiet_evaluator(subject)
    wrong = default_run(quiet, x0=np.array([0.1, 0.0]))
    assert invariants.estimation_gap(quiet, wrong, subject.model) > 1e3 * ACCURACY
