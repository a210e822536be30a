"""Identities of joints with torque, friction and disturbance: Lyapunov rate, disturbance, holds and start."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pmjoint_codegen.check.gates import proof
from pmjoint_codegen.check.result import Verdict
from pmjoint_codegen.check.subject import load_subject
from tests.simulate.joints import COULOMB, GRAVITY, SHAKEN, write_joint

KEPT = {
    "nothing": ((), False),
    "torque": (("torque",), False),
    "torque and gain": (("damping", "torque", "gain"), False),
    "torque and lag": (("damping", "torque", "pressure_lag"), True),
    "torque, lag left out": (("torque",), True),
}


@pytest.mark.parametrize("case", KEPT)
def test_every_identity_holds(case: str, tmp_path: Path, cache: Path) -> None:
    keep, lagged = KEPT[case]
    path = write_joint(tmp_path, keep, lagged=lagged, torque=GRAVITY, friction=COULOMB, disturbance=SHAKEN)
    result = proof.check(load_subject(path, os.environ, lambda _line: None))
    assert result.verdict is Verdict.PASSED, (result.detail, result.difference)
    assert result.figure == 0
