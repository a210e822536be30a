"""The systems of python-control: responses against runs, linearisations by matrices, margins by poles."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.errors import MissingToolError, UsageError
from pmjoint_codegen.systems import ControlSystems, reference_names

Array = npt.NDArray[np.float64]
control = pytest.importorskip("control")

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")


@cache
def loaded(model: str) -> ClosedLoop:
    return ClosedLoop.load(model)


def driven(systems: ControlSystems, rho: int) -> Any:
    """The loop with a source of the model's own reference in place of sampled inputs."""
    names = reference_names(rho)
    source = control.nlsys(
        None, lambda t, x, u, params: systems.reference(t)[:, 0], inputs=0, outputs=names, name="source"
    )
    return control.interconnect([source, systems.loop], inputs=[], outputs=["y", "u", "v"])


def response(system: Any, times: Array, X0: Array, tolerance: float, **params: float) -> Any:
    return control.input_output_response(
        system,
        times,
        np.zeros((0, len(times))),
        X0,
        params=params,
        solve_ivp_method="DOP853",
        solve_ivp_kwargs={"rtol": tolerance, "atol": tolerance},
    )


@pytest.mark.parametrize("model", MODELS)
def test_the_loop_s_response_is_the_simulated_run(model: str) -> None:
    """With the solver's tolerance its difference from a run falls: nothing else is left of it."""
    loop = loaded(model)
    systems, run = loop.to_control(), loop.simulate(horizon=0.3, output_step=0.01)
    whole = driven(systems, loop.manifest.rho)
    scale = np.maximum(1.0, np.abs(run.states).max(axis=0))
    differences = []
    for tolerance in (1e-5, 1e-9):
        found = response(whole, run.t, systems.X0, tolerance)
        differences.append(float(np.max(np.abs(found.states.T - run.states) / scale)))
    assert differences[1] < max(1e-2 * differences[0], 1e-8)
    y, u, v = found.outputs
    assert y.tobytes() == found.states[0].tobytes()
    assert v == pytest.approx(loop.control(found.states.T, y, systems.reference(run.t).T), rel=1e-15)
    assert u.tobytes() == np.clip(v, *loop.manifest.limits(run.settings.parameters)).tobytes()


def test_parameters_at_a_call_are_those_of_a_run() -> None:
    loop = loaded("joint")
    systems = loop.to_control(parameters={"c1": 9.0}, x0=[0.2, 0.0], start="matched")
    changed = {"c2": 9.0, "J": 0.05}
    run = loop.simulate(
        horizon=0.2, parameters={"c1": 9.0, **changed}, x0=[0.2, 0.0], start="matched", output_step=0.02
    )
    whole = driven(systems, 2)
    found = response(whole, run.t, run.states[0], 1e-9, **changed)
    assert found.outputs[0] == pytest.approx(run["y"], abs=1e-7)
    plain = response(whole, run.t, run.states[0], 1e-9)
    assert np.max(np.abs(plain.outputs[0] - run["y"])) > 1e-4
    with pytest.raises(UsageError, match="no parameter 'c9'"):
        response(whole, run.t, systems.X0, 1e-9, c9=1.0)


def test_signals_have_names() -> None:
    systems = loaded("third-order").to_control()
    assert systems.plant.input_labels == ["u"] and systems.plant.output_labels == ["y"]
    assert systems.controller.input_labels == ["y", "y_r", "dy_r", "d2y_r"]
    assert systems.controller.output_labels == ["u", "v"]
    assert systems.loop.state_labels == [item.name for item in loaded("third-order").manifest.states]
    assert reference_names(1) == ["y_r", "dy_r"]


def test_the_plant_s_linearisation_is_its_matrices() -> None:
    """x1' = x2, x2' = d1 x1 + b0 u + 0.1 sin(x2) cos(t), at t = 0 and x = 0."""
    linear = loaded("paper").to_control().plant.linearize([0.0, 0.0], [0.0])
    assert pytest.approx(np.array([[0.0, 1.0], [0.2, 0.1]]), abs=1e-6) == linear.A
    assert pytest.approx(np.array([[0.0], [2.0]]), abs=1e-6) == linear.B


@pytest.mark.parametrize("model", ["paper", "joint-lag"])  # whose margins are lower and upper
def test_the_margins_of_the_open_loop_are_where_the_closed_one_oscillates(model: str) -> None:
    """The gain margin multiplies L: then a pole of the closed loop lies on the imaginary axis."""
    loop = loaded(model)
    systems = loop.to_control()
    commands = [0.0] * (loop.manifest.rho + 1)
    point = control.find_operating_point(systems.loop, np.zeros(loop.manifest.nX), commands)
    x, s = np.split(np.asarray(point.states), [loop.manifest.nx])
    u = systems.controller.output(0.0, s, [x[0], *commands])[0]
    P = systems.plant.linearize(x, [u])
    C = systems.controller.linearize(s, [x[0], *commands])[0, 0]
    L = -C * P
    gain, phase, at_gain, at_phase = control.margin(L)
    whole = systems.loop.linearize(point.states, commands)
    for omega in (1.0, 10.0, 100.0):  # 1 + L is the quotient of the characteristic polynomials
        closed, *parts = (np.linalg.det(1j * omega * np.eye(len(A)) - A) for A in (whole.A, P.A, C.A))
        assert 1.0 + L(1j * omega) == pytest.approx(closed / np.prod(parts), rel=1e-4)
    assert max(whole.poles().real) < 0.0
    assert 0.0 < gain < np.inf and 0.0 < phase < 180.0
    marginal = control.feedback(gain * L, 1).poles()
    assert np.min(np.abs(marginal - 1j * at_gain)) < 1e-3 * max(1.0, at_gain)
    assert L(1j * at_phase) * np.exp(-1j * np.radians(phase)) == pytest.approx(-1.0, rel=1e-6)


def test_the_plant_limits_u_and_the_controller_adds_the_dead_zone(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "models" / "paper.toml").read_text(encoding="utf-8")
    valve = 'limit = "u_max"\ndead_zone = 0.5\nrate = 1e3'
    file = tmp_path / "zone.toml"
    file.write_text(text.replace('limit = "u_max"', valve), encoding="utf-8")
    loop = ClosedLoop.load(file)
    said: list[str] = []
    systems = loop.to_control(notify=said.append)
    assert said == ["paper: a continuous loop leaves out rate"] and systems.left_out == ("rate",)
    run = loop.simulate(controller="continuous", horizon=0.2, output_step=0.01)
    found = response(driven(systems, 2), run.t, systems.X0, 1e-9)
    assert found.outputs[1] == pytest.approx(run["u_command"], abs=1e-4)
    assert found.outputs[0] == pytest.approx(run["y"], abs=1e-7)
    at = systems.plant.dynamics(0.0, [0.0, 0.0], [1e3])
    assert list(at) == [0.0, 2.0 * 9.5]
    assert list(loaded("paper").to_control().plant.dynamics(0.0, [0.0, 0.0], [1e3])) == [0.0, 2.0 * 10.0]


def test_the_reference_may_be_data() -> None:
    loop = loaded("paper")
    data = {"steps": [[0, 0], [0.1, 0.4]], "filter": 20}
    run = loop.simulate(horizon=0.3, output_step=0.01, reference=data)
    systems = ClosedLoop.load("paper", reference=data).to_control()
    assert systems.reference(run.t)[0].tobytes() == np.ascontiguousarray(run["y_r"]).tobytes()


def test_without_python_control_one_line_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingToolError, match=r"^python-control .*pip install 'pmjoint-codegen\[control\]'"):
        loaded("paper").to_control()
