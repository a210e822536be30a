"""The exported controller with estimates: where they start, what moves them, what they may never do."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.export.twin import exact_arithmetic

BAD_INPUT, BAD_PARAMETER = 1, 8
Load = Callable[..., Exported]
Y_R = np.array([0.3, 0.1, -0.2])
LEARNERS = ("paper-adaptive", "inverse", "squares", "negative", "first-order", "lag-adaptive")


def reference(loaded: Exported, k: int) -> np.ndarray:
    """Return a reference that swings, with as many derivatives as the controller takes."""
    count = len(loaded.export.program.derivation.signals.y_r)
    return np.array([math.cos(0.7 * k + 1.1 * order) for order in range(count)])


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("paper-adaptive", {"pull_b0", "pull_d1"}),
        ("inverse", {"pull_b0", "pull_d1", "pull_rho"}),
        ("first-order", {"z1", "pull_d1"}),  # the regressor of b0 has the applied u, which comes later
        ("squares", {"prediction_error", "prediction_norm", "omega1_b0", "omega1_d1"}),
        ("paper", set()),
    ],
)
def test_what_the_law_leaves_for_the_update(
    name: str, kept: set[str], exports: Callable[..., Export]
) -> None:
    program = exports(name).program
    estimates = {hat for hat in program.derivation.signals.estimates if hat not in program.states}
    assert {symbol.name for symbol in set(program.kept) - estimates} == kept
    assert estimates <= set(program.kept)  # for whoever wants to see them
    read = set().union(*(term.free_symbols for item in program.update for term in item.terms))
    assert set(program.kept) - estimates <= read
    assert not read & set(program.derivation.signals.y_r)


@pytest.mark.parametrize("matched", [0, 1])
@pytest.mark.parametrize("name", LEARNERS)
def test_estimates_start_at_their_guesses(name: str, matched: int, load: Load) -> None:
    loaded = load(name)
    default, loaded.params.matched = loaded.params.matched, matched
    assert loaded.init(0.4, reference(loaded, 0)) == 0
    loaded.params.matched = default
    adaptation = loaded.export.program.derivation.model.adaptation
    assert adaptation is not None and adaptation.unknown
    for entry in adaptation.unknown:
        assert getattr(loaded.state, entry.estimate.name) == entry.guess
    if adaptation.inverse is not None:
        assert loaded.state.rho_hat == adaptation.inverse.guess
    if adaptation.least_squares is not None:
        diagonal = [getattr(loaded.state, row[i].name) for i, row in enumerate(adaptation.covariance)]
        assert diagonal == [adaptation.least_squares.P0] * len(adaptation.unknown)
        assert loaded.state.Gamma12 == 0.0


@pytest.mark.parametrize("matched", [False, True])
@pytest.mark.parametrize("name", LEARNERS)
def test_the_self_test_holds_and_estimates_move_as_the_equations_say(
    name: str, matched: bool, load: Load
) -> None:
    loaded = load(name)
    assert loaded.call("self_test") == 0
    exact = twin_of(loaded.export.program, exact_arithmetic(), DOUBLE, matched=matched)
    number = exact.arithmetic.number
    default, loaded.params.matched = loaded.params.matched, int(matched)
    exact.reset(number(0.4), [number(entry) for entry in reference(loaded, 0)])
    loaded.init(0.4, reference(loaded, 0))
    loaded.params.matched = default
    first = loaded.states
    for k in range(12):
        y, y_r = 0.4 * math.cos(0.9 * k), reference(loaded, k)
        loaded.step(y, y_r)
        exact.step(number(y), [number(entry) for entry in y_r])
    for symbol, start in zip(loaded.export.program.states, first, strict=True):
        wanted, found = float(exact.values[symbol]), getattr(loaded.state, symbol.name)
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-12)
        if symbol in loaded.export.program.learnt:
            assert found != start


@pytest.mark.parametrize(
    ("model", "name", "value"),
    [
        ("paper-adaptive", "b0_guess", 0.3),
        ("paper-adaptive", "b0_guess", 6.5),
        ("paper-adaptive", "b0_guess", math.nan),
        ("paper-adaptive", "b0_low", -1.0),
        ("paper-adaptive", "b0_low", 0.0),
        ("paper-adaptive", "b0_high", 1.1),
        ("paper-adaptive", "b0_prior", 6.0),
        ("paper-adaptive", "d1_guess", -3.0),
        ("paper-adaptive", "gamma_d1", -1e-9),
        ("paper-adaptive", "leakage", -0.1),
        ("negative", "b0_high", 0.5),
        ("negative", "b0_guess", 1.2),
        ("inverse", "rho_guess", -0.5),
        ("inverse", "gamma_rho", -1.0),
        ("squares", "ls_k_max", 9.9),
        ("squares", "ls_P0", -1e-9),
        ("squares", "ls_kappa", 0.0),
    ],
)
def test_init_refuses_what_no_estimate_can_start_from(
    model: str, name: str, value: float, load: Load
) -> None:
    loaded = load(model)
    own = getattr(loaded.params, name)
    assert loaded.init(0.4, reference(loaded, 0)) == 0
    setattr(loaded.params, name, value)
    assert loaded.init(0.4, reference(loaded, 0)) == BAD_PARAMETER
    setattr(loaded.params, name, own)


@pytest.mark.parametrize("name", LEARNERS)
def test_estimates_rest_over_a_hold_whose_sample_was_not_sound(name: str, load: Load) -> None:
    loaded = load(name)
    learnt = [symbol.name for symbol in loaded.export.program.learnt]

    def estimates() -> list[float]:
        return [getattr(loaded.state, item) for item in learnt]

    assert loaded.init(0.4, reference(loaded, 0)) == 0
    for k in range(4):
        assert loaded.step(0.4 - 0.1 * k, reference(loaded, k)) == 0
    assert loaded.step(math.nan, reference(loaded, 4)) == BAD_INPUT
    held = estimates()
    assert loaded.step(0.2, reference(loaded, 5)) == 0
    assert estimates() == held
    assert loaded.step(0.1, reference(loaded, 6)) == 0
    assert all(a != b for a, b in zip(estimates(), held, strict=True))


@pytest.mark.parametrize("name", ["paper-adaptive", "negative", "lag-adaptive"])
def test_estimates_never_leave_their_ranges(name: str, load: Load) -> None:
    loaded = load(name)
    adaptation = loaded.export.program.derivation.model.adaptation
    assert adaptation is not None
    gains = {entry.gamma.name: getattr(loaded.params, entry.gamma.name) for entry in adaptation.unknown}
    for gain, value in gains.items():
        setattr(loaded.params, gain, 1e6 * value)
    assert loaded.init(1.0, reference(loaded, 0)) == 0
    ends = {entry.estimate.name: entry.range for entry in adaptation.unknown}
    seen: dict[str, list[float]] = {estimate: [] for estimate in ends}
    for k in range(300):
        loaded.step(math.sin(0.05 * k), reference(loaded, k))
        for estimate in ends:
            seen[estimate].append(getattr(loaded.state, estimate))
    for gain, value in gains.items():
        setattr(loaded.params, gain, value)
    for estimate, pair in ends.items():
        assert pair is not None
        assert pair[0] < min(seen[estimate]) and max(seen[estimate]) < pair[1]
        assert max(seen[estimate]) - min(seen[estimate]) > 0.9 * (pair[1] - pair[0])


def test_right_estimates_at_rest_give_the_law_of_known_parameters(load: Load) -> None:
    known, learner = load("paper"), load("paper-adaptive")
    own = {"b0_guess": known.params.b0, "d1_guess": known.params.d1, "gamma_b0": 0.0, "gamma_d1": 0.0}
    before = {name: getattr(learner.params, name) for name in own}
    for name, value in own.items():
        setattr(learner.params, name, value)
    for loaded in (known, learner):
        assert loaded.init(1.5, reference(loaded, 0)) == 0
    for k in range(200):
        y, y_r = 1.5 * math.cos(0.02 * k), 0.1 * reference(known, k)
        for loaded in (known, learner):
            assert loaded.step(y, y_r) == 0
        assert learner.output.v == pytest.approx(known.output.v, rel=1e-12, abs=1e-9)
        assert learner.state.chi1 == pytest.approx(known.state.r1, rel=1e-12, abs=1e-13)
    for name, value in before.items():
        setattr(learner.params, name, value)
