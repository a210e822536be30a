"""The joint (1)-(4) reduced to the plant class, against the physics typed once more in numbers."""

from __future__ import annotations

import math
import random
from functools import cache

import pytest
import sympy as sp

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive.balance import Balance, coefficients
from pmjoint_derive.joint import Joint, reduce_joint
from pmjoint_derive.muscle import Pair, Pull, paper_pair

S = real_symbol
NUMBERS = {
    "J": 0.05, "b_v": 0.109, "r": 0.015, "l0": 0.185, "eps0": 0.15, "C1": 8.032e-3, "C2": -1.285e-2,
    "C3": 3.2e-3, "C4": 7.0, "k0": 1e5, "u0": 2.5, "k_u": 1e5, "P_max": 5e5, "tau": 0.08, "u_max": 4.0,
    "mgl": 4.7, "Fc": 0.3,
}  # fmt: skip
THETA, OMEGA, T = S("theta"), S("theta_dot"), S("t")
FURTHER = {
    "torque": -S("mgl") * sp.sin(THETA),
    "friction": -S("Fc") * sp.sign(OMEGA) - OMEGA**3 / 50,
    "disturbance": sp.Rational(1, 5) * sp.sin(T) * (1 + THETA * OMEGA),
}
# A pair that is not the paper's: unequal radii, an exponential law of force, and a moment arm that varies.
UNEQUAL = (
    Pull(sp.Rational(1, 100) * sp.exp(-THETA / 3), -sp.Rational(1, 5) * sp.tanh(THETA) - 1),
    Pull(-sp.Rational(1, 80) * (1 + THETA / 5) * sp.cos(THETA), sp.Rational(3, 2)),
)
STEADY = (Pull(S("r") / 10, -THETA), Pull(-S("r") / 12, -(THETA**3) / 7))  # a constant gain
PAIRS: dict[str, Pair] = {"paper": paper_pair(), "unequal": UNEQUAL, "steady": STEADY}
KEPT = [
    ((), False), (("damping",), False), (("quadratic_gain",), False), (("damping", "gain"), False),
    (("torque",), False), (("damping", "torque", "quadratic_gain"), False),
    ((), True), (("damping", "torque"), True), (("gain",), True), (("pressure_lag",), True),
    (("damping", "pressure_lag"), True), (("damping", "torque", "pressure_lag"), True),
]  # fmt: skip
CASES = [(pair, keep, lagged) for pair in PAIRS for keep, lagged in KEPT]


@cache
def reduced(keep: tuple[str, ...], lagged: bool, pair: str = "paper") -> Joint:
    balance = Balance(PAIRS[pair], **FURTHER)
    return reduce_joint(keep, balance, lagged=lagged, limits=(-S("u_max"), S("u_max")))


def clip(value: float, lower: float, upper: float) -> float:
    return min(max(value, lower), upper)


def pulls(pair: str, theta: float, P1: float, P2: float) -> float:
    """Both muscles' torque in plain numbers."""
    n = NUMBERS
    if pair == "unequal":
        first = 0.01 * math.exp(-theta / 3) * P1 - 0.2 * math.tanh(theta) - 1
        return first - 0.0125 * (1 + theta / 5) * math.cos(theta) * P2 + 1.5
    if pair == "steady":
        return n["r"] / 10 * P1 - theta - n["r"] / 12 * P2 - theta**3 / 7

    def force(P: float, eps: float) -> float:
        return P * (n["C1"] * eps**2 + n["C2"] * eps + n["C3"]) + n["C4"]

    stretch = n["r"] * theta / n["l0"]
    return n["r"] * (force(P1, n["eps0"] + stretch) - force(P2, n["eps0"] - stretch))


def physics(pair: str, t: float, theta: float, speed: float, P1: float, P2: float) -> float:
    """The joint's acceleration in plain numbers."""
    n = NUMBERS
    gravity = -n["mgl"] * math.sin(theta)
    friction = -n["Fc"] * math.copysign(1, speed) - speed**3 / 50
    disturbance = 0.2 * math.sin(t) * (1 + theta * speed)
    return (-n["b_v"] * speed + pulls(pair, theta, P1, P2) + gravity + friction + disturbance) / n["J"]


def test_coefficients_are_those_of_8_corrected() -> None:
    """d1 and b0 as measured benches have them: about -127 1/s^2 and 87 rad/s^2 per bar."""
    found = coefficients(paper_pair())
    values = {name: float(item.subs({S(k): v for k, v in NUMBERS.items()})) for name, item in found.items()}
    assert values["d1"] == pytest.approx(-127, abs=0.5)
    assert values["b0"] == pytest.approx(87.2, abs=0.05)
    k0, u0, k_u, r, J = map(S, ("k0", "u0", "k_u", "r", "J"))
    C1, C2, C3, eps0, l0 = map(S, ("C1", "C2", "C3", "eps0", "l0"))
    assert sp.simplify(found["d1"] - 2 * k0 * u0 * r**2 * (2 * C1 * eps0 + C2) / l0 / J) == 0
    assert sp.simplify(found["b0"] - 2 * k_u * r * (C1 * eps0**2 + C2 * eps0 + C3) / J) == 0
    assert sp.simplify(found["b0"] * found["kappa"] - 2 * k_u * r * C1 * (r / l0) ** 2 / J) == 0
    assert sp.simplify(found["a"] - S("b_v") / J) == 0


