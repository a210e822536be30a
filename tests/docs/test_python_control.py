"""docs/howto/analyse-the-loop-with-python-control.md: its code runs, and its margin is the loop's."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop

pytest.importorskip("control")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "analyse-the-loop-with-python-control.md"


def test_the_code_of_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    import control

    names: dict[str, Any] = {}
    for text in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.M):
        exec(compile(text, "howto", "exec"), names)
    said = r"phase margin \d+ deg at \d+ rad/s\ndelay margin [\d.]+ ms\n"
    assert re.fullmatch(said, capsys.readouterr().out)
    L, margins, frequency = names["L"], names["margins"], names["frequency"]
    _, phase, _, crossover = control.margin(L)
    assert (margins.phase_margin, frequency) == pytest.approx((phase, crossover), rel=1e-6)
    assert L(1j * frequency) * np.exp(-1j * frequency * margins.delay_margin) == pytest.approx(-1.0, rel=1e-6)
    assert control.feedback(L, 1).poles().real.max() < 0.0

    run = ClosedLoop.load("joint").simulate(horizon=2.0, output_step=0.005)
    faster = ClosedLoop.load("joint").simulate(horizon=2.0, output_step=0.005, parameters={"c1": 20.0})
    difference = np.max(np.abs(faster["y"] - run["y"]))
    assert np.max(np.abs(names["response"].outputs[0] - run["y"])) < 0.05 * difference
    assert np.max(np.abs(names["faster"].outputs[0] - faster["y"])) < 0.05 * difference
    assert np.max(np.abs(names["lagged"].outputs[0] - run["y"])) > 0.05 * difference
