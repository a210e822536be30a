"""What a run says of D and the pressures, against the physics of the joint computed here once more."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.cli.summary_table import summary_table
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.simulate.disturbance import Pressure, disturbance_norm, mismatched, pressures
from pmjoint_codegen.simulate.figures import draw
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.sheets import caption, sheets


@pytest.fixture(scope="module")
def joint() -> ClosedLoop:
    """Return the joint whose design keeps neither damping nor the quadratic gain."""
    return ClosedLoop.load("joint")


@pytest.fixture(scope="module")
def clipped(joint: ClosedLoop) -> Run:
    """Return a run that commands more than the supply and less than nothing."""
    return joint.simulate(horizon=0.5, x0=[0.5, 0.0], parameters={"u_max": 8.0})


def acceleration(run: Run) -> Array:
    """Angular acceleration of (1)-(3) with the pressures clipped, typed once more."""
    p = run.settings.parameters
    theta, speed = run["x1"], run["x2"]  # keep = []: x2 is the speed
    base = p["k0"] * p["u0"]
    P1 = np.clip(base + p["k_u"] * run["u"], 0.0, p["P_max"])
    P2 = np.clip(base - p["k_u"] * run["u"], 0.0, p["P_max"])

    def force(P: Array, eps: Array) -> Array:
        return P * (p["C1"] * eps**2 + p["C2"] * eps + p["C3"]) + p["C4"]

    stretch = p["r"] * theta / p["l0"]
    torque = p["r"] * (force(P1, p["eps0"] + stretch) - force(P2, p["eps0"] - stretch))
    total: Array = (torque - p["b_v"] * speed) / p["J"]
    return total


@pytest.mark.parametrize("limit", [5.0, 8.0])
def test_disturbance_is_what_the_design_leaves_out(joint: ClosedLoop, limit: float) -> None:
    """D2 = theta'' - d1 theta - b0 u with (8), corrected."""
    run = joint.simulate(horizon=0.5, x0=[0.5, 0.0], parameters={"u_max": limit})
    p = run.settings.parameters
    d1 = 2 * p["k0"] * p["u0"] * p["r"] ** 2 * (2 * p["C1"] * p["eps0"] + p["C2"]) / (p["l0"] * p["J"])
    muscle = p["C1"] * p["eps0"] ** 2 + p["C2"] * p["eps0"] + p["C3"]
    b0 = 2 * p["k_u"] * p["r"] * muscle / p["J"]
    expected = acceleration(run) - d1 * run["x1"] - b0 * run["u"]
    scale = np.max(np.abs(b0 * run["u"])) + np.max(np.abs(d1 * run["x1"]))
    np.testing.assert_allclose(run["D2"], expected, rtol=0, atol=40 * np.finfo(float).eps * scale)
    assert run.summary["disturbance_max"] == pytest.approx(np.max(np.abs(expected)), rel=1e-12)
    assert run.summary["disturbance_max_components"]["D1"] == 0.0


def test_a_design_that_keeps_all_leaves_nothing() -> None:
    run = ClosedLoop.load("joint-exact").simulate(horizon=2.0)
    # D is the difference of terms of the size of d1 x1 and b0 u; what remains is their rounding
    assert run.summary["disturbance_max"] <= 1e3 * np.finfo(float).eps * 127 * np.max(np.abs(run["x1"]))


def test_norm_is_over_components() -> None:
    run = ClosedLoop.load("joint-lag").simulate(horizon=2.0)
    expected = np.sqrt(run["D1"] ** 2 + run["D2"] ** 2 + run["D3"] ** 2)
    np.testing.assert_allclose(disturbance_norm(run), expected, rtol=1e-15)
    assert np.max(expected) > 0
    assert run.summary["disturbance_max"] is None  # rad/s^2 and rad/s^3 do not add up
    ends = run.summary["disturbance_range"]
    assert ends["D3"] == [run["D3"].min(), run["D3"].max()]
    assert f"D3 = {ends['D3'][0]:.6g} to {ends['D3'][1]:.6g} rad/s^3" in summary_table(run, (), ())
    assert "max |D|" not in summary_table(run, (), ())


def test_mismatch_and_neglected_physics_have_their_own_words() -> None:
    loop = ClosedLoop.load("joint-damped")
    assert "rad/s^2 at the output instants: neglected physics\n" in summary_table(
        loop.simulate(horizon=1.0), (), ()
    )
    wrong = summary_table(loop.simulate(horizon=1.0, parameters={"J_plant": 0.06}), (), ())
    assert "rad/s at the output instants: neglected physics, and model mismatch (J_plant)\n" in wrong


def test_declared_bound_stands_beside_what_was_found() -> None:
    run = ClosedLoop.load("paper").simulate(horizon=3.0)
    assert run.summary["disturbance_bound"] == 0.1
    assert run.summary["disturbance_max"] == np.max(np.abs(run["D2"])) <= 0.1
    assert run.summary["pressures"] is None
    table = summary_table(run, (), ())
    assert "unknown to the controller; D_max = 0.1" in table
    assert "exceeded" not in table


def test_an_exceeded_bound_is_said() -> None:
    loop = ClosedLoop.load("paper", disturbance=["0", "0.3*cos(t)"])
    run = loop.simulate(horizon=1.0)
    assert "0.3 at the output instants: unknown to the controller; D_max = 0.1 is exceeded" in summary_table(
        run, (), ()
    )


def test_clipped_pressures_are_said_plainly(clipped: Run) -> None:
    first, second = pressures(clipped)["P1"], pressures(clipped)["P2"]
    assert (first.least, second.greatest) == (0.0, 5e5)
    assert first.wanted_least == pytest.approx(2.5e5 - 8 * 5e4)
    assert first.clipped and second.clipped
    table = summary_table(clipped, (), ())
    assert "P1 is clipped: -1.5 to" in table
    assert "rad/s^2 at the output instants: neglected physics" in table
    assert json.loads(json.dumps(clipped.summary, allow_nan=False))["pressures"]["P1"]["clipped"] is True


def test_touching_a_limit_is_not_clipping(joint: ClosedLoop) -> None:
    """With u_max = P_0/k_u, saturation empties a muscle and no more."""
    run = joint.simulate(horizon=0.5, x0=[0.5, 0.0])
    assert run.summary["saturated_s"] > 0
    assert run.summary["pressures"]["P1"]["min"] == 0.0
    assert not pressures(run)["P1"].clipped
    assert "clipped" not in summary_table(run, (), ())


def test_rounding_beside_a_limit_is_not_clipping() -> None:
    assert not Pressure(0.0, 5e5, -1e-11, 5e5 + 1e-10, 5e5).clipped
    assert Pressure(0.0, 5e5, -1e-3, 5e5, 5e5).clipped
    assert Pressure(0.0, 5e5, 0.0, 5e5 + 1e-3, 5e5).clipped


def test_commands_are_those_that_the_true_valve_makes_of_u(joint: ClosedLoop) -> None:
    """Where nothing is clipped, a muscle has what was commanded: P_0 +- k_u u in the plant's numbers."""
    run = joint.simulate(horizon=1.0, parameters={"k_u_plant": 6e4, "u0_plant": 2.6})
    p = run.settings.parameters
    for item in pressures(run).values():
        assert not item.clipped
        rounding = 4 * np.finfo(float).eps * item.limit
        assert item.least == pytest.approx(item.wanted_least, rel=0, abs=rounding)
        assert item.greatest == pytest.approx(item.wanted_greatest, rel=0, abs=rounding)
    assert run["P1"] == pytest.approx(p["k0"] * 2.6 + 6e4 * run["u"], rel=1e-14)


