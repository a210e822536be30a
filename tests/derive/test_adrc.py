"""The identities of ADRC hold for every order with free functions of y, and fail for a wrong law."""

from __future__ import annotations

from dataclasses import replace

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Gains, Model, Parameter, Plant, Simulation, derive, real_symbol
from pmjoint_derive.consistency import consistency_identities
from pmjoint_derive.equation import Equation, Equations

Y, U_MAX = real_symbol("y"), Parameter("u_max", 1.0, "V", "limit")


def model_of(n: int) -> Model:
    d, b = (Parameter(name, 1.0, "1", "") for name in ("d1", "b0"))
    plant = Plant(
        order=n,
        phi=tuple(sp.sin(i * Y) for i in range(1, n + 1)),
        Phi=tuple((Y**i,) for i in range(1, n + 1)),
        theta=(d.symbol,),
        b=(b.symbol,),
        sigma=2 + sp.cos(Y),
        disturbance=(sp.Integer(0),) * n,
    )
    gains = Gains(c=(2.0,) * n, e=(), ck=(), k=(), compensator=False, observer=9.0)
    run = Simulation((0.0,) * n, 1.0, 0.1, 0.001)
    return Model(
        "m", "", "", (d, b, U_MAX), plant, U_MAX.symbol, sp.sin(real_symbol("t")), gains, run, design="adrc"
    )


def test_the_identities_hold() -> None:
    for n in (1, 2, 3, 4):
        found = derive(model_of(n))
        identities = (*found.design.prove(found), *consistency_identities(found))
        assert [item.name for item in identities if not item.holds] == []
        assert len(found.design.prove(found)) == 3 * n + 2
        assert found.design.certificate(found) == ()


@pytest.mark.parametrize(
    ("name", "wrong", "broken"),
    [
        ("eso2_dot", lambda value: value + real_symbol("eso1"), {"eso2 error", "eso2_next"}),
        ("eso2_next", lambda value: value + real_symbol("eso1"), {"eso2_next"}),
        ("Omega", lambda value: value + real_symbol("eso1"), {"z2'"}),
        ("z2", lambda value: 2 * value, {"z1'", "z2'"}),
        ("v", lambda value: 2 * value, {"z2'"}),
    ],
)
def test_a_wrong_equation_breaks_them(name: str, wrong: object, broken: set[str]) -> None:
    assert callable(wrong)
    found = derive(model_of(2))

    def spoilt(item: Equation) -> Equation:
        return replace(item, expression=wrong(item.expression)) if item.symbol.name == name else item

    equations = Equations([spoilt(item) for item in found.equations.values()])
    derivation = Derivation(found.model, found.design, equations, found.own_parameters)
    assert {item.name for item in found.design.prove(derivation) if not item.holds} == broken


def test_signals_have_the_units_of_derivatives_of_y() -> None:
    units, signals = (found := derive(model_of(2))).units, found.signals
    assert [str(units.of(symbol)) for symbol in signals.xi] == ["rad", "rad/s", "rad/s^2"]
    assert [str(units.of(symbol)) for symbol in signals.z] == ["rad", "rad/s"]
    assert str(units.of(signals.observer[0])) == "1/s"
