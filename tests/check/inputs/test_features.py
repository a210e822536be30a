"""Points where a model's functions are of order one, and what gates see there alone."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen.check.gates import derivatives, guards, interpreter, symbolic
from pmjoint_codegen.check.inputs.points import batches
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.emit.regenerate import regenerate
from pmjoint_derive import backstepping

KIND = "functions of order one"
PEAK = "2*exp(-(y-30)**2)"


def silent(_line: str) -> None:
    """Take no notice."""


def model(root: Path, folder: Path, phi: str, disturbance: str = "0", parameter: str = "") -> Subject:
    """The paper's model with another phi_1 and disturbance, generated in a folder of its own."""
    lines = {
        "phi ": f'phi = ["{phi}", "0"]',
        "disturbance ": f'disturbance = ["0", "{disturbance}"]',
        "[parameters]": f"[parameters]\n{parameter}",
    }
    text = (root / "models" / "paper.toml").read_text()
    changed = [next((new for old, new in lines.items() if x.startswith(old)), x) for x in text.splitlines()]
    (folder / "models").mkdir()
    file = folder / "models" / "paper.toml"
    file.write_text("\n".join(changed))
    regenerate([str(file)])
    return load_subject(file, os.environ, silent)


def drawn(subject: Subject, name: str) -> dict[str, np.ndarray]:
    """The points of one kernel that features bring, by label."""
    function = subject.manifest.function(name)
    found = batches(subject.interpreted, function, 20, 1, extreme=False, features=subject.features)
    (batch,) = [batch for batch in found if batch.kind == KIND]
    return dict(zip((label for label, _ in function.inputs), batch.arguments, strict=True))


def test_points_are_drawn_on_the_flanks_of_a_peak_wherever_its_parameter_puts_it(
    root: Path, tmp_path: Path
) -> None:
    place = 'yc = { value = 30.0, unit = "rad", about = "place" }'
    subject = model(root, tmp_path, "2*exp(-(y-yc)**2)", "exp(-((t-0.3)/0.001)**2)", place)
    at = drawn(subject, "law")
    distance = np.abs(at["y"][:, 0] - at["p"][:, 0])
    assert np.ptp(at["p"][:, 0]) > 5
    assert (distance < 0.9).sum() >= 5  # the others are about the peak of the plant's own yc
    pulse = drawn(subject, "disturbance")
    assert (np.abs(pulse["t"][:, 0] - 0.3) < 0.002).sum() >= 5


def test_kernels_without_functions_get_no_such_points(paper: Subject) -> None:
    for function in paper.manifest.functions:
        assert paper.features.count(function) == 0
        found = batches(paper.interpreted, function, 2, 1, extreme=False, features=paper.features)
        assert KIND not in [batch.kind for batch in found]


def split(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Subject:
    """The same model, its law multiplied out by SymPy: exp(-900) exp(60 y) exp(-y**2), which is 0 or nan."""
    monkeypatch.setattr(backstepping, "multiplied_out", lambda value, _moving: sp.expand(value))
    monkeypatch.setattr(backstepping, "shielded", lambda transform, value, _moving: transform(value))
    file = folder / "models" / "paper.toml"
    regenerate([str(file)])
    return load_subject(file, os.environ, silent)


def test_the_gate_sees_a_split_exponential(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = model(root, tmp_path, PEAK)
    for gate in (interpreter, symbolic, guards, derivatives):
        found = gate.check(sound)
        assert found.verdict is Verdict.PASSED, found
    wrong = split(tmp_path, monkeypatch)
    assert "exp(-900)" in str(wrong.derivation.expanded("v"))
    found = symbolic.check(wrong)
    assert found.verdict is Verdict.FAILED
    assert found.difference is not None and found.difference.kernel in ("law", "partials")
