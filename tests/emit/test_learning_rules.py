"""Rules for guesses, ranges and gains of estimates: each is broken once, by a file's or a run's number."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pmjoint_codegen.closed_loop import ClosedLoop
from pmjoint_codegen.emit.learning_rules import learning_rules
from pmjoint_codegen.errors import UsageError
from pmjoint_codegen.manifest import Manifest
from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.modelfile.reader import read_document
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.sweep.validity import valid_rows
from pmjoint_codegen.values import check_rules
from pmjoint_derive import Model
from pmjoint_derive.adaptation import LeastSquares, settings_of
from pmjoint_derive.units import Unit


@pytest.fixture(scope="module")
def manifest(root: Path) -> Manifest:
    return Manifest.read(root / "generated" / "paper-adaptive")


BROKEN: list[tuple[dict[str, float], str]] = [
    ({"b0_guess": 0.3}, "b0_guess: not inside the range of b0_hat: b0_guess - b0_low = 0; "),
    ({"b0_guess": -1.2}, "b0_guess: not inside the range of b0_hat: b0_guess - b0_low = -1.5; "),
    ({"d1_guess": 3.5}, "d1_guess: not inside the range of d1_hat: d1_high - d1_guess = -0.5; "),
    ({"d1_low": 1.0, "d1_high": 0.0}, "d1_guess: not inside the range of d1_hat: d1_guess - d1_low = -1.5; "),
    ({"b0_prior": 6.5}, "b0_prior: not inside the range of b0_hat: b0_high - b0_prior = -0.5; "),
    ({"b0_low": -0.1}, "b0_low: the range of b0_hat contains 0, and the law divides by it: "),
    ({"gamma_d1": -1e-9}, "gamma_d1: is -1e-09; allowed: a number of 0 or greater"),
    ({"leakage": -0.01}, "leakage: is -0.01; allowed: a number of 0 or greater"),
    ({"compensator": 0.0}, "compensator: plain clipping misleads the estimates, which destroys the loop: "),
]


@pytest.mark.parametrize(("values", "message"), BROKEN)
def test_a_run_refuses_what_no_estimate_can_have(
    manifest: Manifest, values: dict[str, float], message: str
) -> None:
    with pytest.raises(UsageError) as refused:
        make_settings(manifest, parameters=values)
    assert str(refused.value).startswith(message)


def test_a_sweep_marks_such_runs(manifest: Manifest) -> None:
    usual = make_settings(manifest).p
    rows = []
    for values, _ in BROKEN:
        row = usual.copy()
        for name, value in values.items():
            row[manifest.parameter_names.index(name)] = value
        rows.append(row)
    x0 = [manifest.simulation.x0] * len(rows)
    assert not valid_rows(manifest, np.array(rows), np.array(x0)).any()
    assert valid_rows(manifest, np.array([usual]), np.array(x0[:1])).all()


def test_true_values_obey_no_rule_of_the_estimates(manifest: Manifest) -> None:
    for name in ("b0", "d1"):
        assert make_settings(manifest, parameters={name: 100.0}).parameters[name] == 100.0


@pytest.mark.parametrize("asked", [{"compensator": False}, {"parameters": {"compensator": 0.0}}])
def test_plain_clipping_is_refused_unless_the_file_forces_it(
    manifest: Manifest, asked: Mapping[str, bool]
) -> None:
    with pytest.raises(UsageError, match=r"destroys the loop.*force = true in \[adaptation\]"):
        make_settings(manifest, **asked)  # type: ignore[arg-type]  # of either kind


def test_so_is_the_option_saturation() -> None:
    with pytest.raises(UsageError, match="saturation: plain clipping misleads the estimates"):
        ClosedLoop.load("paper-adaptive", saturation="clip")


def rejected(model: Model, **values: float) -> str:
    """The message about values of a model's controller, or nothing."""
    own = {item.symbol.name: item.value for item in settings_of(model.adaptation, Unit({}))}
    try:
        check_rules({"compensator": 1.0} | own | values, learning_rules(model.adaptation), error=UsageError)
    except UsageError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def inverse(root: Path) -> Model:
    path = root / "tests" / "reference" / "adaptive-load.toml"
    return model_of(read_document(path), str(path))


def test_an_estimate_of_the_inverse_has_the_sign_of_b_m(inverse: Model) -> None:
    assert rejected(inverse) == ""
    assert rejected(inverse, rho_guess=-0.8).startswith("rho_guess: another sign of 1/b_m than the model's")
    assert rejected(inverse, b0_guess=-0.1).startswith("b0_guess: another sign of b_m than the model's")
    assert rejected(inverse, gamma_rho=-1.0).startswith("gamma_rho: is -1")
    assert rejected(inverse, rho_leakage=-1.0).startswith("rho_leakage: is -1")


def test_least_squares_have_rules_of_their_own(inverse: Model) -> None:
    adaptation = inverse.adaptation
    assert adaptation is not None
    squares = dataclasses.replace(
        adaptation, inverse=None, leakage=0.0, least_squares=LeastSquares(100.0, 0.5, 5.0, 50.0), force=True
    )
    model = dataclasses.replace(inverse, adaptation=squares)
    assert rejected(model, compensator=0.0) == ""
    assert rejected(model, ls_kappa=0.0).startswith("ls_kappa: is 0")
    assert rejected(model, ls_P0=0.0) == ""
    assert rejected(model, ls_P0=-1.0).startswith("ls_P0: is -1")
    assert rejected(model, ls_P0=0.0, ls_k_max=0.0).startswith("ls_k_max: is 0")
    assert rejected(model, ls_forgetting=-1.0).startswith("ls_forgetting: is -1")
    assert rejected(model, ls_k_max=14.9).startswith("ls_k_max: less than the initial trace")


def test_a_guess_that_is_never_corrected_is_not_zero(inverse: Model) -> None:
    adaptation = inverse.adaptation
    assert adaptation is not None
    known = tuple(dataclasses.replace(entry, unknown=False) for entry in adaptation.entries)
    model = dataclasses.replace(
        inverse, adaptation=dataclasses.replace(adaptation, entries=known, inverse=None)
    )
    assert rejected(model, b0_guess=0.0).startswith("b0_guess: is 0")
    assert rejected(model, b0_guess=-1.0, compensator=0.0) == ""
