"""The controller that steps: a loop closed by hand, and what its callers may do to it."""

from __future__ import annotations

import copy
import math
import pickle
import threading
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import DOP853

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.controller import ControllerState
from pmjoint_codegen.errors import SimulationError, UsageError
from tests.sampled_runs import T, loaded, sampled

Array = npt.NDArray[np.float64]


@pytest.fixture(params=["compiled", "interpreted"])
def evaluator(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_reference_given_at_each_step_is_the_same_as_the_models(evaluator: str) -> None:
    loop = loaded("paper", evaluator)
    own, told = loop.controller(sample_time=T), loop.controller(sample_time=T)
    for k in range(40):
        y_r = loop.evaluator.call("reference", [k * T], own.settings.p)[0]
        assert own.step(0.3) == told.step(0.3, y_r)
        assert own.v == told.v


@pytest.mark.parametrize("given_", [0.5, 1, np.float32(0.5), np.array(0.5), (0.5, 0, 0), [0.5, 0.0, 0.0]])
def test_a_number_is_a_constant_reference(given_: Any, evaluator: str) -> None:
    loop = loaded("paper", evaluator)
    first, second = loop.controller(), loop.controller()
    constant = [float(np.ravel(given_)[0]), 0.0, 0.0]
    assert [first.step(0.3, given_) for _ in range(3)] == [
        second.step(0.3, np.array(constant)) for _ in range(3)
    ]


def test_a_loop_closed_by_hand_is_the_simulated_one() -> None:
    """The plant by an integrator of its own, DOP853, so not only the recorded numbers are followed."""
    loop = loaded("joint")
    controller = loop.controller(sample_time=0.01)
    run = sampled(loop, sample_time=0.01, horizon=0.5)
    x = np.array([run["x1"][0], run["x2"][0]])
    p = controller.settings.p
    limits = loop.evaluator.call("actuation", p)[0].reshape(-1, 4)
    plant = loop.evaluator.kernel("plant")
    worst = 0.0
    for k in range(50):
        worst = max(worst, abs(x[0] - run["y"][k]))
        controller.step(float(x[0]))
        w = np.clip(limits[:, 0] + limits[:, 1] * controller.v, limits[:, 2], limits[:, 3])
        solver = DOP853(
            lambda t, state, w=w: plant(np.array([t]), state, w, p)[0],
            k * 0.01,
            x,
            (k + 1) * 0.01,
            rtol=1e-12,
            atol=1e-14,
        )
        while solver.status == "running":
            solver.step()
        x = solver.y
    assert worst < 1e-9


def test_the_u_that_acted_enters_the_filters(evaluator: str) -> None:
    """Against (14) and (23) as exact holds by SciPy's matrix exponential, from the matrices' definitions."""
    from scipy.linalg import expm

    loop = loaded("paper", evaluator)
    controller = loop.controller(sample_time=T)
    values = controller.settings.parameters
    k1, k2, ck1, ck2, b0 = (values[name] for name in ("k1", "k2", "ck1", "ck2", "b0"))

    def hold(A: Array, B: Array, x: Array) -> Array:
        n = len(x)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n] = A, B
        found: Array = (expm(whole * T) @ [*x, 1.0])[:n]
        return found

    controller.step(0.4)
    for k, applied in enumerate((3.0, -11.5, None, 0.25, controller.v)):
        before, v, sent = controller.s, controller.v, controller.u
        u = sent if applied is None else applied
        controller.step(0.4 - 0.01 * k, u_applied=applied)
        A0, Ar = np.array([[-k1, 1.0], [-k2, 0.0]]), np.array([[-ck1, 1.0], [0.0, -ck2]])
        lam, r = before[4:6], before[6:8]
        assert controller.s[4:6] == pytest.approx(hold(A0, np.array([0.0, u]), lam), rel=1e-12, abs=1e-15)
        assert controller.s[6:8] == pytest.approx(
            hold(Ar, np.array([0.0, b0 * (u - v)]), r), rel=1e-12, abs=1e-15
        )


def test_u_applied_is_ignored_the_first_time_and_none_means_what_step_returned(
    bench: Callable[[str], ClosedLoop], evaluator: str
) -> None:
    for loop in (loaded("paper", evaluator), bench(evaluator)):
        plain, told = loop.controller(), loop.controller()
        sent = math.nan
        for k in range(30):
            y = 0.4 + 0.1 * math.sin(k)
            sent = told.step(y, u_applied=sent)
            assert plain.step(y) == sent
            assert plain.state == told.state


def test_a_state_can_be_kept_and_gone_back_to(bench: Callable[[str], ClosedLoop], evaluator: str) -> None:
    for loop in (loaded("joint-lag", evaluator), bench(evaluator)):
        controller = loop.controller()
        begin = controller.state
        readings = [0.2 + 0.01 * math.cos(k) for k in range(160)]
        whole = [controller.step(y) for y in readings]
        controller.state = begin
        assert [controller.step(y) for y in readings[:80]] == whole[:80]
        kept = ControllerState(**asdict(controller.state))
        v, z, x_hat = controller.v, controller.z, controller.x_hat
        assert [controller.step(y) for y in readings[80:]] == whole[80:]
        for other in (loop.controller(), copy.deepcopy(controller)):
            other.state = kept
            assert (other.v, *other.z, *other.x_hat) == (v, *z, *x_hat)
            assert [other.step(y) for y in readings[80:]] == whole[80:]
        controller.reset()
        assert [controller.step(y) for y in readings[:20]] == whole[:20]
        assert controller.state.sample == 20


