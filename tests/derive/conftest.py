"""Models of the class in many orders, built directly so that these tests need no model file."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Gains, Model, Parameter, Plant, Simulation, derive, real_symbol

S = real_symbol
ORDERS = ((1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 4))  # (n, rho)


def build(n: int, rho: int, *, nonlinear: bool = True) -> Model:
    """A member of the class with every feature: phi, Phi, sigma, zeros, a disturbance on each state."""
    y, d1, b0 = S("y"), S("d1"), S("b0")
    zero, m = sp.Integer(0), n - rho
    phi = tuple([-(y**3) / 5, sp.sin(y), y**2 / 7, sp.cos(y)][i] if nonlinear else zero for i in range(n))
    Phi = tuple((y if i == n - 1 else zero, y**2 if nonlinear and i == 0 else zero) for i in range(n))
    b = (b0, *[sp.Integer(2 + i) for i in range(m)])
    sigma = 1 + y**2 / 10 if nonlinear else sp.Integer(1)
    disturbance = tuple(sp.Rational(1, 10) * sp.sin(S(f"x{i + 1}")) * sp.cos(S("t")) for i in range(n))
    plant = Plant(n, phi, Phi, (d1, sp.Rational(1, 3)), b, sigma, disturbance)
    parameters = (
        Parameter("d1", 0.2, "1/s^2", ""),
        Parameter("b0", 2.0, "rad/(s^2 V)", ""),
        Parameter("u_max", 10.0, "V", ""),
    )
    gains = Gains(
        (3.0,) * rho, (0.1,) * rho, (1.0,) * rho, tuple(sp.binomial(n, i) * 2.0**i for i in range(1, n + 1))
    )
    run = Simulation((0.5,) + (0.0,) * (n - 1), 1.0, 0.1, 0.01)
    return Model(f"n{n}rho{rho}", "", "", parameters, plant, S("u_max"), sp.sin(S("t")), gains, run, 0.1)


@pytest.fixture(scope="session", params=ORDERS, ids=lambda order: f"n{order[0]}rho{order[1]}")
def derivation(request: pytest.FixtureRequest) -> Derivation:
    """A derivation for each pair (n, rho), with nonlinear phi, Phi and sigma."""
    return derive(build(*request.param))


@pytest.fixture(scope="session")
def builder() -> Callable[..., Model]:
    """Make a model of a given order."""
    return build


@pytest.fixture(scope="session")
def paper() -> Derivation:
    """The paper's model (11), (36), (37)."""
    y, zero = S("y"), sp.Integer(0)
    disturbance = (zero, sp.Rational(1, 10) * sp.sin(S("x2")) * sp.cos(S("t")))
    plant = Plant(2, (zero, zero), ((zero,), (y,)), (S("d1"),), (S("b0"),), sp.Integer(1), disturbance)
    parameters = (
        Parameter("d1", 0.2, "1/s^2", ""),
        Parameter("b0", 2.0, "rad/(s^2 V)", ""),
        Parameter("u_max", 10.0, "V", ""),
    )
    gains = Gains((15.0, 15.0), (0.1, 0.1), (1.0, 1.0), (6.0, 8.0))
    run = Simulation((1.5, 0.0), 20.0, 0.01, 0.001)
    return derive(Model("paper", "", "", parameters, plant, S("u_max"), sp.sin(S("t")), gains, run, 0.1))
