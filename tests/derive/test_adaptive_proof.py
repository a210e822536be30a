"""The adaptive design is proved in every order and variant, and no mutant of it is."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Model, derive, real_symbol, tuning
from pmjoint_derive import adaptive as adaptive_law
from pmjoint_derive.adaptation import LEAKAGE
from pmjoint_derive.adaptive_proof import moving_gains, prove
from pmjoint_derive.backstepping import sensitivity
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.equation import Equations
from pmjoint_derive.estimation import inverse_pull, weighted
from pmjoint_derive.sparse import remainder
from pmjoint_derive.tuning import Tuning
from tests.derive.adaptive_models import adaptive, shipped, shipped_files, undisturbed_output

S = real_symbol
ORDERS = ((1, 1), (2, 1), (2, 2), (3, 2), (3, 3))
Change = Callable[[sp.Expr], sp.Expr]


@pytest.fixture(scope="module")
def derived(builder: Callable[..., Model]) -> Callable[..., Derivation]:
    """Return the derivation of an adaptive model by order and variant, made once."""

    @functools.cache
    def found(n: int, rho: int, **variant: Any) -> Derivation:
        return derive(adaptive(builder(n, rho), **variant))

    return found


def broken(derivation: Derivation) -> list[str]:
    """Return the names of identities that do not hold."""
    return [item.name for item in prove(derivation) if not item.holds]


@pytest.mark.parametrize("order", ORDERS, ids=lambda order: f"n{order[0]}rho{order[1]}")
@pytest.mark.parametrize(
    "variant",
    [
        {},
        {"ranged": False},
        {"inverse": True},
        {"inverse": True, "ranged": False, "sign": -1},
        {"unknown": (0,)},
        {"unknown": (-1,), "guessed": (0,)},
        {"squares": True},
        {"squares": True, "ranged": False, "sign": -1},
    ],
    ids=lambda variant: "-".join(map(str, variant)) or "all",
)
def test_every_identity_holds(
    builder: Callable[..., Model], order: tuple[int, int], variant: dict[str, Any]
) -> None:
    if variant.get("squares") and order[1] > 2:
        pytest.skip("least squares has no law beyond relative degree 2")
    model = builder(*order)
    last = len(model.plant.b) + model.plant.p - 1
    variant = variant | ({"unknown": (last,)} if variant.get("unknown") == (-1,) else {})
    derivation = derive(adaptive(model, **variant))
    identities = (*prove(derivation), *consistency_identities(derivation))
    assert [item.name for item in identities if not item.holds] == []
    assert len({item.name for item in identities}) == len(identities)


@pytest.mark.parametrize(
    ("order", "variant"), [((3, 3), {}), ((3, 3), {"inverse": True}), ((3, 2), {"squares": True})]
)
def test_claimed_rates_use_no_name_without_an_equation(
    derived: Callable[..., Derivation], order: tuple[int, int], variant: dict[str, Any]
) -> None:
    derivation = derived(*order, **variant)
    s = derivation.signals
    known = {*s.measurable, *s.gains, *s.epsilon, S("b0"), S("d1")}
    known |= {item.symbol for item in derivation.equations.values()}
    for z in s.z:
        assert derivation.equations[f"{z}_dot"].expression.free_symbols <= known


@pytest.mark.parametrize("order", [(1, 1), (2, 2)])
def test_every_identity_holds_where_nothing_disturbs_the_output(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    assert broken(derive(adaptive(undisturbed_output(builder(*order))))) == []


def test_order_four_is_proved(builder: Callable[..., Model]) -> None:
    assert broken(derive(adaptive(builder(4, 4, nonlinear=False)))) == []


@pytest.mark.parametrize("path", shipped_files(), ids=lambda path: path.stem)
def test_every_shipped_model_is_proved_with_everything_unknown(path: Path) -> None:
    assert broken(derive(adaptive(shipped(path)))) == []


def changed(derivation: Derivation, name: str, change: Change) -> Derivation:
    """Return the derivation with another right-hand side of one equation."""
    table = dict(derivation.equations)
    found = change(table[name].expression)
    assert found != table[name].expression
    table[name] = replace(table[name], expression=found)
    return replace(derivation, equations=Equations(table.values()))


def swapped(old: str, new: sp.Expr | int) -> Change:
    """Return the change of one symbol into an expression."""
    return lambda value: value.xreplace({S(old): sp.sympify(new)})


EQUATIONS: dict[str, tuple[tuple[int, int], dict[str, Any], str, Change, str]] = {
    "b_m for its estimate in chi_1'": ((2, 2), {}, "chi1_dot", swapped("b0_hat", S("b0")), "z1'"),
    "b_m for its estimate in chi_1', rho = 1": ((2, 1), {}, "chi1_dot", swapped("b0_hat", S("b0")), "z1'"),
    "sign of tau": ((2, 2), {}, "tau_b0", operator.neg, "z2'"),
    "sign of tau, of the energy alone": ((1, 1), {}, "tau_d1", operator.neg, "energy"),
    "no leakage in v": ((2, 2), {}, "v", swapped("leakage", 0), "z2'"),
    "no leakage of rho_hat in v": ((2, 2), {"inverse": True}, "v", swapped("rho_leakage", 0), "z2'"),
    "leakage not within the gain": (
        (2, 2),
        {},
        "b0_hat_dot",
        lambda _: S("Gamma_b0") * S("tau_b0") - S("leakage") * (S("b0_hat") - S("b0_prior")),
        "b0_hat'",
    ),
    "prior of another entry": ((2, 1), {}, "pull_b0", swapped("b0_prior", S("d1_prior")), "energy"),
    "gain of another entry": ((1, 1), {}, "b0_hat_dot", swapped("Gamma_b0", S("Gamma_d1")), "b0_hat'"),
    "gain of another logit": (
        (2, 2),
        {},
        "b0_logit_dot",
        swapped("gamma_b0", S("gamma_d1")),
        "V_Theta b0_hat",
    ),
    "range of another logit": ((2, 2), {}, "b0_hat", swapped("b0_high", S("d1_high")), "b0_logit"),
    "a logit turned twice": ((2, 2), {}, "b0_turn", swapped("b0_logit", 2 * S("b0_logit")), "b0_hat'"),
    "a logit not from the guess": ((2, 2), {}, "b0_hat", swapped("b0_guess", S("b0_prior")), "b0_logit"),
    "range of another entry": ((2, 2), {}, "Gamma_b0", swapped("b0_high", S("d1_high")), "b0_hat'"),
    "a gain that does not vanish at an end": (
        (2, 2),
        {},
        "Gamma_d1",
        lambda value: value + S("gamma_d1"),
        "d1_hat'",
    ),
    "sign of rho_hat's rate": ((2, 2), {"inverse": True}, "pull_rho", operator.neg, "energy"),
    "a partial derivative": ((2, 2), {}, "dalpha1_dd1_hat", operator.neg, "dalpha1_dd1_hat"),
    "a partial derivative by chi": ((3, 3), {}, "dalpha2_dchi2", lambda value: value + 1, "dalpha2_dchi2"),
    "a filter": ((2, 2), {}, "xi2_dot", swapped("k2", S("k1")), "epsilon_2"),
    "the estimate in epsilon": ((2, 2), {}, "epsilon1", swapped("d1", S("d1_hat")), "epsilon_1"),
    "an entry of P": ((3, 2), {}, "P_13", operator.neg, "P_13"),
    "a share of V": ((2, 2), {}, "V_Theta", lambda value: 2 * value, "V_Theta d1_hat"),
    "a weight in V": ((2, 2), {}, "V_z", swapped("input_scale", 1), "energy"),
    "the prediction error": ((2, 2), {"squares": True}, "prediction_error", operator.neg, "prediction_error"),
    "the law of least squares": (
        (2, 2),
        {"squares": True},
        "v",
        swapped("d1_hat_dot", 0),
        "z2'",
    ),
    "the gain matrix's rate": (
        (2, 2),
        {"squares": True, "ranged": False},
        "Gamma12_dot",
        lambda value: value / 2,
        "identifier",
    ),
}


@pytest.mark.parametrize("mutant", EQUATIONS)
def test_a_wrong_equation_leaves_a_remainder(derived: Callable[..., Derivation], mutant: str) -> None:
    order, variant, name, change, caught = EQUATIONS[mutant]
    assert caught in broken(changed(derived(*order, **variant), name, change))


METHODS: dict[str, tuple[tuple[int, int], dict[str, Any], list[tuple[object, str, object]], str]] = {
    "no double sum": ((3, 3), {}, [(Tuning, "_paid", lambda *_: sp.Integer(0))], "energy"),
    "alpha_1 z_1 left in the tuning function of b_m": (
        (2, 2),
        {"inverse": True},
        [(Tuning, "_excess", lambda *_: sp.Integer(0))],
        "energy",
    ),
    "the same, rho = 1": (
        (1, 1),
        {"inverse": True},
        [(Tuning, "_excess", lambda *_: sp.Integer(0))],
        "energy",
    ),
    "a tuning function without the weights of V": (
        (2, 2),
        {},
        [(tuning, "weighted", lambda step, i: sensitivity(step, i) * step.signals.z[i - 1])],
        "energy",
    ),
    "a tuning function with the other sign": (
        (3, 3),
        {},
        [(tuning, "weighted", lambda step, i: -weighted(step, i))],
        "energy",
    ),
    "sign of rho_hat's rate, counted on by the law": (
        (2, 2),
        {"inverse": True},
        [(module, "inverse_pull", lambda *args: -inverse_pull(*args)) for module in (tuning, adaptive_law)],
        "energy",
    ),
    "leakage away from the prior": (
        (2, 2),
        {},
        [(Tuning, "_leak", lambda self, entry: LEAKAGE * (entry.prior_symbol - entry.estimate))],
        "energy",
    ),
}


@pytest.mark.parametrize("mutant", METHODS)
def test_a_wrong_design_leaves_a_remainder(
    builder: Callable[..., Model], mutant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the law counts on is changed with it, so that every error's rate is as claimed."""
    order, variant, patches, caught = METHODS[mutant]
    for place, name, value in patches:
        monkeypatch.setattr(place, name, value)
    found = broken(derive(adaptive(builder(*order), **variant)))
    assert found == [caught, "certificate"]


def test_gains_are_taken_to_be_greater_than_zero(derived: Callable[..., Derivation]) -> None:
    """Then the sign that excludes a gain of 0 from V is 1."""
    value = derived(2, 2).equations["V_Theta"].expression
    assert value.atoms(sp.sign) and not moving_gains(value).atoms(sp.sign)


def test_a_remainder_is_shown_in_the_names_of_the_law() -> None:
    x, y = S("x"), S("y")
    one = sp.Integer(1)
    assert remainder((x + y) ** 3 - x**3 - y**3 - 3 * x * y * (x + y), one) == 0
    assert remainder((x + y) ** 2 - x**2 - y**2, one) == 2 * x * y
    assert remainder(1 / (x - y) + 1 / (y - x), one) == 0
    assert remainder(1 / (1 + 1 / x) - x / (1 + x), one) == 0
    assert remainder(x / (1 + 1 / (x + y)) - x, one) != 0
    assert remainder(sp.exp(x) * sp.exp(-y) - sp.exp(x - y), one) == 0
    assert remainder(sp.sin(x) ** 2 - sp.sin(x) * sp.sin(y), one) != 0
