"""The front door: what a script does with a model."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen import ClosedLoop
from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.errors import BuildError, MissingToolError, SimulationError, UsageError
from pmjoint_codegen.kernels.evaluator import Array


@pytest.fixture(scope="module")
def model(root: Path) -> Path:
    return root / "models" / "paper.toml"


@pytest.fixture(scope="module", params=["compiled", "interpreted"])
def loop(request: pytest.FixtureRequest, model: Path, cache: Path) -> ClosedLoop:
    if request.param == "interpreted":
        pytest.importorskip("casadi")
    elif find_compiler(os.environ) is None:
        pytest.skip("no C compiler")
    return ClosedLoop.load(model, request.param)


def test_a_run_from_a_script(loop: ClosedLoop) -> None:
    run = loop.simulate(horizon=2.0, parameters={"c1": 20.0}, x0=[1.0, 0.0])
    assert run.summary["status"] == "done"
    assert run.summary["parameters"]["c1"] == 20.0
    assert run["x1"][0] == 1.0
    assert run.t[-1] == 2.0
    assert run.evaluator == loop.evaluator.kind


def test_control_is_v_along_the_run_and_broadcasts(loop: ClosedLoop) -> None:
    run = loop.simulate(horizon=1.0, parameters={"c2": 7.0})
    reference = np.column_stack([np.sin(run.t), np.cos(run.t), -np.sin(run.t)])
    for state in (run.states[:, 2:], run.states):
        v = loop.control(state, run["y"], reference, parameters={"c2": 7.0})
        np.testing.assert_allclose(v, run["v"], rtol=1e-12, atol=1e-12)
    assert loop.control(np.zeros(8), 0.0, np.zeros(3)).shape == ()
    assert loop.control(np.zeros((4, 1, 8)), np.zeros(5), np.zeros(3)).shape == (4, 5)
    with pytest.raises(UsageError, match="argument s"):
        loop.control(np.zeros(7), 0.0, np.zeros(3))
    with pytest.raises(UsageError, match="no parameter"):
        loop.control(np.zeros(8), 0.0, np.zeros(3), parameters={"zz": 1.0})


@pytest.mark.parametrize("parameters", [None, {"c2": 7.0}])
def test_a_prepared_law_is_control_one_state_at_a_time(
    loop: ClosedLoop, parameters: dict[str, float] | None
) -> None:
    draw = np.random.default_rng(6)
    states, y, references = draw.normal(size=(20, 8)), draw.normal(size=20), draw.normal(size=(20, 3))
    expected = loop.control(states, y, references, parameters=parameters)
    law, other = loop.law(parameters=parameters), loop.law()
    for i, v in enumerate(expected):
        assert law(states[i], y[i], references[i]) == v
        other(states[0], 0.0, references[0])  # does not disturb it
        assert law.evaluate() == v
        assert law(states[i].tolist(), float(y[i]), references[i].tolist()) == v
        law.s[:], law.y[0] = 0.0, 0.0
        assert law.evaluate() == loop.control(np.zeros(8), 0.0, references[i], parameters=parameters)
        assert law.v[0] == law.evaluate()
    assert type(law.evaluate()) is float
    assert (law.z.shape, law.alpha.shape) == ((2,), (1,))


@pytest.mark.parametrize(
    "kept",
    [
        lambda a: a.astype(np.float32),
        lambda a: a.astype(int),
        lambda a: np.repeat(a, 2)[::2],
        lambda a: a.astype(">f8"),
    ],
)
def test_a_prepared_law_takes_every_kind_of_numbers(loop: ClosedLoop, kept: Callable[[Array], Array]) -> None:
    law = loop.law()
    s, y_r = kept(np.linspace(-3.0, 4.0, 8)), kept(np.array([2.0, -1.0, 4.0]))
    assert law(s, float(y_r[0]), y_r) == loop.control(s, y_r[0], y_r)
    assert law.s.tolist() == s.tolist()


def test_a_law_called_from_threads_mixes_nothing_up(
    loop: ClosedLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    states = np.random.default_rng(8).normal(size=(8, 8))
    expected = loop.control(states, 0.5, np.zeros(3)).tolist()
    law = loop.law()
    law(states[0], 0.5, np.zeros(3))
    with ThreadPoolExecutor(max_workers=1) as pool:  # makes the law of the other threads
        assert pool.submit(law, states[1], 0.5, np.zeros(3)).result() == expected[1]
    assert law.evaluate() == expected[0]  # what stands in the arrays is the owner's
    shared = law._other
    assert shared is not None
    evaluate = shared._run

    def slow() -> None:
        time.sleep(0.005)  # lets the other threads write their arguments, if they may
        evaluate()

    monkeypatch.setattr(shared, "_run", slow)
    with ThreadPoolExecutor(max_workers=4) as pool:
        found = pool.map(lambda s: law(s, 0.5, np.zeros(3)), states)
        here = [law(s, 0.5, np.zeros(3)) for s in states]
        assert list(found) == here == expected


def test_a_law_is_evaluated_in_place_by_its_own_thread_alone(loop: ClosedLoop) -> None:
    law = loop.law()
    with ThreadPoolExecutor(max_workers=1) as pool:
        with pytest.raises(UsageError, match="make a law in each thread"):
            pool.submit(law.evaluate).result()
        assert pool.submit(lambda: loop.law().evaluate()).result() == law.evaluate()


def test_a_law_of_other_shapes_or_parameters_is_refused(loop: ClosedLoop) -> None:
    law = loop.law()
    for arguments in (
        (np.zeros(7), 0.0, np.zeros(3)),
        (np.zeros(1), 0.0, np.zeros(3)),
        (np.zeros(10), 0.0, np.zeros(3)),
        (0.0, 0.0, np.zeros(3)),
        (np.zeros(8), 0.0, np.zeros(2)),
        (np.zeros((8, 2)), 0.0, np.zeros(3)),
        (np.zeros(8), np.zeros(2), np.zeros(3)),
        (["x"] * 8, 0.0, np.zeros(3)),
    ):
        with pytest.raises(UsageError, match="a state of length 8, a number, a reference of length 3"):
            law(*arguments)
    with pytest.raises(UsageError, match="no parameter"):
        loop.law(parameters={"zz": 1.0})


def test_a_failed_run_is_an_error_that_carries_the_run(loop: ClosedLoop) -> None:
    with pytest.raises(SimulationError, match="finite") as caught:
        loop.simulate(parameters={"b0": 1e-300})
    assert caught.value.run.t.tolist() == [0.0]  # type: ignore[attr-defined]


def test_an_unknown_evaluator_is_refused(model: Path) -> None:
    with pytest.raises(UsageError, match="compiled, interpreted"):
        ClosedLoop.load(model, "fast")


@pytest.mark.usefixtures("no_ziglang")
def test_without_a_compiler_one_line_says_so(model: Path, tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    bare = {"PATH": str(tmp_path), "PMJOINT_CACHE": str(tmp_path)}
    lines: list[str] = []
    loop = ClosedLoop.load(model, environment=bare, notify=lines.append)
    assert loop.evaluator.kind == "interpreted"
    assert len(lines) == 1
    assert "apt-get install gcc" in lines[0]
    ClosedLoop.load(model, "interpreted", environment=bare, notify=lines.append)
    assert len(lines) == 1
    with pytest.raises(MissingToolError, match="apt-get install gcc"):
        ClosedLoop.load(model, "compiled", environment=bare, notify=lines.append)


def test_a_compiler_that_fails_is_an_error_not_a_fallback(model: Path, tmp_path: Path) -> None:
    failing = tmp_path / "cc"
    failing.write_text("#!/bin/sh\necho out of order >&2\nexit 4\n")
    failing.chmod(0o755)
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PMJOINT_CACHE": str(tmp_path / "cache")}
    with pytest.raises(BuildError, match="exit code 4") as caught:
        ClosedLoop.load(model, environment=environment)
    assert caught.value.output == "out of order\n"


def test_another_reference_is_followed(model: Path) -> None:
    pytest.importorskip("sympy")
    pytest.importorskip("casadi")
    loop = ClosedLoop.load(model, reference="cos(2*t)/2", notify=lambda line: None)
    run = loop.simulate(horizon=12.0, x0=[0.5, 0.0])
    np.testing.assert_allclose(run["y_r"], np.cos(2 * run.t) / 2, rtol=0, atol=1e-15)
    assert abs(run.summary["final_e"]) < 0.02
