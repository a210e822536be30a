"""The paper's example against an independent solution; other settings against one of SciPy's solvers."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.modes import make_actuator
from pmjoint_codegen.loops.status import Status
from pmjoint_codegen.simulate.run import Run, run
from pmjoint_codegen.simulate.settings import make_settings

REFERENCE = (
    Path(__file__).parent.parent / "reference" / "paper_sin.csv"
)  # Taylor steps, order 20; LSODA within 2e-11


@pytest.fixture(scope="module")
def reference() -> Any:
    return np.genfromtxt(REFERENCE, delimiter=",", names=True)


@pytest.fixture(scope="module")
def found(paper: Evaluator) -> Run:
    return run(paper, make_settings(paper.manifest))


def test_every_column_agrees(found: Run, reference: Any) -> None:
    rows = np.rint(reference["t"] / 0.01).astype(int)
    np.testing.assert_allclose(found.t[rows], reference["t"], rtol=0, atol=1e-12)
    for name in reference.dtype.names[1:]:
        np.testing.assert_allclose(found[name][rows], reference[name], rtol=0, atol=1e-10, err_msg=name)


def test_saturation_is_left_and_entered_when_it_should_be(found: Run, reference: Any) -> None:
    assert found.initial_mode == -1
    assert [mode for _, mode in found.switches] == [0, 1, 0]
    np.testing.assert_allclose([t for t, _ in found.switches], [0.0549, 0.0720, 0.2221], rtol=0, atol=5e-5)


def test_v_stands_on_its_limit_at_every_switch(paper: Evaluator, found: Run) -> None:
    times = sorted(t for t, _ in found.switches)
    p = found.settings.p
    for t, limit in zip(times, (-10.0, 10.0, 10.0), strict=True):
        ended = run(paper, make_settings(paper.manifest, horizon=t))
        (signals,) = paper.call("signals", [t], ended.states[-1], p)
        v = signals[[item.name for item in paper.manifest.signals].index("v")]
        # v moves at 100 1/s and more there, so that 1e-10 in v is 1e-12 s.
        assert v == pytest.approx(limit, abs=1e-10)


def test_the_summary_has_the_known_figures(found: Run) -> None:
    summary = found.summary
    assert summary["status"] == "done"
    assert summary["max_abs_v"] == pytest.approx(225.68020625, abs=1e-10)
    assert summary["max_abs_e"] == pytest.approx(2.205, abs=5e-4)
    assert summary["ise"] == pytest.approx(9.42, abs=5e-3)
    assert summary["peaks"]["r1"] == pytest.approx([2.2955, 0.955], abs=5e-4)
    assert summary["peaks"]["r2"] == pytest.approx([8.5487, 0.0522], abs=5e-4)
    assert summary["peaks"]["x2"] == pytest.approx([2.9872, 0.347], abs=5e-4)
    assert summary["saturated_s"] == pytest.approx(0.0549 + 0.2221 - 0.0720, abs=2e-4)
    assert np.flatnonzero(np.abs(found["e"]) > 0.03)[-1] == pytest.approx(746, abs=1)


def test_without_the_compensator_tracking_is_faster(paper: Evaluator) -> None:
    found = run(paper, make_settings(paper.manifest, compensator=False))
    assert not found["r1"].any()
    assert found.summary["ise"] == pytest.approx(0.423, abs=5e-4)
    assert found.summary["max_abs_e"] == pytest.approx(1.5, abs=1e-12)


def test_twin_and_c_agree_to_the_bit(compiled_paper: Evaluator, interpreted_paper: Evaluator) -> None:
    for controller in ("continuous", "sampled"):
        runs = [
            run(
                evaluator,
                make_settings(evaluator.manifest, horizon=1.0, output_step=0.0037, controller=controller),
            )
            for evaluator in (compiled_paper, interpreted_paper)
        ]
        one, other = runs
        np.testing.assert_array_equal(one.states, other.states)
        np.testing.assert_array_equal(one.signals, other.signals)
        assert (one.switches, one.steps, one.ise, one.peaks) == (
            other.switches,
            other.steps,
            other.ise,
            other.peaks,
        )


OTHERS: list[dict[str, Any]] = [
    {"parameters": {"c1": 20.0, "c2": 5.0, "e1": 0.5}},
    {"parameters": {"k1": 30.0, "k2": 200.0, "ck1": 4.0, "ck2": 3.0}},
    {"parameters": {"u_max": 2.5}, "x0": [-2.0, 1.5]},
    {"parameters": {"d1": -3.0, "b0": -1.5}},
    {"parameters": {"u_max": 40.0}, "x0": [5.0, -3.0], "compensator": False},
    {"x0": [0.0, 0.0]},
]


@pytest.mark.parametrize("asked", OTHERS, ids=str)
def test_other_settings_agree_with_a_general_solver(
    compiled_paper: Evaluator, asked: Mapping[str, Any]
) -> None:
    settings = make_settings(compiled_paper.manifest, horizon=4.0, output_step=0.05, **asked)
    found = run(compiled_paper, settings)
    assert found.status == Status.DONE
    expected = solve(compiled_paper, found)
    # DOP853 at rtol 1e-13 between the located switches; its own error, grown over 4 s, is below 1e-10 here.
    np.testing.assert_allclose(found.states, expected, rtol=1e-9, atol=1e-9)
    limit = settings.parameters["u_max"]
    np.testing.assert_array_equal(found["u"], np.clip(found["v"], -limit, limit))
    inside = np.abs(found["v"]) < limit
    labels = np.array([found.initial_mode, *(mode for _, mode in found.switches)])
    where = np.searchsorted([t for t, _ in found.switches], found.t, side="right")
    np.testing.assert_array_equal(inside, labels[where] == 0)


def solve(evaluator: Evaluator, found: Run) -> Array:
    """Integrate with DOP853 from one output instant or switch to the next, so that it never meets a kink."""
    settings = found.settings
    actuator = make_actuator(evaluator.call("actuation", settings.p)[0])
    rates = evaluator.kernel("closed_loop")
    switches = [t for t, _ in found.switches]
    labels = [found.initial_mode, *(label for _, label in found.switches)]
    state, rows = found.states[0], [found.states[0]]
    for begin, end in pairwise(sorted({*found.t.tolist(), *switches})):
        label = labels[bisect_right(switches, begin)]
        g = actuator.modes[actuator.labels.index(label)]

        def rhs(t: float, X: Array, g: Array = g) -> Array:
            return rates(np.array([t]), np.ascontiguousarray(X), g, settings.p)[0]

        state = solve_ivp(rhs, (begin, end), state, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        if end not in switches:
            rows.append(state)
    return np.array(rows)
