"""Runs whose reference is data: break points, jumps, both loops, and no compilation for new numbers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile import library
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.identity import model_hash
from pmjoint_codegen.loops.hold import hold_matrices
from pmjoint_codegen.simulate.run import Run
from pmjoint_codegen.simulate.sheets import output_panel

pytest.importorskip("sympy")
pytest.importorskip("casadi")

JUMPS: dict[str, Any] = {"steps": [[0.0, 0.2], [0.5, 1.0], [1.2345, -0.5]]}
SMOOTH: dict[str, Any] = {**JUMPS, "filter": 9.0}
CORNERS: dict[str, Any] = {"ramps": [[0.0, 0.2], [0.5, 1.0], [1.2345, -0.5]]}
TABLE: dict[str, Any] = {"table": [[0.1 * k, float(np.sin(0.3 * k))] for k in range(21)]}
ALL = (JUMPS, SMOOTH, CORNERS, TABLE)


@pytest.fixture(scope="module")
def loop(root: Path, cache: Path) -> ClosedLoop:
    if find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    return ClosedLoop.load(root / "models" / "paper.toml", "compiled")


@pytest.fixture(scope="module")
def readable(root: Path, cache: Path) -> ClosedLoop:
    return ClosedLoop.load(root / "models" / "paper.toml", "interpreted")


def everything(run: Run) -> list[Any]:
    return [
        run.states.tobytes(),
        run.signals.tobytes(),
        run["y_cmd"].tobytes(),
        *(run.peaks, run.ise, run.settling_s, run.switches, run.steps, run.initial_mode),
    ]


@pytest.mark.parametrize("reference", ALL)
@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_compiled_and_readable_loops_agree_bit_for_bit(
    loop: ClosedLoop, readable: ClosedLoop, controller: str, reference: dict[str, Any]
) -> None:
    asked: dict[str, Any] = {"horizon": 1.6, "controller": controller, "reference": reference}
    assert everything(loop.simulate(**asked)) == everything(readable.simulate(**asked))


def test_break_points_inside_holds_and_a_kinked_plant_agree_too(root: Path, cache: Path) -> None:
    runs = []
    for kind in ("compiled", "interpreted"):
        one = ClosedLoop.load(
            root / "models" / "paper.toml", kind, disturbance=["0", "0.1*abs(x2)"], notify=lambda line: None
        )
        asked: dict[str, Any] = {"horizon": 1.5, "sample_time": 0.02, "output_step": 0.003}
        runs.append(
            [one.simulate(**asked, controller=which, reference=JUMPS) for which in ("continuous", "sampled")]
        )
    for one, other in zip(*runs, strict=True):
        assert everything(one) == everything(other)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_an_expression_given_as_data_gives_the_same_run(loop: ClosedLoop, controller: str) -> None:
    """A cubic table of a cubic polynomial is that polynomial, on both sides of every row."""
    t = np.linspace(0.0, 2.0, 9)
    own = ClosedLoop.load("paper", "compiled", reference="0.3*t - 0.2*t**2 + 0.1*t**3")
    asked: dict[str, Any] = {"horizon": 2.0, "controller": controller}
    expected, found = (
        own.simulate(**asked),
        loop.simulate(**asked, reference=(t, 0.3 * t - 0.2 * t**2 + 0.1 * t**3)),
    )
    np.testing.assert_allclose(found.states, expected.states, rtol=0, atol=2e-9)
    np.testing.assert_allclose(found["v"], expected["v"], rtol=0, atol=2e-7)
    assert found.ise == pytest.approx(expected.ise, rel=1e-9)


def test_a_step_ends_at_every_break_point(loop: ClosedLoop) -> None:
    """Else the polynomial of one segment would go on into the next: the run is that of two halves."""
    first = loop.simulate(horizon=0.5, reference=JUMPS, x0=[0.3, 0.0], compensator=False)
    whole = loop.simulate(horizon=1.0, reference=JUMPS, x0=[0.3, 0.0], compensator=False)
    np.testing.assert_array_equal(whole.states[:50], first.states[:50])
    rows = whole.t < 0.5
    np.testing.assert_array_equal(whole["y_r"][rows], 0.2)
    np.testing.assert_array_equal(whole["y_r"][~rows], 1.0)
    assert whole.states[50] == pytest.approx(first.states[-1], abs=1e-12)
    assert whole.peaks["e"][0] >= abs(whole["y"][50] - 1.0)


@pytest.mark.parametrize("controller", ["continuous", "sampled"])
def test_e_and_v_begin_anew_at_a_jump(loop: ClosedLoop, controller: str) -> None:
    run = loop.simulate(
        horizon=2.1, controller=controller, reference={"steps": [[0.0, 0.0], [2.0, 5.0]]}, x0=[0.0, 0.0]
    )
    assert run.peaks["e"][1] == 2.0
    assert run.peaks["e"][0] == pytest.approx(5.0 - run["y"][200], abs=1e-12)
    assert run.peaks["v"][1] == 2.0
    assert any(t == 2.0 for t, _ in run.switches)


def test_the_sampled_run_is_a_plain_loop(loop: ClosedLoop) -> None:
    """Samples, law, exact hold and filter in NumPy and SciPy; a step falls between two samples.

    Both integrate the plant to a tolerance, which is all that they differ by: at the usual one of 1e-10, v
    differs by 4e-12.
    """
    T, a, rho = 0.005, SMOOTH["filter"], 2
    made = loop.simulate(
        horizon=1.5,
        output_step=T,
        controller="sampled",
        sample_time=T,
        reference=SMOOTH,
        x0=[0.3, 0.0],
        tolerance=1e-13,
    )
    plain = ClosedLoop.load("paper", "compiled", reference="0")
    kernels, settings = plain.evaluator, plain.simulate(horizon=0.1).settings
    h = hold_matrices(kernels, settings.p, T)
    chain = np.zeros((rho + 2, rho + 2))
    for i in range(rho + 1):
        chain[i, i], chain[i, i - 1 if i else rho + 1] = -a, a
    X, shaped = np.array([0.3, *[0.0] * 9]), np.array([0.2, 0.2, 0.2, 0.2])
    for k in range(300):
        np.testing.assert_allclose(made.states[k], X, rtol=0, atol=1e-12 * max(1.0, np.max(np.abs(X))))
        y_r = shaped[2]
        dy_r = a * (shaped[1] - shaped[2])
        d2y_r = a * (a * (shaped[0] - shaped[1]) - dy_r)
        told = np.array([y_r, dy_r, d2y_r])
        v = float(kernels.call("law", X[:1], X[2:], told, settings.p)[2][0])
        assert made["v"][k] == pytest.approx(v, abs=1e-12 * max(1.0, abs(v)))
        assert made["y_r"][k] == pytest.approx(y_r, abs=1e-13)
        u = np.array([min(max(v, -10.0), 10.0)])
        moved = solve_ivp(
            lambda t, x, u=u: kernels.call("plant", np.array([t]), x, u, settings.p)[0],
            (k * T, (k + 1) * T),
            X[:2],
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
        ).y[:, -1]
        s = kernels.call("sampled_update", X[:1], X[2:], told, u, np.array([v]), h, settings.p)[0]
        X = np.array([*moved, *s])
        now = k * T
        for end in (*(t for t, _ in JUMPS["steps"] if k * T + 1e-9 < t < (k + 1) * T - 1e-9), (k + 1) * T):
            shaped = expm(chain * (end - now)) @ shaped
            shaped[-1] = [y for t, y in JUMPS["steps"] if t <= end + 1e-9][-1]
            now = end


def test_new_numbers_derive_and_compile_nothing(loop: ClosedLoop, monkeypatch: pytest.MonkeyPatch) -> None:
    loop.simulate(horizon=0.1, reference=JUMPS)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("compiled")

    monkeypatch.setattr(library, "build", refuse)
    monkeypatch.setattr("pmjoint_codegen.kernels.compiled.build", refuse)
    monkeypatch.setattr("pmjoint_codegen.emit.pipeline.generate", refuse)
    for number, given in enumerate((SMOOTH, TABLE, np.sin, {"trapezoid": {"high": 1.0, "rise": 0.3}})):
        run = loop.simulate(horizon=0.5, output_step=0.01, reference=given)
        assert run.status == 1, number
    with pytest.raises(AssertionError, match="compiled"):
        ClosedLoop.load("paper", "compiled", reference="cos(3*t)")


def test_a_model_file_with_data(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file lies beside the model; other numbers in it are another run, not another model."""
    text = (root / "models" / "paper.toml").read_text(encoding="utf-8")
    before = next(line for line in text.splitlines() if line.startswith("reference"))
    model, gait = tmp_path / "walk.toml", tmp_path / "gait.csv"
    model.write_text(text.replace(before, 'reference = { file = "gait.csv", column = "knee", unit = "deg" }'))
    gait.write_text("t,hip,knee\n0,1,0\n1,2,30\n2,3,-10\n3,4,0\n")
    first = ClosedLoop.load(model, notify=lambda line: None)
    run = first.simulate(horizon=2.5)
    np.testing.assert_allclose(run["y_r"][[100, 200]], np.radians([30.0, -10.0]), atol=1e-12)
    assert run.summary["reference"]["column"] == "knee"
    gait.write_text("t,hip,knee\n0,1,0\n1,2,60\n2,3,-10\n3,4,0\n")
    second = ClosedLoop.load(model, notify=lambda line: None)
    other = second.simulate(horizon=2.5)
    assert other["y_r"][100] == pytest.approx(np.radians(60.0))
    assert second.manifest.model_hash == first.manifest.model_hash
    assert run.summary["reference"]["sha256"] != other.summary["reference"]["sha256"]
    gait.write_text("t,hip,knee\n0,1,0\n1,2,x\n")
    with pytest.raises(ModelError, match=r"walk.toml: simulation.reference: .*line 3, column knee: 'x'"):
        ClosedLoop.load(model, notify=lambda line: None)


