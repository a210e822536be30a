"""Functions stay as they are written, in the algebra and in what is emitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from pmjoint_codegen import ClosedLoop
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.shield import multiplied_out, shielded

y, a, b = (real_symbol(name) for name in "yab")

STRIBECK = """\
schema = 1
name   = "stribeck"
title  = "A friction peak far from zero"
source = "a test"
[parameters]
d1    = { value = 0.2,  unit = "1/s^2",       about = "stiffness" }
b0    = { value = 2.0,  unit = "rad/(s^2 V)", about = "input gain" }
yc    = { value = 30.0, unit = "rad",         about = "place of the peak" }
u_max = { value = 10.0, unit = "V",           about = "limit of u" }
[plant]
order = 2
phi   = ["PHI", "0"]
Phi   = [["0"], ["y"]]
theta = ["d1"]
b     = ["b0"]
[actuator]
limit = "u_max"
[design]
c  = [15, 15]
e  = [0.1, 0.1]
ck = [1, 1]
k  = [6, 8]
[simulation]
reference   = "30"
x0          = [30, 0]
horizon     = 5.0
output_step = 0.01
sample_time = 0.001
"""


@pytest.mark.parametrize(
    "part",
    [
        sp.exp(-((y - 30) ** 2)),
        sp.exp(a + y),
        sp.log(a * (y + 1)),
        sp.tanh(2 * (y - 30)),
        (y - 1000) ** 8,
        1 / (1 + y**2),
        sp.sqrt(1 + y**2),
        2**y,
    ],
)
def test_what_is_multiplied_out_keeps_its_functions(part: sp.Expr) -> None:
    found = multiplied_out((a + b) * (part + y) - a * part, (y,))
    assert found == b * part + a * y + b * y
    assert part in sp.preorder_traversal(found)


def test_sums_of_gains_are_multiplied_out_and_may_cancel() -> None:
    assert multiplied_out((a + b) ** 2 - a**2 - 2 * a * b, (y,)) == b**2


def test_any_rearrangement_is_shielded() -> None:
    assert shielded(sp.factor, a * sp.exp(y - 1) + b * sp.exp(y - 1), (y,)) == (a + b) * sp.exp(y - 1)


@pytest.mark.parametrize("place", ["30", "yc"])
@pytest.mark.parametrize("kind", ["compiled", "interpreted"])
def test_a_law_near_a_peak_far_from_zero(tmp_path: Path, place: str, kind: str) -> None:
    """By hand: alpha1 = -(c1 + e1) z1/b0 - phi/b0 and its slope enter v; split, it gave -58.05."""
    path = tmp_path / "stribeck.toml"
    path.write_text(STRIBECK.replace("PHI", f"2*exp(-(y-{place})**2)"))
    loop = ClosedLoop.load(path, kind, notify=lambda line: None)
    v = float(loop.control(np.zeros(8), 29.6, [30.0, 0.0, 0.0]))
    phi, b0 = 2 * np.exp(-(0.4**2)), 2.0
    steep = 0.8 * phi  # phi'(y)
    z1, gain = -0.4, 15.0 + 0.1
    alpha1 = (-gain * z1 - phi) / b0
    slope = (-gain - steep) / b0
    z2 = -alpha1
    expected = -b0 * z1 - 15.0 * z2 - 0.1 * slope**2 * z2 + slope * phi
    # the filters' rates at rest: xi' = k y + phi(y), Xi' = Phi(y)
    expected += -(8 * 29.6) / b0 - 0.2 * 29.6 / b0
    assert v == pytest.approx(expected, rel=1e-12)
    assert v == pytest.approx(-87.381727, abs=5e-7)


def test_a_torque_pulse_reaches_the_joint(tmp_path: Path) -> None:
    """0.02 s wide at 5 s: multiplied out, its exponential is exp(-62500) times infinity."""
    text = (Path(__file__).parents[2] / "models" / "joint-exact.toml").read_text()
    path = tmp_path / "pulsed.toml"
    path.write_text(
        text.replace("joint-exact", "pulsed").replace(
            'disturbance = "0"', 'disturbance = "2*exp(-((t-5)/0.02)**2)"'
        )
    )
    run = ClosedLoop.load(path, notify=lambda line: None).simulate(horizon=6.0, output_step=0.001)
    J = run.settings.parameters["J"]
    np.testing.assert_allclose(run["D2"], 2 * np.exp(-(((run.t - 5) / 0.02) ** 2)) / J, rtol=1e-9, atol=1e-12)
    assert np.max(np.abs(run["D2"])) == pytest.approx(2 / J, rel=1e-9)
