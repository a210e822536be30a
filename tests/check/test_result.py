"""What may pass: figures that are numbers, within their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmjoint_codegen.check.gates import guards, proof
from pmjoint_codegen.check.result import GateResult, Verdict, passed
from pmjoint_codegen.check.subject import Subject


@pytest.mark.parametrize(
    ("figure", "bound"), [(math.nan, 1.0), (math.nan, None), (0.5, math.nan), (1.5, 1.0), (math.inf, 1.0)]
)
def test_nothing_passes_on_what_is_not_within_its_bound(figure: float, bound: float | None) -> None:
    result = passed("largest error", figure, bound)
    assert result.verdict is Verdict.FAILED
    assert "largest error" in result.detail and str(figure) in result.detail
    with pytest.raises(ValueError, match="cannot pass"):
        GateResult(Verdict.PASSED, figure, bound, "made by hand")


@pytest.mark.parametrize(("figure", "bound"), [(1.0, 1.0), (0.0, 0.0), (7.0, None), (None, None)])
def test_what_is_within_its_bound_passes(figure: float | None, bound: float | None) -> None:
    assert passed("largest error", figure, bound).verdict is Verdict.PASSED


@pytest.mark.parametrize("value", [8e30, 8e300])
def test_the_proof_fails_where_its_constants_leave_floating_point(paper: Subject, value: float) -> None:
    values = {**proof.design_values(paper.derivation), "k2": value}
    result = proof.prove_for(paper.derivation, values)
    assert result.verdict is Verdict.FAILED
    assert "not a finite number" in result.detail


def test_a_guard_is_not_passed_by_a_swing_that_is_no_number(
    paper: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guards, "_swings", lambda *_: np.array([math.nan]))
    assert guards.check(paper).verdict is Verdict.FAILED
