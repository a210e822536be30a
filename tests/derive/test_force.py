"""A muscle's force split into gain and passive part, and its torque by virtual work, on drawn forces."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive.balance import Balance
from pmjoint_derive.force import CONTRACTION, PRESSURE, attached, split
from pmjoint_derive.joint import reduce_joint
from pmjoint_derive.muscle import ANGLE, paper_pair

P, EPS = PRESSURE, CONTRACTION
S = real_symbol
NUMBERS = {
    "J": 0.05, "b_v": 0.109, "r": 0.015, "l0": 0.185, "eps0": 0.15, "C1": 0.8, "k0": 1e5, "u0": 2.5,
    "k_u": 1e5, "P_max": 5e5, "u_max": 4.0,
}  # fmt: skip
PAPER = P * (S("C1") * EPS**2 + S("C2") * EPS + S("C3")) + S("C4")

coefficients = st.integers(-9, 9).map(lambda n: sp.Rational(n, 4))
shapes = st.sampled_from(
    [
        EPS,
        EPS**2,
        sp.exp(-2 * EPS),
        sp.cos(EPS),
        1 / (2 + EPS),
        sp.tanh(EPS),
        sp.sqrt(1 + EPS**2),
        S("C1") * EPS,
    ]
)
parts = st.tuples(coefficients, shapes, coefficients).map(lambda part: part[0] * part[1] + part[2])


@settings(max_examples=60, deadline=None)
@given(gain=parts.filter(lambda part: part != 0), passive=parts, factor=shapes)
def test_a_drawn_force_is_split_exactly(gain: sp.Expr, passive: sp.Expr, factor: sp.Expr) -> None:
    """However it is written: multiplied out or as a product."""
    for written in (P * gain + passive, (P * gain + passive) * factor):
        found = split(written)
        assert not (found.gain.free_symbols | found.passive.free_symbols) & {P}
        assert sp.simplify(P * found.gain + found.passive - written) == 0


@settings(max_examples=40, deadline=None)
@given(
    gain=parts, bent=st.sampled_from([P**2, sp.sqrt(P), P * sp.exp(-P), sp.sin(P), 1 / (1 + P)]), by=shapes
)
def test_a_drawn_force_that_bends_in_the_pressure_is_refused(
    gain: sp.Expr, bent: sp.Expr, by: sp.Expr
) -> None:
    with pytest.raises(OutsideClassError, match=r"not affine in P: the term .* is not; linearise it"):
        split(P * gain + by * bent)


def test_the_message_names_the_term() -> None:
    with pytest.raises(OutsideClassError, match=r"the term P\*\*2\*eps is not"):
        split(P * EPS + EPS * P**2 + 3)


@pytest.mark.parametrize(
    ("force", "gain", "passive"),
    [((P + 1) ** 2 - P**2, 2, 1), ((P**2 + P) / P, 1, 1), (P * (1 + EPS) - P, EPS, 0)],
)
def test_powers_that_cancel_are_affine(force: sp.Expr, gain: sp.Expr, passive: sp.Expr) -> None:
    found = split(force)
    assert (sp.expand(found.gain - gain), sp.expand(found.passive - passive)) == (0, 0)


def test_a_force_without_pressure_is_refused() -> None:
    with pytest.raises(OutsideClassError, match="does not depend on P"):
        split(S("C1") * EPS)


def test_the_paper_s_law_written_out_gives_the_paper_s_pair() -> None:
    force, r, l0, eps0 = split(PAPER), S("r"), S("l0"), S("eps0")
    for side, expected in zip((1, -1), paper_pair(), strict=True):
        found = attached(force, r, eps0, l0, side, "joint.r").pull
        assert sp.expand(found.gain - expected.gain) == 0
        assert sp.expand(found.passive - expected.passive) == 0


@settings(max_examples=30, deadline=None)
@given(
    arm=st.sampled_from([S("r"), S("r") * sp.cos(ANGLE), S("r") * (2 + ANGLE - ANGLE**2)]),
    gain=parts.filter(lambda part: part != 0),
    passive=parts,
    side=st.sampled_from([1, -1]),
)
def test_torque_and_contraction_obey_virtual_work(
    arm: sp.Expr, gain: sp.Expr, passive: sp.Expr, side: int
) -> None:
    """F dl = -T dtheta: force times the muscle's shortening is torque times the rotation."""
    muscle = attached(split(P * gain + passive), arm, S("eps0"), S("l0"), side, "joint.r1")
    shortening = S("l0") * sp.diff(muscle.contraction, ANGLE)
    torque = muscle.pull.gain * P + muscle.pull.passive
    assert sp.simplify(torque - muscle.tension(P) * shortening) == 0
    assert muscle.contraction.xreplace({ANGLE: sp.Integer(0)}) == S("eps0")


@settings(max_examples=25, deadline=None)
@given(
    gains=st.tuples(parts, parts),
    passives=st.tuples(parts, parts),
    arm=st.sampled_from([S("r"), S("r") * sp.cos(ANGLE), S("r") * (2 + ANGLE - ANGLE**2)]),
    keep=st.sampled_from([(), ("damping",), ("gain",), ("damping", "gain")]),
    angle=st.floats(-0.8, 0.8),
    speed=st.floats(-2.0, 2.0),
    v=st.floats(-9.0, 9.0),
)
def test_design_and_disturbance_make_up_a_drawn_joint(
    gains: tuple[sp.Expr, sp.Expr],
    passives: tuple[sp.Expr, sp.Expr],
    arm: sp.Expr,
    keep: tuple[str, ...],
    angle: float,
    speed: float,
    v: float,
) -> None:
    """The rate of x2 of the class with its D is that of the torques in plain numbers, clipped or not."""
    point = {S(name): value for name, value in NUMBERS.items()}
    muscles = [
        attached(split(P * gain + passive), arm, S("eps0"), S("l0"), side, "joint.r1")
        for gain, passive, side in zip(gains, passives, (1, -1), strict=True)
        if gain != 0
    ]
    assume(len(muscles) == 2)
    first, second = muscles
    balance = Balance((first.pull, second.pull))
    assume(abs(float(balance.gain.subs(point).subs({ANGLE: 0}))) > 1e-3)
    joint = reduce_joint(keep, balance, lagged=False, limits=(-S("u_max"), S("u_max")))
    a = NUMBERS["b_v"] / NUMBERS["J"] if "damping" in keep else 0.0
    point |= {item.symbol: float(item.expression.subs(point)) for item in joint.constants}
    point |= {S("y"): angle, S("x1"): angle, S("x2"): speed + a * angle, S("v"): v}
    point |= {item.symbol: float(item.value.subs(point)) for item in joint.channels}
    plant = joint.plant
    found = plant.phi[1] + plant.b[0] * plant.sigma * S("u") + plant.disturbance[1]
    found += sum((entry * th for entry, th in zip(plant.Phi[1], plant.theta, strict=True)), sp.Integer(0))

    torque = -NUMBERS["b_v"] * speed
    for muscle, name, side in zip(muscles, ("p1", "p2"), (1, -1), strict=True):
        pressure = NUMBERS["k0"] * NUMBERS["u0"] + side * point[S(name)]
        here = {**point, ANGLE: angle, P: pressure}
        torque += float((muscle.lever * muscle.tension(P)).subs(here))
    expected = torque / NUMBERS["J"] + a * speed
    assert float(found.subs(point)) == pytest.approx(expected, rel=1e-9, abs=1e-7 * max(1.0, abs(expected)))
