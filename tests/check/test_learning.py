"""The gates on a model with estimates: what they find, and mutants of its kernels, its rates and its V."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmjoint_codegen.check.gates import invariants, learning, symbolic
from pmjoint_codegen.check.oracles import truth
from pmjoint_codegen.check.result import GateResult, Verdict
from pmjoint_codegen.check.subject import Subject, load_subject
from pmjoint_codegen.check.table import GATES, run_gate
from pmjoint_codegen.check.trajectory import default_run
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.loops.logits import place_of
from pmjoint_codegen.simulate.run import Run
from pmjoint_derive import Model
from tests.check.test_mutants_of_c import compiled, evaluate, mutants_of, source

Tally = Callable[[str, str, GateResult], None]


@pytest.fixture(scope="module")
def quiet(adaptive: Subject) -> Evaluator:
    if adaptive.compiled is None:
        pytest.skip("no C compiler")
    return invariants.quiet_evaluator(adaptive)


def gate(subject: Subject, name: str) -> GateResult:
    return run_gate(subject, next(gate for gate in GATES if gate.name == name))


def test_v_has_the_papers_numbers_and_falls_as_it_should(adaptive: Subject) -> None:
    result = gate(adaptive, "trajectory.certificate")
    assert result.verdict is Verdict.PASSED
    assert [line.partition(":")[0].partition(",")[0] for line in result.findings] == [
        "column V is V of the true values",
        "V / what -f V + Y allows",
        "V does not grow without disturbance and leakage",
        "V falls as (I) says",
        "without disturbance and leakage V goes from 198.37504 (V_z 163.87587",
    ]
    assert "V_Theta 0.7491" in result.findings[-1] and "V_epsilon 33.75)" in result.findings[-1]
    assert "to 1.5857, with 3 switches" in result.findings[-1]


def test_invariants_are_those_of_chi_and_the_true_values(adaptive: Subject, quiet: Evaluator) -> None:
    result = invariants.check(adaptive)
    assert result.verdict is Verdict.PASSED
    names = [line.partition(":")[0] for line in result.findings]
    assert {"e = z1 + chi1", "b0_hat in its range", "u_max out of reach gives chi = 0"} <= {*names}
    assert not any("does not depend on u_max" in name for name in names)  # the estimates do
    run = default_run(quiet)
    assert invariants.estimation_gap(quiet, run, adaptive.model) < 1e-12
    assert invariants.estimation_gap(quiet, run) > 1e-3  # x_hat with the estimates is no such thing


@pytest.mark.parametrize("kernel", ["law", "partials", "estimation", "compensator", "sampled_update"])
def test_every_change_of_a_kernel_is_outside_the_error_bound(
    adaptive: Subject, tmp_path: Path, tally: Tally, kernel: str
) -> None:
    function = adaptive.manifest.function(kernel)
    mutants = mutants_of(source(adaptive), function)
    library = compiled(tmp_path, mutants)
    prepared = symbolic.prepare(
        adaptive, function, 32 if kernel == "law" else 3
    )  # leakage has a small share of v
    assert adaptive.compiled is not None
    true = adaptive.compiled.call(kernel, *prepared.arguments)
    for i, (what, _) in enumerate(mutants):
        results = evaluate(function, library[f"mutant_{i}"], prepared.arguments)
        if "swap operands of -" in what and all(map(np.array_equal, results, true)):
            continue  # of a difference that is squared
        tally("symbolic", what, symbolic.conclude([symbolic.judge(prepared, results)]))


Change = Callable[[Array, Array, dict[str, int], bool], None]  # of rates, at a state, in place


def b0_hat(X: Array, at: dict[str, int]) -> float:
    return float(place_of(X[at["b0_logit"]], *map(np.array, (1.2, 0.3, 6.0))))


def d1_hat(X: Array, at: dict[str, int]) -> float:
    return float(place_of(X[at["d1_logit"]], *map(np.array, (-0.5, -3.0, 3.0))))


def turned(rates: Array, _X: Array, at: dict[str, int], _clipped: bool) -> None:
    rates[at["b0_logit"]] *= -1.0


def without_range(rates: Array, X: Array, at: dict[str, int], _clipped: bool) -> None:
    hat = b0_hat(X, at)
    rates[at["b0_logit"]] /= 4 * (hat - 0.3) * (6.0 - hat) / 5.7**2


def other_gain(rates: Array, X: Array, at: dict[str, int], _clipped: bool) -> None:
    one, other = b0_hat(X, at), d1_hat(X, at)
    rates[at["b0_logit"]] *= ((other + 3) * (3 - other) / 36) / ((one - 0.3) * (6.0 - one) / 5.7**2)


def true_b(rates: Array, X: Array, at: dict[str, int], _clipped: bool) -> None:
    rates[at["chi1"]] += (2.0 - b0_hat(X, at)) * X[at["chi2"]]


def frozen(rates: Array, _X: Array, at: dict[str, int], clipped: bool) -> None:
    if clipped:
        rates[at["b0_logit"]] = rates[at["d1_logit"]] = 0.0


def same(_rates: Array, _X: Array, _at: dict[str, int], _clipped: bool) -> None:
    pass


MUTANTS: dict[str, Change] = {
    "tau of the other sign": turned,
    "a gain that does not vanish at the ends": without_range,
    "the gain of another entry": other_gain,
    "b_m for its estimate in chi_1'": true_b,
    "estimates that stand still while u is at a limit": frozen,
}


def integrated(evaluator: Evaluator, model: Model, change: Change) -> Run:
    """A run without disturbance and leakage under changed rates, by SciPy."""
    run = learning.quiet_run(evaluator, model, 1.0, 1 / 4000)
    p, loop = run.settings.p, evaluator.kernel("closed_loop")
    at = {item.name: i for i, item in enumerate(evaluator.manifest.states)}
    limit = run.settings.parameters["u_max"]

    def rhs(t: float, X: Array) -> Array:
        given, state = np.array([t]), np.ascontiguousarray(X)
        rates, v, *_ = loop(given, state, np.array([0.0, 1.0]), p)
        clipped = bool(abs(v[0]) > limit)
        if clipped:
            rates = loop(given, state, np.array([np.copysign(limit, v[0]), 0.0]), p)[0]
        rates = np.array(rates)
        change(rates, X, at, clipped)
        return rates

    found = solve_ivp(rhs, (0.0, 1.0), run.states[0], "DOP853", t_eval=run.t, rtol=1e-9, atol=1e-10)
    states = np.ascontiguousarray(found.y.T)
    t = run.t[: len(states)]  # SciPy gives up where an estimate of b_m passes 0
    signals = evaluator.call("signals", t[:, np.newaxis], states, p)[0]
    return dataclasses.replace(run, t=t, states=states, signals=signals)


def test_estimates_that_move_otherwise_are_noticed(adaptive: Subject, quiet: Evaluator, tally: Tally) -> None:
    """V decreases under several of these; that it falls by what (I) says, under none."""
    sound = learning.fall(quiet, integrated(quiet, adaptive.model, same), adaptive.model)
    assert sound[1] <= sound[2]
    for what, change in MUTANTS.items():
        run = integrated(quiet, adaptive.model, change)
        finding = learning.fall(quiet, run, adaptive.model)
        assert finding[1] > 100 * finding[2], what
        tally("trajectory.certificate", what, invariants.judge([finding]))


def test_a_wrong_v_and_an_estimate_beyond_its_range_are_noticed(
    adaptive: Subject, quiet: Evaluator, tally: Tally
) -> None:
    model, run = adaptive.model, learning.quiet_run(quiet, adaptive.model)
    beyond = run.signals.copy()
    beyond[-1, [item.name for item in run.manifest.signals].index("b0_hat")] = 6.0
    at_end = dataclasses.replace(run, signals=beyond)
    tally("trajectory.invariants", "b0_hat = 6", invariants.judge(invariants.estimates_stay(at_end)))
    signals = run.signals.copy()
    signals[:, [item.name for item in run.manifest.signals].index("V")] *= 1 + 1e-8
    other = dataclasses.replace(run, signals=signals)
    tally("trajectory.certificate", "V 1e-8 off", invariants.judge(learning.column(other, model)))
    backwards = dataclasses.replace(run, states=run.states[::-1].copy(), signals=run.signals[::-1].copy())
    tally("trajectory.certificate", "V that grows", invariants.judge([learning.decrease(backwards, model)]))
    grown = learning.bound(backwards, model, 0.0, disturbs_y=False)
    tally("trajectory.certificate", "V above its bound", invariants.judge([grown]))


def test_a_true_value_outside_its_range_leaves_no_v(adaptive: Subject) -> None:
    """Runs go on; V is nan, and the gate says why it judges nothing."""
    evaluator = adaptive.compiled or adaptive.interpreted
    run = default_run(evaluator, {"b0": 7.0})
    assert np.all(np.isnan(run["V"])) and np.all(np.isfinite(run["y"]))
    assert truth.outside(adaptive.model, run.settings.parameters) == ("b0",)
    parameters = tuple(
        dataclasses.replace(item, value=7.0) if item.name == "b0" else item
        for item in evaluator.manifest.parameters
    )
    moved = dataclasses.replace(evaluator.manifest, parameters=parameters)
    reason = learning.no_claim(adaptive.model, moved)
    assert reason == "V has no meaning: the true value of b0 is outside its range"


def test_leakage_with_a_constant_gain_has_a_rate(root: Path) -> None:
    """The rate is the least of four, the residual the sum of what leakage and D add; here by hand."""
    file = root / "tests" / "reference" / "adaptive-load.toml"
    model = load_subject(file, os.environ, lambda _line: None).model
    values = {item.name: item.value for item in model.parameters}
    adaptation = model.adaptation
    assert adaptation is not None
    values |= {
        f"{kind}{i}": v for kind in ("c", "e", "k") for i, v in enumerate(getattr(model.gains, kind), 1)
    }
    values |= {entry.gamma.name: entry.gain for entry in adaptation.unknown}
    values |= {entry.prior_symbol.name: entry.prior for entry in adaptation.unknown}
    values |= {"leakage": 0.01, "rho_leakage": 0.01, "gamma_rho": 1.0, "rho_prior": 1 / 1.2}
    f, Y = truth.decay(model, values, 0.0, disturbs_y=False)
    assert f == pytest.approx(0.01)  # leakage times the least gain
    learnt = (2.0 - 1.2) ** 2 + (0.2 + 0.5) ** 2 + 1.0
    expected = 0.005 * learnt + 2.0 * 0.005 * (0.5 - 1 / 1.2) ** 2
    assert pytest.approx(expected) == Y
