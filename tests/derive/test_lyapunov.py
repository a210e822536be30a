"""The certificate's identities hold for every member of the class, and V' is what they say at any point."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import sympy as sp

from derive import Derivation, Model, derive, parameter_symbol
from derive.consistency import consistency_identities
from derive.lyapunov import expand_to_zero, lyapunov_matrix, prove, squares

S = parameter_symbol


def test_every_identity_expands_to_zero_in_every_order(derivation: Derivation) -> None:
    identities = (*prove(derivation), *consistency_identities(derivation))
    assert [item.name for item in identities if not item.holds] == []
    assert len({item.name for item in identities}) == len(identities)


def test_the_papers_lyapunov_matrix(paper: Derivation) -> None:
    P = lyapunov_matrix(paper.signals).subs({S("k1"): 6, S("k2"): 8})
    assert sp.Matrix([[sp.Rational(3, 2), -1], [-1, sp.Rational(15, 16)]]) == P


def test_what_the_certificate_gives_away_is_squares(paper: Derivation) -> None:
    s2 = S("dalpha1_dy")
    for square in squares(paper, lyapunov_matrix(paper.signals), (sp.Integer(-1), s2)):
        root = sp.sqrt(square.subs({S("e1"): 1, S("e2"): 1, S("k1"): 6, S("k2"): 8}))
        assert sp.expand(root**2 - square.subs({S("e1"): 1, S("e2"): 1, S("k1"): 6, S("k2"): 8})) == 0
        assert root.is_real


def test_expansion_sees_through_quotients_by_sigma() -> None:
    y, a = S("y"), S("a")
    sigma = 1 + a * y**2
    assert expand_to_zero((a + y) / sigma * sigma - a - y, sigma) == 0
    assert expand_to_zero(1 / (1 + y) - (1 - y) / (1 - y**2), sp.Integer(1)) == 0
    assert expand_to_zero(1 / sigma - 1, sigma) != 0


@pytest.mark.parametrize("order", [(1, 1), (3, 3)])
def test_an_identity_that_fails_shows_what_is_left(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    derivation = derive(builder(*order))
    gain = derivation.signals.c[0]
    left = expand_to_zero(derivation.expanded("z1") * gain, sp.Integer(1))
    assert gain in left.free_symbols
