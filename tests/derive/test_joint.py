"""The joint (1)-(4) reduced to the plant class, against the physics typed once more in numbers."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive.balance import Balance, coefficients
from pmjoint_derive.joint import Joint, reduce_joint
from pmjoint_derive.muscle import paper_pair

S = real_symbol
NUMBERS = {
    "J": 0.05, "b_v": 0.109, "r": 0.015, "l0": 0.185, "eps0": 0.15, "C1": 8.032e-3, "C2": -1.285e-2,
    "C3": 3.2e-3, "C4": 7.0, "k0": 1e5, "u0": 2.5, "k_u": 1e5, "P_max": 5e5, "tau": 0.08, "u_max": 4.0,
}  # fmt: skip
CASES = [
    ((), False), (("damping",), False), (("quadratic_gain",), False), (("damping", "quadratic_gain"), False),
    ((), True), (("damping",), True), (("pressure_lag",), True), (("damping", "pressure_lag"), True),
]  # fmt: skip


def reduced(keep: tuple[str, ...], lagged: bool) -> Joint:
    balance = Balance(disturbance=sp.Rational(1, 5) * sp.sin(S("t")))
    return reduce_joint(keep, balance, lagged=lagged, limits=(-S("u_max"), S("u_max")))


def clip(value: float, lower: float, upper: float) -> float:
    return min(max(value, lower), upper)


def physics(theta: float, speed: float, P1: float, P2: float, vartheta: float) -> float:
    """The joint's acceleration, (1)-(3) in plain numbers."""
    n = NUMBERS

    def force(P: float, eps: float) -> float:
        return P * (n["C1"] * eps**2 + n["C2"] * eps + n["C3"]) + n["C4"]

    stretch = n["r"] * theta / n["l0"]
    torque = n["r"] * (force(P1, n["eps0"] + stretch) - force(P2, n["eps0"] - stretch))
    return (-n["b_v"] * speed + torque + vartheta) / n["J"]


def test_coefficients_are_those_of_8_corrected() -> None:
    """d1 and b0 as measured benches have them: about -127 1/s^2 and 87 rad/s^2 per bar."""
    values = {
        name: float(item.subs({S(k): v for k, v in NUMBERS.items()}))
        for name, item in coefficients(paper_pair()).items()
    }
    assert values["d1"] == pytest.approx(-127, abs=0.5)
    assert values["b0"] == pytest.approx(87.2, abs=0.05)
    k0, u0, k_u, r, J = map(S, ("k0", "u0", "k_u", "r", "J"))
    C1, C2, C3, eps0, l0 = map(S, ("C1", "C2", "C3", "eps0", "l0"))
    found = coefficients(paper_pair())
    assert sp.simplify(found["d1"] - 2 * k0 * u0 * r**2 * (2 * C1 * eps0 + C2) / l0 / J) == 0
    assert sp.simplify(found["b0"] - 2 * k_u * r * (C1 * eps0**2 + C2 * eps0 + C3) / J) == 0
    assert sp.simplify(found["b0"] * found["kappa"] - 2 * k_u * r * C1 * (r / l0) ** 2 / J) == 0
    assert sp.simplify(found["a"] - S("b_v") / J) == 0


