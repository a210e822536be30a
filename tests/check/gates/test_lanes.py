"""The gate over lanes: every width passes, nothing is judged without a compiler, bad code fails."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from pmjoint_codegen.check.gates import lanes
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.kernels.processor import VARIABLE, usable_levels


def of(paper: Subject, environment: Mapping[str, str], folder: Path | None = None) -> Subject:
    """The paper's model, freshly looked at, in another environment or with other files."""
    subject = load_subject(paper.file, environment, lambda _line: None)
    return replace(subject, folder=folder or subject.folder)


@pytest.mark.parametrize("level", [level.name for level in usable_levels({})])
def test_every_width_does_the_arithmetic_of_the_tape(paper: Subject, level: str) -> None:
    result = lanes.check(of(paper, {**os.environ, VARIABLE: level}))
    assert (result.verdict, result.figure, result.bound) == (Verdict.PASSED, 0, 0)


@pytest.mark.usefixtures("no_ziglang")
def test_without_a_compiler_nothing_is_judged(paper: Subject, tmp_path: Path) -> None:
    result = lanes.check(of(paper, {"PATH": str(tmp_path)}))
    assert result.verdict is Verdict.NOT_RUN and "compiler" in result.detail


def test_a_wrong_inverse_fails_and_its_place_is_named(paper: Subject, tmp_path: Path) -> None:
    folder = shutil.copytree(paper.folder, tmp_path / "paper")
    text = (folder / "lanes.c").read_text()
    assert "= 1.0 / " in text
    (folder / "lanes.c").write_text(text.replace("= 1.0 / ", "= 1.5 / "))
    result = lanes.check(of(paper, os.environ, folder))
    assert result.verdict is Verdict.FAILED and result.difference is not None
    assert result.difference.kernel.endswith("_lanes")