def test_a_copy_goes_on_by_itself(evaluator: str) -> None:
    controller = loaded("paper", evaluator).controller(sample_time=0.005, parameters={"c1": 9.0})
    controller.step(0.3)
    for other in (copy.copy(controller), pickle.loads(pickle.dumps(controller))):
        assert other.state == controller.state
        before = controller.state
        assert other.step(0.2) != controller.v
        assert controller.state == before and other.sample == 2
        assert other.settings.parameters["c1"] == 9.0


def test_a_state_of_another_model_or_clock_is_refused() -> None:
    controller = loaded("paper").controller()
    state = controller.state
    for other in (
        replace(state, model="joint"),
        replace(state, sample_time=0.1),
        replace(state, values=(1.0,)),
    ):
        with pytest.raises(UsageError, match=r"^state: belongs to "):
            controller.state = other
    with pytest.raises(UsageError, match=r"^state: is 3; allowed: a ControllerState"):
        controller.state = 3  # type: ignore[assignment]


def test_reset_matches_the_state_to_a_reading_and_a_reference(evaluator: str) -> None:
    """xi_1 = y, xi_2 = 0, Xi = 0, lambda = 0, since phi = 0 and Phi_1 = 0; z(0) = 0."""
    loop = loaded("paper", evaluator)
    controller = loop.controller(start="matched")
    controller.reset(0.7, (0.2, 0.5, -0.1))
    assert controller.s[:6] == pytest.approx([0.7, 0.0, 0.0, -0.0, 0.0, 0.0], abs=1e-15)
    controller.step(0.7, (0.2, 0.5, -0.1))
    assert controller.z == pytest.approx([0.0, 0.0], abs=1e-14)
    assert controller.x_hat[0] == 0.7
    first = loop.controller(start="matched")  # without reset: from the first reading
    first.step(0.7, (0.2, 0.5, -0.1))
    assert first.state == controller.state
    controller.reset(0.7)
    assert controller.step(0.7) == loop.controller(start="matched").step(0.7)
    zero = loop.controller()
    zero.reset(0.7, 0.2)
    assert not np.any(zero.s)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "x", None, [1.0, 2.0]])
def test_what_is_no_finite_number_is_refused_by_name_and_nothing_changes(bad: Any, evaluator: str) -> None:
    controller = loaded("paper", evaluator).controller()
    controller.step(0.3)
    before, v = controller.state, controller.v
    attempts: list[tuple[str, Callable[[], float]]] = [("y", lambda: controller.step(bad))]
    if bad is not None:
        attempts += [
            ("u_applied", lambda: controller.step(0.3, u_applied=bad)),
            ("y_r", lambda: controller.step(0.3, bad)),
        ]
    for name, attempt in attempts:
        with pytest.raises(UsageError, match=rf"^{name}: is .*; allowed: "):
            attempt()
        assert controller.state == before and controller.v == v
    again = loaded("paper", evaluator).controller()
    again.step(0.3)
    assert controller.step(0.2) == again.step(0.2)
    with pytest.raises(UsageError, match=r"^y0: is "):
        controller.reset(bad if bad is not None else math.nan)
    with pytest.raises(UsageError, match=r"^y_r: is given without y0"):
        controller.reset(y_r=0.1)


def test_numbers_beyond_all_doubles_end_in_an_error_and_the_state_before(evaluator: str) -> None:
    controller = loaded("paper", evaluator).controller()
    controller.step(0.3)
    before = controller.state
    with pytest.raises(SimulationError, match=r"^paper: v or the controller's state is no finite number"):
        controller.step(1e308)
    assert controller.state == before
    controller.step(0.3)


def test_a_step_has_to_come_first() -> None:
    controller = loaded("paper").controller()
    for name in ("v", "u", "z", "x_hat"):
        with pytest.raises(UsageError, match=f"^{name}: has no value before the first step"):
            getattr(controller, name)
    assert controller.sample == 0 and controller.sample_time == 0.001


def test_settings_are_those_of_a_run() -> None:
    with pytest.raises(UsageError, match=r"no parameter 'c9'"):
        loaded("paper").controller(parameters={"c9": 1.0})
    with pytest.raises(UsageError, match=r"^sample time: is 0 s"):
        loaded("paper").controller(sample_time=0.0)
    with pytest.raises(UsageError, match=r"^start: is 'warm'"):
        loaded("paper").controller(start="warm")


def test_two_controllers_in_two_threads_do_not_meet(evaluator: str) -> None:
    steps = 4000 if evaluator == "compiled" else 400
    loop = loaded("paper", evaluator)
    gains = (5.0, 30.0)

    def outcome(c1: float) -> list[float]:
        controller = loop.controller(parameters={"c1": c1})
        return [controller.step(0.1 * math.sin(0.01 * k)) for k in range(steps)]

    alone, together = [outcome(c1) for c1 in gains], [[], []]  # type: ignore[var-annotated]

    def work(place: int) -> None:
        together[place] = outcome(gains[place])

    threads = [threading.Thread(target=work, args=(place,)) for place in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


def test_steps_that_threads_take_of_one_controller_come_one_after_the_other(evaluator: str) -> None:
    """Equal readings: whatever the threads' order, the result is that of one thread."""
    steps = 3000 if evaluator == "compiled" else 300
    loop = loaded("paper", evaluator)
    shared, alone = loop.controller(), loop.controller()
    threads = [
        threading.Thread(target=lambda: [shared.step(0.3, 0.1) for _ in range(steps)]) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for _ in range(4 * steps):
        alone.step(0.3, 0.1)
    assert shared.state == alone.state


def test_unchanged_models_load_no_symbolic_tool(root: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys; from pmjoint_codegen import ClosedLoop; ClosedLoop.load('paper').controller().step(0.1);"
        "sys.exit(bool({'sympy', 'casadi'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=root).returncode == 0
