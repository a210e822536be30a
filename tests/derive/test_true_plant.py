"""The plant in parameters of its own: the same plant, a controller that does not see them, (17) as ever."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.modelfile import model_of
from pmjoint_codegen.values import OWN_SUFFIX
from pmjoint_derive import Derivation, Model, Parameter, derive
from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.filters import estimate, filter_matrix, filter_rates
from pmjoint_derive.model import Channel
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.true_plant import SUFFIX, effective_symbol, own_symbol
from tests.derive.adaptive_models import adaptive

MODELS = ("paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order")


@pytest.fixture(scope="module", params=MODELS)
def shipped(request: pytest.FixtureRequest, root: Path) -> Derivation:
    path = root / "models" / f"{request.param}.toml"
    return derive(model_of(tomllib.loads(path.read_text()), str(path)))


def either(derivation: Derivation, symbol: sp.Symbol) -> sp.Symbol:
    """The plant's own equation where it has one."""
    own = own_symbol(symbol)
    return own if own.name in derivation.equations else symbol


def rates(derivation: Derivation) -> list[sp.Expr]:
    """Rates of the true plant, in channels, y and u, all else expanded."""
    s, equations = derivation.signals, derivation.equations
    keep = frozenset({s.y, s.u, *(channel.symbol for channel in derivation.model.actuator)})
    keep |= {own_symbol(symbol) for symbol in keep}
    states = [*s.x, *(extra.symbol for extra in derivation.model.extras)]
    return [
        equations.expand(either(derivation, real_symbol(derivative_name(state))), keep) for state in states
    ]


def agreeing(derivation: Derivation) -> dict[sp.Symbol, sp.Symbol]:
    channels = {own_symbol(channel.symbol): channel.symbol for channel in derivation.model.actuator}
    return {own: shared for shared, own in derivation.own_parameters.items()} | channels


def test_the_controller_clips_v_by_its_own_numbers_alone(builder: Callable[..., Model]) -> None:
    """Whatever the limits of u are made of: u is the controller's, and the plant takes what is applied."""
    d1 = real_symbol("d1")
    u = Channel(real_symbol("u"), sp.Integer(0), sp.Integer(1), -d1, d1, "V", "applied input")
    found = derive(replace(builder(2, 2), channels=(u,)))
    assert sorted(map(str, found.own_parameters)) == ["b0", "d1"]
    assert "x2_dot_plant" in found.equations and "u_plant" not in found.equations


@pytest.mark.parametrize("joint", [False, True])
def test_a_parameter_of_the_reference_alone_has_no_twin(
    builder: Callable[..., Model], root: Path, joint: bool
) -> None:
    """The plant takes u as it comes: no value of its own could change what y_r is made of."""
    path = root / "models" / "joint-lag.toml"
    plain = model_of(tomllib.loads(path.read_text()), str(path)) if joint else builder(2, 2)
    changed = with_amplitude(plain)
    found = derive(changed)
    assert found.own_parameters == derive(plain).own_parameters != {}
    amplitude = changed.parameters[-1]
    torque = amplitude.symbol * sp.cos(real_symbol("t"))
    disturbed = replace(changed.plant, disturbance=(*changed.plant.disturbance[:-1], torque))
    both = derive(replace(changed, plant=disturbed))  # where the plant uses it as well, the two may differ
    assert amplitude.symbol in both.own_parameters


def with_amplitude(model: Model) -> Model:
    """The same with a parameter that only its reference has."""
    amplitude = Parameter("amplitude", 0.3, "rad", "")
    reference = amplitude.symbol * sp.sin(real_symbol("t"))
    return replace(model, parameters=(*model.parameters, amplitude), reference=reference)


@pytest.mark.parametrize("kind", [{}, {"inverse": True}, {"squares": True}, {"unknown": (1,)}])
def test_v_asks_for_no_values_of_the_plants_own(builder: Callable[..., Model], kind: dict[str, Any]) -> None:
    """V holds the errors, and they the reference: its parameters change nothing of the plant."""
    plain = adaptive(builder(2, 2), **kind)
    found = derive(with_amplitude(plain))
    assert found.own_parameters == derive(plain).own_parameters
    for own in found.own_parameters.values():
        assert any(own in rate.free_symbols for rate in rates(found))


