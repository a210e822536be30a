"""docs/howto/put-the-controller-on-your-bench.md: its code, its rig against SciPy, a second in real time."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen import ClosedLoop

HOWTO = Path(__file__).resolve().parents[2] / "docs" / "howto"
PAGE = (HOWTO / "put-the-controller-on-your-bench.md").read_text(encoding="utf-8")
NUMBER = r"(\d+(?:\.\d+)?)"
PRINTED = (
    rf"samples        {NUMBER} of 5 ms\n"
    rf"late by        {NUMBER}, {NUMBER}, {NUMBER} us \(median, 99 %, largest\)\n"
    rf"step took      {NUMBER}, {NUMBER}, {NUMBER} us \(median, 99 %, largest\)\n"
    rf"missed         {NUMBER} samples, late by more than 5 ms\n"
    rf"\|y - y_r\|      {NUMBER} rad first, {NUMBER} last\n"
    rf"second half    {NUMBER} rad rms, {NUMBER} largest\n"
)


def script(name: str) -> ModuleType:
    spec = spec_from_file_location(name, HOWTO / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_code_of_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    for text in re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE):
        exec(compile(text, "howto", "exec"), names)
    assert capsys.readouterr().out.count("[") == 2
    assert np.asarray(names["controller"].s[0]) == pytest.approx(0.3)  # type: ignore[attr-defined]


def test_the_rig_moves_as_its_equation_says() -> None:
    rig_module = script("rig")
    rig = rig_module.Rig(0.3)
    for k, u in enumerate((4.0, -20.0, 7.0)):
        rig.command(u, 0.1 * k)
        mean = rig.read(0.1 * (k + 1))[1]
        before = (0.0, 4.0, -10.0)[k]
        held = max(min(u, 10.0), -10.0)
        assert mean == pytest.approx((0.002 * before + 0.098 * held) / 0.1, rel=1e-12)

    def rates(t: float, x: list[float], u: float) -> list[float]:
        return [x[1], 0.25 * x[0] + 1.9 * u + 0.1 * math.sin(x[1]) * math.cos(t)]

    x = np.array([0.3, 0.0])
    pieces = [(0.002, 0.0), (0.102, 4.0), (0.202, -10.0), (0.3, 7.0)]
    for (begin, _), (end, u) in zip([(0.0, 0.0), *pieces], pieces, strict=False):
        x = solve_ivp(rates, (begin, end), x, "DOP853", args=(u,), rtol=1e-12, atol=1e-14).y[:, -1]
    assert rig.x == pytest.approx(x, abs=1e-10)


@pytest.mark.parametrize("told", [True, False])
def test_the_rig_follows_the_reference_in_a_time_of_its_own(told: bool) -> None:
    """Without a clock, so the machine's load does not matter: the error falls to a tenth, and stays there."""
    T, rig_module = 0.005, script("rig")
    rig = rig_module.Rig(0.3)
    controller = ClosedLoop.load("paper").controller(
        sample_time=T, parameters=script("bench").GAINS, start="matched"
    )
    errors = []
    for k in range(800):
        y, applied = rig.read(k * T)
        u = controller.step(y, u_applied=applied if told else None)
        rig.command(u, k * T)
        errors.append(abs(y - math.sin(k * T)))
    assert errors[0] > 0.299
    assert max(errors[400:]) < 0.1 * errors[0]


def test_a_second_in_real_time() -> None:
    command = [sys.executable, str(HOWTO / "bench.py"), "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    found = re.fullmatch(PRINTED, done.stdout)
    assert found, done.stdout
    samples, median, most, largest, *_, missed, first, last, _, _ = map(float, found.groups())
    assert samples == 200 and median <= most <= largest
    assert (missed > 0) == (largest > 5000)
    if missed == 0:  # on a machine that has no time, nothing follows from the tracking
        assert last < first