def values_at(joint: Joint, constants: dict[sp.Symbol, float], v: float) -> dict[sp.Symbol, float]:
    """Everything that D depends on, with what the actuator delivers for v and what is reported."""
    values = dict(constants)
    for channel in joint.channels:
        lower, upper = (float(item.subs(values)) for item in (channel.lower, channel.upper))
        values[channel.symbol] = clip(float((channel.offset + channel.slope * v).subs(values)), lower, upper)
    for item in joint.reported:
        values[item.symbol] = float(item.expression.subs(values))
    return values


@pytest.mark.parametrize(("pair", "keep", "lagged"), CASES)
@pytest.mark.parametrize("v", [-2.2, 9.0])
def test_simulated_plant_is_the_full_physics(
    pair: str, keep: tuple[str, ...], lagged: bool, v: float
) -> None:
    """Physical rates, mapped to the design's coordinates, are the class plus D: clipped or not."""
    joint, n = reduced(keep, lagged, pair), NUMBERS
    plant, generator = joint.plant, random.Random(f"{keep}{lagged}{v}")
    t, theta, speed = generator.uniform(0, 6), generator.uniform(-1, 1), generator.uniform(-2, 2)
    P0 = n["k0"] * n["u0"]
    u = clip(v, -n["u_max"], n["u_max"])
    commands = clip(P0 + n["k_u"] * u, 0, n["P_max"]), clip(P0 - n["k_u"] * u, 0, n["P_max"])
    P = tuple(generator.uniform(1e5, 4e5) for _ in range(2)) if lagged else commands
    acceleration = physics(pair, t, theta, speed, P[0], P[1])
    P_rates = tuple((c - p) / n["tau"] for c, p in zip(commands, P, strict=True)) if lagged else (0.0, 0.0)

    a = n["b_v"] / n["J"] if "damping" in keep else 0.0
    values: dict[sp.Symbol, float] = {S(name): value for name, value in n.items()}
    values |= {S(name): float(item.subs(values)) for name, item in coefficients(PAIRS[pair]).items()}
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
    values = values_at(joint, values | {S("y"): theta, T: t}, v)
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
    assert {item.name: item.number for item in reduced((), False, "unequal").constants} == {"b0": ""}


def test_the_paper_pair_keeps_its_record_beside_further_terms() -> None:
    """d1 stays in Phi, and a kept torque alone is in phi."""
    plant = reduced(("torque",), lagged=False).plant
    y = S("y")
    assert (plant.Phi, plant.theta, plant.sigma) == (((0,), (y,)), (S("d1"),), 1)
    assert plant.phi == (0, -S("mgl") * sp.sin(y) / S("J"))


@pytest.mark.parametrize("pair", PAIRS)
def test_nothing_is_left_out_when_all_is_kept_and_nothing_clips(pair: str) -> None:
    """D is friction and disturbance only; for muscles in general that needs no algebra."""
    joint = reduced(("damping", "torque", "gain"), False, pair)
    unclipped = {S("p1"): S("k_u") * S("u"), S("p2"): S("k_u") * S("u")}
    rest = joint.plant.disturbance[1].xreplace(unclipped)
    speed = {THETA: S("x1"), OMEGA: S("x2") - S("a") * S("x1")}
    difference = rest - (FURTHER["friction"] + FURTHER["disturbance"]).xreplace(speed) / S("J")
    if pair == "paper":
        named = {S(name): item for name, item in coefficients(PAIRS[pair]).items() if name != "a"}
        difference = sp.expand(difference.xreplace(named))
    assert joint.plant.disturbance[0] == 0
    assert sp.simplify(difference) == 0


def test_a_constant_gain_and_a_kept_lag_leave_out_only_unequal_pressures() -> None:
    """By hand: D2 = (g1 + g2)(q1 - q2)/(2 J), where g1, g2 are torques per pressure; it is 0 for q1 = q2."""
    joint = reduce_joint(
        ("damping", "gain", "pressure_lag"), Balance(STEADY), lagged=True, limits=(-S("u_max"), S("u_max"))
    )
    q1, q2, tau, b0 = map(S, ("q1", "q2", "tau", "b0"))
    surplus = (S("r") / 10 - S("r") / 12) * (q1 - q2) / 2 / S("J")
    missing = b0 * ((S("p1") + S("p2")) / (2 * S("k_u")) - S("u")) / tau
    for found, expected in zip(joint.plant.disturbance, (0, surplus, surplus / tau + missing), strict=True):
        assert sp.expand(found - expected) == 0
    assert joint.plant.sigma == 1


@pytest.mark.parametrize(
    ("keep", "lagged", "reason"),
    [
        (("friction",), False, "nothing that a design can keep"),
        (("pressure_lag",), False, "no time constant"),
        (("quadratic_gain", "pressure_lag"), True, "not measured"),
        (("gain", "pressure_lag"), True, "not measured"),
    ],
)
def test_refusals(keep: tuple[str, ...], lagged: bool, reason: str) -> None:
    with pytest.raises(OutsideClassError, match=reason):
        reduced(keep, lagged)