def test_a_pressure_that_reaches_its_limit_is_no_switch_of_u(joint: ClosedLoop) -> None:
    run = joint.simulate(horizon=4.0, parameters={"P_max": 2.7e5, "u_max": 1.0})
    assert pressures(run)["P1"].clipped
    labels = [run.initial_mode, *(label for _, label in run.switches)]
    assert all(before != after for before, after in pairwise(labels))


def test_joints_have_a_sheet_of_pressures(clipped: Run) -> None:
    sheet = sheets(clipped)[-1]
    assert sheet.stem == "figure7_pressures"
    assert "($P_1$ and $P_2$ clipped)" in caption(clipped, sheet, ())
    muscles, left_out = sheet.panels
    assert muscles.marks == (0.0, 5.0)
    np.testing.assert_array_equal(muscles.lines[0].values(clipped), clipped["P1"] / 1e5)
    np.testing.assert_array_equal(left_out.lines[0].values(clipped), clipped["D2"])  # with its sign
    assert left_out.label == "$D_2$ (rad/s$^{2}$)"
    assert len(draw(clipped, sheet).axes) in (2, 4)


@pytest.mark.parametrize(
    ("disturbance", "cause"),
    [
        (["0", "0"], "model mismatch (d1)"),
        (["0", "0.1*sin(x2)*cos(t)"], "the model's disturbance, and model mismatch (d1)"),
    ],
)
def test_a_guess_that_is_never_corrected_is_a_mismatch(
    disturbance: list[str], cause: str, root: Path, tmp_path: Path
) -> None:
    file = tmp_path / "guessed.toml"
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8").replace('"paper"', '"guessed"')
    text = text.replace("disturbance_bound", "# disturbance_bound")
    file.write_text(
        text.replace("[design]", "[adaptation]\nguess = { d1 = -0.5, b0 = 2.0 }\n\n[design]"),
        encoding="utf-8",
    )
    loop = ClosedLoop.load(file, disturbance=disturbance)
    run = loop.simulate(horizon=1.0)
    assert mismatched(run) == ("d1",)
    assert f"at the output instants: {cause}\n" in f"{summary_table(run, (), ())}\n"
    known = loop.simulate(horizon=1.0, parameters={"d1_guess": 0.2})
    assert mismatched(known) == () and "mismatch" not in summary_table(known, (), ())
    assert mismatched(loop.simulate(horizon=1.0, parameters={"b0": 3.0})) == ("b0", "d1")