@pytest.mark.parametrize(("keep", "lagged"), CASES)
@pytest.mark.parametrize("v", [0.7, -2.2, 3.4, 9.0])
def test_simulated_plant_is_the_full_physics(keep: tuple[str, ...], lagged: bool, v: float) -> None:
    """Physical rates, mapped to the design's coordinates, are the class plus D: clipped or not."""
    joint, n = reduced(keep, lagged), NUMBERS
    plant, generator = joint.plant, random.Random(f"{keep}{lagged}{v}")
    t, theta, speed = generator.uniform(0, 6), generator.uniform(-1, 1), generator.uniform(-2, 2)
    P0 = n["k0"] * n["u0"]
    u = clip(v, -n["u_max"], n["u_max"])
    commands = clip(P0 + n["k_u"] * u, 0, n["P_max"]), clip(P0 - n["k_u"] * u, 0, n["P_max"])
    P = tuple(generator.uniform(1e5, 4e5) for _ in range(2)) if lagged else commands
    acceleration = physics(theta, speed, P[0], P[1], vartheta=0.2 * float(sp.sin(t)))
    P_rates = tuple((c - p) / n["tau"] for c, p in zip(commands, P, strict=True)) if lagged else (0.0, 0.0)

    a = n["b_v"] / n["J"] if "damping" in keep else 0.0
    values: dict[sp.Symbol, float] = {S(name): value for name, value in n.items()}
    values |= {S(name): float(item.subs(values)) for name, item in coefficients(paper_pair()).items()}
    w = ((P[0] - P0) + (P0 - P[1])) / 2 / n["k_u"]
    w_rate = (P_rates[0] - P_rates[1]) / 2 / n["k_u"]
    if "pressure_lag" in keep:  # x2 = theta' + (a + 1/tau) theta, x3 = b0 w + theta'/tau + (a/tau) theta
        b0, tau = values[S("b0")], n["tau"]
        x = [theta, speed + (a + 1 / tau) * theta, b0 * w + speed / tau + a / tau * theta]
        x_rates = [
            speed,
            acceleration + (a + 1 / tau) * speed,
            b0 * w_rate + acceleration / tau + a / tau * speed,
        ]
        extra, extra_rates = [P[0] + P[1] - 2 * P0], [P_rates[0] + P_rates[1]]
    else:
        x, x_rates = [theta, speed + a * theta], [speed, acceleration + a * speed]
        extra, extra_rates = ([P[0] - P0, P0 - P[1]], [P_rates[0], -P_rates[1]]) if lagged else ([], [])

    values |= {S(f"x{i}"): value for i, value in enumerate([*x, *extra], start=1)}
    values |= {S("y"): theta, S("t"): t}
    for channel in joint.channels:
        lower, upper = (float(item.subs(values)) for item in (channel.lower, channel.upper))
        values[channel.symbol] = clip(float((channel.offset + channel.slope * v).subs(values)), lower, upper)
    for item in joint.reported:
        values[item.symbol] = float(item.expression.subs(values))
    assert (values[S("P1")], values[S("P2")]) == pytest.approx(P, rel=1e-12)

    following = [*x[1:], 0.0]
    for i in range(plant.order):
        regressor = sum(entry * th for entry, th in zip(plant.Phi[i], plant.theta, strict=True))
        rate = plant.phi[i] + regressor + plant.b_vector[i] * plant.sigma * S("u") + plant.disturbance[i]
        assert following[i] + float(rate.subs(values)) == pytest.approx(x_rates[i], rel=1e-9, abs=1e-9)
    assert [float(item.rate.subs(values)) for item in joint.extras] == pytest.approx(
        extra_rates, rel=1e-9, abs=1e-6
    )


def test_only_the_two_constants_of_8_bear_its_number() -> None:
    numbers = {item.name: item.number for item in reduced(("damping", "quadratic_gain"), False).constants}
    assert numbers == {"d1": "(8)", "b0": "(8)", "a": "(5)", "kappa": ""}


def test_nothing_is_left_out_when_all_is_kept_and_nothing_clips() -> None:
    joint = reduced(("damping", "quadratic_gain"), lagged=False)
    k_u, u = S("k_u"), S("u")
    values = {S(name): item for name, item in coefficients(paper_pair()).items()}
    rest = joint.plant.disturbance[1].subs({S("p1"): k_u * u, S("p2"): k_u * u}).subs(values)
    assert joint.plant.disturbance[0] == 0
    assert sp.simplify(rest - sp.sin(S("t")) / 5 / S("J")) == 0


@pytest.mark.parametrize(
    ("keep", "lagged", "reason"),
    [
        (("friction",), False, "nothing that a design can keep"),
        (("pressure_lag",), False, "no time constant"),
        (("quadratic_gain", "pressure_lag"), True, "not measured"),
    ],
)
def test_refusals(keep: tuple[str, ...], lagged: bool, reason: str) -> None:
    with pytest.raises(OutsideClassError, match=reason):
        reduced(keep, lagged)
