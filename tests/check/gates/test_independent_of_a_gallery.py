"""heyoka's runs of real systems: poles, high gains, dampers at rest, an event that it meets without end."""

from __future__ import annotations

import os
import re
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen.check.gates import independent
from pmjoint_codegen.check.inputs.drawn import draws
from pmjoint_codegen.check.oracles import heyoka_loop
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.cli.main import run as pmjoint
from pmjoint_codegen.simulate.settings import make_settings

ENDLESS = 44  # of the drawn runs of the ship


@pytest.fixture(scope="module")
def heyoka() -> Any:
    """The module, where it is installed."""
    return pytest.importorskip("heyoka")


def subject_of(root: Path, folder: Path, name: str) -> Subject:
    """A system of the gallery, with files generated in a folder."""
    (folder / "models").mkdir()
    file = folder / "models" / f"{name}.toml"
    file.write_bytes((root / "models" / "gallery" / f"{name}.toml").read_bytes())
    assert pmjoint(["regenerate", str(file)]) == 0
    return load_subject(file, os.environ, lambda _line: None)


@pytest.mark.usefixtures("heyoka")
@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("maglev", 10),  # the force has a pole at a gap of 0, just outside the range
        ("emps", 10),  # gains of 200 leave more rounding in v than 1e-13
        ("three-element-pam", 10),  # at a limit it comes to rest on the kink of its damper
    ],
)
def test_drawn_runs_of_real_systems_agree(name: str, least: int, root: Path, tmp_path: Path) -> None:
    subject = subject_of(root, tmp_path, name)
    if subject.compiler is None:
        pytest.skip("no C compiler")
    result = independent.check(subject)
    assert result.verdict is Verdict.PASSED, result.detail
    compared = re.search(r"(\d+) drawn runs with", result.detail)
    assert compared is not None and int(compared[1]) >= least


def test_an_event_that_heyoka_meets_without_end_is_passed_in_shorter_steps(
    heyoka: Any, root: Path, tmp_path: Path
) -> None:
    """In steps of 0.04 s it meets v at a limit again and again, at one instant, and keeps each in memory."""
    subject = subject_of(root, tmp_path, "mariner")
    loop = heyoka_loop.Loop(heyoka, subject, make_settings(subject.manifest).parameters)
    settings = independent.drawn_settings(subject, next(islice(draws(subject.manifest), ENDLESS, None)))
    assert np.all(np.isfinite(independent.reference(loop, subject, settings).values))
