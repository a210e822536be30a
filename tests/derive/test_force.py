"""A muscle's force split into gain and passive part, and its torque by virtual work, on drawn forces."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive.force import CONTRACTION, PRESSURE, attached, split
from pmjoint_derive.muscle import ANGLE, paper_pair

P, EPS = PRESSURE, CONTRACTION
S = real_symbol
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