def test_y_cmd_is_what_is_filtered(loop: ClosedLoop, tmp_path: Path) -> None:
    run = loop.simulate(horizon=1.0, reference=SMOOTH)
    np.testing.assert_array_equal(run["y_cmd"], np.where(run.t < 0.5, 0.2, 1.0))
    run.to_csv(tmp_path / "trajectory.csv")
    assert (tmp_path / "trajectory.csv").read_text().startswith("t,y,y_r,y_cmd,e,x1")
    assert run.summary["units"]["y_cmd"] == "rad"
    assert run.summary["reference"]["filter"] == 9.0


def test_runs_in_a_row_begin_with_the_first_segment(loop: ClosedLoop) -> None:
    once = [everything(loop.simulate(horizon=1.5, reference=JUMPS, x0=[x, 0.0])) for x in (0.1, 0.2, 0.1)]
    assert once[0] == once[2] != once[1]


def test_a_long_table_costs_little(loop: ClosedLoop) -> None:
    t = np.linspace(0.0, 10.0, 100_001)
    run = loop.simulate(horizon=10.0, reference={"table": np.column_stack([t, np.sin(t)]), "filter": 50.0})
    assert run.steps >= 100_000
    assert run.wall_s < 5.0
    lag = 3 / 50.0  # of three stages
    np.testing.assert_allclose(run["y_r"][200:], np.sin(run.t[200:] - lag), atol=2e-3)