def test_the_suffix_is_the_one_that_users_write() -> None:
    assert SUFFIX == OWN_SUFFIX


def test_the_same_values_make_the_same_plant(shipped: Derivation) -> None:
    s, equations = shipped.signals, shipped.equations
    keep = frozenset({s.y, s.u, *(channel.symbol for channel in shipped.model.actuator)})
    states = [*s.x, *(extra.symbol for extra in shipped.model.extras)]
    for state, true in zip(states, rates(shipped), strict=True):
        nominal = equations.expand(equations[derivative_name(state)].expression, keep)
        assert sp.expand(true.xreplace(agreeing(shipped)) - nominal) == 0


def test_neither_side_uses_the_others_values(shipped: Derivation) -> None:
    """No rate of the plant knows what is believed; nothing of the controller knows what is true."""
    s, equations = shipped.signals, shipped.equations
    shared, own = set(shipped.own_parameters), set(shipped.own_parameters.values())
    assert own
    for rate in rates(shipped):
        assert not rate.free_symbols & shared
    names = [s.v.name, *(derivative_name(state) for state in s.controller_state), *map(str, s.y_r)]
    for name in names:
        assert not equations.expand(equations[name].expression).free_symbols & own


def test_all_that_both_use_has_two_values(shipped: Derivation) -> None:
    """Only the limit of u is the controller's alone to apply; the rest of what is shared is told apart."""
    s, equations, model = shipped.signals, shipped.equations, shipped.model
    known = {item.symbol for item in model.parameters}
    controller = [s.v, *(real_symbol(derivative_name(state)) for state in s.controller_state)]
    believed = set().union(*(equations.expand(item).free_symbols for item in controller)) & known
    states = [*s.x, *(extra.symbol for extra in model.extras)]
    physical = set().union(
        *(equations.expand(real_symbol(derivative_name(state))).free_symbols for state in states)
    )
    assert set(shipped.own_parameters) == believed & physical - {model.limit}


def test_the_estimation_error_obeys_17_with_the_effective_disturbance(shipped: Derivation) -> None:
    s, plant, equations = shipped.signals, shipped.plant, shipped.equations
    keep = frozenset({s.y, s.u, *(channel.symbol for channel in shipped.model.actuator)})
    keep |= {own_symbol(symbol) for symbol in keep}
    x_hat = estimate(shipped.plant, shipped.signals)
    filtered = filter_rates(shipped.design).items()
    x_hat_dot = sp.Matrix([
        sum(sp.diff(entry, state) * rate for state, rate in filtered) for entry in x_hat
    ])  # fmt: skip
    x_hat, x_hat_dot = (
        matrix.applyfunc(lambda entry: equations.expand(entry, keep))
        for matrix in (sp.Matrix(x_hat), x_hat_dot)
    )
    effective = [
        effective_symbol(symbol) if effective_symbol(symbol).name in equations else symbol
        for symbol in disturbance_symbols(plant)
    ]
    D = sp.Matrix([equations.expand(symbol, keep) for symbol in effective])
    x_dot = sp.Matrix(rates(shipped)[: plant.order])
    wanted = filter_matrix(s) * (sp.Matrix(s.x) - x_hat) + D
    difference = (x_dot - x_hat_dot - wanted).xreplace({s.y: s.x[0]})
    assert difference.applyfunc(lambda entry: sp.cancel(sp.together(entry))).is_zero_matrix


def test_where_the_values_agree_the_effective_disturbance_is_the_models(shipped: Derivation) -> None:
    equations = shipped.equations
    for symbol in disturbance_symbols(shipped.plant):
        if effective_symbol(symbol).name in equations:
            mismatch = equations.expand(equations[f"mismatch{symbol.name[1:]}"].expression)
            assert mismatch.xreplace(agreeing(shipped)) == 0  # term by term: no rounding either
