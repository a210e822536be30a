"""What the invariants claim: of which models, and that a claim without its premise would fail."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from pmjoint_codegen.check.gates import invariants
from pmjoint_codegen.check.subject import load_subject
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