def test_kernels_of_an_expression_refuse_data(root: Path) -> None:
    from pmjoint_codegen.simulate.settings import make_settings

    with pytest.raises(UsageError, match="these kernels contain an expression of t"):
        make_settings(ClosedLoop.load("paper").manifest, reference=JUMPS)


def test_the_hash_of_a_model_leaves_the_numbers_out() -> None:
    one, other, text = (
        model_hash({"simulation": {"reference": given}}) for given in (JUMPS, TABLE, "sin(t)")
    )
    assert one == other != text


def test_the_unfiltered_command_is_drawn(loop: ClosedLoop) -> None:
    panels = (output_panel(loop.simulate(horizon=0.5, reference=given)) for given in (SMOOTH, JUMPS))
    assert [[line.column for line in panel.lines] for panel in panels] == [
        ["y_cmd", "y_r", "y"],
        ["y_r", "y"],
    ]


def test_a_function_an_array_and_an_expression_are_the_same_reference(loop: ClosedLoop) -> None:
    """The spline through points h apart is off by some h^4: the error grows by 10^4 for ten times h."""
    exact = loop.simulate(reference="sin(t)", horizon=3.0)
    assert exact.reference_text == "sin(t)"
    fine = loop.simulate(reference=np.sin, horizon=3.0)
    t = np.linspace(0.0, 3.0, 31)
    coarse = loop.simulate(reference=(t, np.sin(t)), horizon=3.0)
    near, far = (float(np.max(np.abs(run["y"] - exact["y"]))) for run in (fine, coarse))
    assert near < 1e-8
    assert 1e3 * near < far < 1e5 * near
    with pytest.raises(ModelError, match="reference"):
        loop.simulate(reference="sin(", horizon=1.0)
    with pytest.raises(UsageError, match="reference"):
        loop.simulate(reference=3.0, horizon=1.0)
