"""Margins: against matrices written by hand and delays in simulated time; and what is refused."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.margins import equilibrium, jacobian, margins_of
from pmjoint_codegen.systems import ControlSystems

Array = npt.NDArray[np.float64]
control = pytest.importorskip("control")
MODELS = Path(__file__).parents[1] / "models"


@cache
def systems_of(model: str) -> ControlSystems:
    return ClosedLoop.load(model).to_control()


def changed(folder: Path, old: str, new: str) -> ControlSystems:
    """The systems of the paper's example with other text in its model."""
    text = (MODELS / "paper.toml").read_text(encoding="utf-8")
    assert old in text
    file = folder / "changed.toml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    return ClosedLoop.load(file).to_control(notify=lambda line: None)


def by_hand(c1: float, c2: float, d1: float, t: float) -> tuple[Array, Array, Array]:
    """A, B, C of the paper's example cut at u, from (11), (14), (23) to (29) on paper; y_r = 0.

    Each row is a linear function of x1, x2, xi1, xi2, Xi1, Xi2, lambda1, lambda2, r1, r2.
    """
    b0, e1, e2, ck1, ck2, k1, k2 = 2.0, 0.1, 0.1, 1.0, 1.0, 6.0, 8.0
    x1, x2, p1, p2, q1, q2, l1, l2, r1, r2 = np.eye(10)
    y_rate = b0 * l2 + p2 + d1 * q2
    z1 = x1 - r1
    alpha = (-(c1 + e1) * z1 - (p2 + d1 * q2) - ck1 * r1) / b0
    z2 = l2 - alpha - r2 / b0
    s2 = -(c1 + e1) / b0
    p2_rate, q2_rate, r1_rate = k2 * (x1 - p1), x1 - k2 * q1, r2 - ck1 * r1
    alpha_rate = s2 * y_rate + ((c1 + e1 - ck1) * r1_rate - p2_rate - d1 * q2_rate) / b0
    v = k2 * l1 + alpha_rate - ck2 * r2 / b0 - (c2 + e2 * s2**2) * z2 - b0 * z1
    A = np.array(
        [
            x2,
            d1 * x1 + 0.1 * np.cos(t) * x2,  # (37), with t frozen
            p2 + k1 * (x1 - p1),
            p2_rate,
            q2 - k1 * q1,
            q2_rate,
            l2 - k1 * l1,
            v - k2 * l1,  # the controller's own command: inside the limits it is v
            r1_rate,
            -ck2 * r2,
        ]
    )
    B = np.zeros((10, 1))
    B[1] = b0
    return A, B, -v[np.newaxis]


def read_off(A: Array, B: Array, C: Array) -> tuple[float, float, float, float]:
    """Phase margin (deg), delay margin (s), gain crossover (rad/s), lower gain margin, from a grid."""

    def at(omega: Any) -> Any:
        s = 1j * np.atleast_1d(omega)[:, np.newaxis, np.newaxis]
        return (C @ np.linalg.solve(s * np.eye(len(A)) - A, np.broadcast_to(B, (len(s), *B.shape))))[:, 0, 0]

    grid = np.geomspace(1e-2, 1e4, 3001)
    inside = np.abs(at(grid)) - 1.0
    (place,) = np.flatnonzero(np.diff(np.sign(inside)))
    crossover = float(
        brentq(lambda w: abs(at(w)[0]) - 1.0, grid[place], grid[place + 1], xtol=1e-13, rtol=1e-14)
    )
    phase = np.angle(-at(crossover)[0])
    assert not np.any(np.diff(np.sign(at(grid).imag)))  # real at 0 only
    return np.degrees(phase), phase / crossover, crossover, 1.0 / abs(at(0.0)[0])


@pytest.mark.parametrize(
    ("c1", "c2", "d1", "t"), [(15.0, 15.0, 0.2, 0.0), (4.0, 9.0, 3.0, 2.0), (15.0, 30.0, 0.2, 1.5)]
)
def test_the_paper_s_margins_are_those_of_matrices_written_by_hand(
    c1: float, c2: float, d1: float, t: float
) -> None:
    params = {"c1": c1, "c2": c2, "d1": d1}
    systems = systems_of("paper")
    A, B, C = by_hand(c1, c2, d1, t)
    made = systems.open_loop(t, y_r=0.0, params=params)
    size = np.max(np.abs(A))
    assert np.max(np.abs(made.A - A)) < 1e-8 * size and np.max(np.abs(made.C - C)) < 1e-8 * size
    assert pytest.approx(B, abs=1e-8) == made.B
    found = systems.margins(t, y_r=0.0, params=params)
    (crossover,) = found.gain_crossovers
    read = (found.phase_margin, found.delay_margin, crossover, found.lower_gain_margin)
    assert read == pytest.approx(read_off(A, B, C), rel=1e-6)
    assert found.phase_crossovers == (0.0,) and found.gain_margin == np.inf


