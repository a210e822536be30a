"""The gate of the certificate: what it says where there is no run to judge."""

from __future__ import annotations

import pytest

from pmjoint_codegen.check.gates import certificate
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings


def short(evaluator: Evaluator) -> Run:
    """A run that ends before its second row."""
    return run(evaluator, make_settings(evaluator.manifest, divergence=1.6, controller="continuous"))


def test_a_run_that_ended_early_proves_nothing(paper: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate, "default_run", short)
    found = certificate.check(paper)
    assert found.verdict is Verdict.FAILED
    assert found.detail.startswith("the run ended early: diverged")
