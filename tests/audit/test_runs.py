"""The runs behind the claims: brackets by bisection, and the certificate that calls a run lost."""

from __future__ import annotations

import pytest

from pmjoint_codegen.audit.runs import ExperimentRunner, bracket, diverges, go, limit
from pmjoint_codegen.closed_loop import ClosedLoop


@pytest.fixture(scope="module")
def loop(cache: object) -> ClosedLoop:
    """Return the paper's loop with y_r = 0 and no disturbance."""
    return ExperimentRunner().at_rest(disturbed=False)


def test_a_lost_run_never_returns(loop: ClosedLoop) -> None:
    bound = limit(loop, 0.0)
    assert bound == pytest.approx(100.0, rel=1e-15)
    done = go(loop, 71.0, 60.0)
    passed = abs(done["x1"] + done["x2"] / 0.2**0.5) > bound
    assert diverges(done, bound)
    assert passed[passed.argmax() :].all()
    assert not diverges(go(loop, 69.0, 60.0), bound)


def test_each_halving_halves(loop: ClosedLoop) -> None:
    widths = [
        found.diverging - found.bounded for found in (bracket(loop, 60.0, 80.0, n, 100.0) for n in (0, 1, 3))
    ]
    assert widths == [20.0, 10.0, 2.5]


@pytest.mark.parametrize("ends", [(10.0, 20.0), (75.0, 80.0)])
def test_a_bracket_needs_both_fates(loop: ClosedLoop, ends: tuple[float, float]) -> None:
    with pytest.raises(ArithmeticError, match="either side"):
        bracket(loop, *ends, 1, 100.0)