def swing(L: Any, delay: float, horizon: float) -> float:
    """How much the delayed loop's late swing exceeds an earlier one: u between samples is a line."""
    count = 50
    h = delay / count
    n = len(L.A)
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n : n + 1], whole[n, n + 1] = L.A, L.B, 1.0 / h
    step = expm(h * whole)
    z, steps = np.eye(n)[0], int(horizon / h)
    told, y = np.zeros(count + steps + 1), np.empty(steps)
    for k in range(steps):
        told[count + k] = -(L.C @ z)[0]
        y[k] = z[0]
        z = step[:n, :n] @ z + step[:n, n] * told[k] + step[:n, n + 1] * (told[k + 1] - told[k])
    half = steps // 2
    return float(np.max(np.abs(y[-half // 2 :])) / np.max(np.abs(y[half // 2 : half])))


@pytest.mark.parametrize("model", ["paper", "joint-lag", "third-order"])
def test_a_delay_below_the_margin_decays_and_one_above_it_grows(model: str) -> None:
    systems = systems_of(model)
    found, L = systems.margins(y_r=0.1), systems.open_loop(y_r=0.1)
    horizon = 120.0 / found.gain_crossovers[0]
    assert swing(L, 0.96 * found.delay_margin, horizon) < 0.7
    assert swing(L, 1.04 * found.delay_margin, horizon) > 1.4


def test_the_gain_margins_are_where_a_pole_reaches_the_axis() -> None:
    for model, upper in (("paper", False), ("joint-lag", True)):
        systems = systems_of(model)
        found, L = systems.margins(y_r=0.1), systems.open_loop(y_r=0.1)
        factor = found.gain_margin if upper else found.lower_gain_margin
        rightmost = [max(control.feedback(f * factor * L, 1).poles().real) for f in (0.99, 1.01)]
        assert sorted(np.sign(rightmost)) == [-1.0, 1.0]
        assert (rightmost[0] < 0.0) == upper


def test_several_crossings_are_all_found() -> None:
    """Two resonances: the delay margin belongs to the fastest crossing, by poles of a Pade delay."""
    s = control.tf("s")
    L = control.ss(0.5 / s * (1.0 + 0.4 * s**2 / (s**2 + 0.02 * s + 4.0) + 0.9 * s / (s**2 + 0.02 * s + 25)))
    found = margins_of(L.A, L.B, L.C, np.zeros(1), 0.0, 0.0)
    grid = np.geomspace(1e-2, 1e2, 400_001)
    gains = np.abs(control.ss2tf(L)(1j * grid)) - 1.0
    places = np.flatnonzero(np.diff(np.sign(gains)))
    assert len(places) > 2
    assert found.gain_crossovers == pytest.approx(grid[places], rel=1e-4)
    for factor, stable in ((0.97, True), (1.03, False)):
        late = control.tf(*control.pade(factor * found.delay_margin, 8))
        assert (max(control.feedback(L * late, 1).poles().real) < 0.0) == stable


def test_the_point_is_the_equilibrium_of_the_loop_and_the_reference_the_model_s() -> None:
    systems = systems_of("joint")
    found = systems.margins(0.4)
    assert found.y_r == systems.reference(0.4)[0, 0] != 0.0
    assert systems.plant.dynamics(0.4, found.x, [found.u]) == pytest.approx([0.0, 0.0], abs=1e-7)
    assert found.u != 0.0
    held = systems.margins(0.4, y_r=found.y_r)
    assert held == found
    assert systems.margins(0.4, params={"c1": 25.0}).delay_margin != found.delay_margin


def test_limits_are_inactive_at_the_point_or_it_is_refused() -> None:
    """x1 = y_r needs u = -d1 y_r/b0, whose limit is 10."""
    systems = systems_of("paper")
    inside = systems.margins(y_r=99.9)
    assert inside.u == pytest.approx(-9.99) and inside.x == pytest.approx((99.9, 0.0))
    assert inside.delay_margin == pytest.approx(systems.margins(y_r=0.0).delay_margin, rel=1e-6)
    with pytest.raises(UsageError, match=r"^margins: the equilibrium needs u = -10.01, .*limits; ask for"):
        systems.open_loop(y_r=100.1)


def test_a_dead_zone_has_margins_beside_its_jump(tmp_path: Path) -> None:
    systems = changed(tmp_path, 'limit = "u_max"', 'limit = "u_max"\ndead_zone = 0.5')
    found, plain = systems.margins(y_r=10.0), systems_of("paper").margins(y_r=10.0)
    assert found.u == pytest.approx(plain.u - 0.5)
    assert found.delay_margin == pytest.approx(plain.delay_margin, rel=1e-6)
    with pytest.raises(UsageError, match=r"^margins: the loop has a kink or a jump"):
        systems.margins(y_r=0.0)


@pytest.mark.parametrize("kink", [np.sign, np.abs])
def test_a_kink_at_the_point_is_refused(kink: Any) -> None:
    def function(z: Array) -> Array:
        return np.array([z[1], 2.0 * z[0] + kink(z[1])])

    assert jacobian(function, np.ones(2))[0] == pytest.approx([0.0, 1.0])
    with pytest.raises(UsageError, match=r"^margins: the loop has a kink or a jump"):
        jacobian(function, np.zeros(2))


def test_a_loop_without_equilibrium_is_refused() -> None:
    assert equilibrium(lambda z: z**2 + z - 2.0, np.zeros(1)) == pytest.approx([1.0])
    for function in (lambda z: 1.0 + 1e4 * z**2 - z, lambda z: 0.0 * z + 1.0):
        with pytest.raises(UsageError, match=r"^margins: the loop has no equilibrium .*; ask for a y_r"):
            equilibrium(function, np.zeros(1))


def test_an_unstable_loop_has_no_margins() -> None:
    A, B, C = by_hand(15.0, 15.0, 0.2, 0.0)
    with pytest.raises(UsageError, match=r"^margins: the closed loop is unstable"):
        margins_of(A, B, 0.01 * C, np.zeros(2), 0.0, 0.0)


def test_a_loop_has_its_margins_without_python_control(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = systems_of("joint").margins(0.4, params={"c1": 25.0})
    monkeypatch.setitem(sys.modules, "control", None)  # an import of it fails
    assert ClosedLoop.load("joint").margins(0.4, parameters={"c1": 25.0}) == expected
