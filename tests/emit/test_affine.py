"""Linear combinations multiplied out: the same values, fewer operations."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.emit.affine import (
    MODULUS,
    Combination,
    Factor,
    factor,
    inverse,
    one,
    residue_named,
    residue_of,
    shortest,
    unit,
)
from pmjoint_codegen.emit.terms import Term, number

LEAVES = 4


def constant(value: float) -> Factor:
    return factor(residue_of(value), number(value))


def expanded(forms: Mapping[int, Combination], name: int) -> list[int]:
    """Residues of the factors of the leaves in a combination."""
    result = [0] * LEAVES
    for part, times in forms[name].items():
        inner = expanded(forms, part) if part in forms else [int(i == part) for i in range(LEAVES)]
        result = [(a + times.residue * b) % MODULUS for a, b in zip(result, inner, strict=True)]
    return result


def operations(forms: Mapping[int, Combination]) -> int:
    products = {
        (part, min(f.residue, MODULUS - f.residue))
        for form in forms.values()
        for part, f in form.items()
        if not unit(f.residue)
    }
    return len(products) + sum(max(len(form) - 1, 0) for form in forms.values())


FACTORS = st.sampled_from([1.0, -1.0, 2.0, 0.5, -3.0])


@st.composite
def programs(draw: st.DrawFn) -> tuple[dict[int, Combination], list[int]]:
    """Combinations of four leaves and of one another, and which of them are asked for."""
    forms: dict[int, Combination] = {}
    for name in range(LEAVES, LEAVES + draw(st.integers(1, 10))):
        parts = draw(st.sets(st.integers(0, name - 1), min_size=1, max_size=3))
        forms[name] = {part: constant(draw(FACTORS)) for part in sorted(parts)}
    needed = draw(st.sets(st.sampled_from(sorted(forms)), min_size=1))
    return forms, sorted(needed)


@given(programs())
def test_needed_combinations_keep_their_values_and_nothing_costs_more(
    program: tuple[dict[int, Combination], list[int]],
) -> None:
    forms, needed = program
    kept = shortest(forms, needed)
    assert set(needed) <= set(kept) <= set(forms)
    for name in needed:
        assert expanded(kept, name) == expanded(forms, name)
    assert operations(kept) <= operations(forms)


@given(programs())
def test_the_terms_of_the_factors_compute_them(program: tuple[dict[int, Combination], list[int]]) -> None:
    for form in shortest(*program).values():
        for found in form.values():
            assert residue_of(found.sign * float(found.term.value)) == found.residue


def test_a_chain_that_is_used_once_disappears() -> None:
    half = constant(0.5)
    forms = {4: {0: half, 1: one()}, 5: {4: half, 2: one()}, 6: {5: half, 0: -one()}}
    kept = shortest(forms, [6])
    assert list(kept) == [6] and set(kept[6]) == {0, 1, 2}


def test_what_cancels_identically_is_left_out() -> None:
    p, q = (factor(residue_named(name), Term(ca.SX.sym(name))) for name in "pq")
    forms = {4: {0: p * q, 1: one()}, 5: {4: one(), 0: -(q * p)}}
    assert set(shortest(forms, [5])[5]) == {1}


def test_a_shared_expensive_sum_stays() -> None:
    names = [residue_named(i) for i in range(7)]
    factors = [factor(name, number(1.0)) for name in names]
    forms = {4: {0: factors[0], 1: factors[1], 2: factors[2]}}
    forms |= {5 + i: {4: factors[3 + i]} for i in range(4)}
    assert 4 in shortest(forms, [5, 6, 7, 8])


@pytest.mark.parametrize("value", [3.0, -0.1, 1e-300, 2.0**70])
def test_residues_follow_arithmetic(value: float) -> None:
    residue = residue_of(value)
    assert residue * inverse(residue) % MODULUS == 1
    assert residue_of(-value) == -residue % MODULUS
    assert residue_of(2 * value) == 2 * residue % MODULUS
    assert unit(residue_of(1.0)) and unit(residue_of(-1.0)) and not unit(residue)


def test_signs_cost_nothing() -> None:
    a = factor(residue_named("a"), Term(ca.SX.sym("a")))
    negative = -a
    assert negative.term is a.term and negative.sign == -1
    assert (one() * negative).term is a.term
    difference = a + -factor(residue_named("b"), Term(ca.SX.sym("b")))
    values = ca.Function("f", ca.symvar(difference.term.value), [difference.term.value])
    assert difference.sign * float(values(5.0, 3.0)) == 2.0
    assert not (a + -a).residue


def test_inverse_of_zero_is_not_taken_for_a_number() -> None:
    assert inverse(0) not in {residue_of(float(value)) for value in np.arange(-5, 6)}


def test_what_adds_up_to_one_is_one() -> None:
    p = factor(residue_named("p"), Term(ca.SX.sym("p")))
    found = (one() + p) + -p
    assert found.unit and float(found.term.value) == 1.0 and found.sign == 1
