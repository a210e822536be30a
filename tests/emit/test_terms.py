"""Sums in the order in which their terms become known."""

from __future__ import annotations

import math

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.emit.terms import QUOTIENT, Term, number, total


def symbols(count: int) -> ca.SX:
    return ca.SX.sym("a", count)


@given(st.lists(st.tuples(st.integers(0, 9), st.booleans()), min_size=1, max_size=12))
def test_a_sum_is_the_sum_and_no_order_of_additions_ends_sooner(drawn: list[tuple[int, bool]]) -> None:
    a = symbols(len(drawn))
    terms = [Term(a[i], ready) for i, (ready, _) in enumerate(drawn)]
    plus = [term for term, (_, positive) in zip(terms, drawn, strict=True) if positive]
    minus = [term for term, (_, positive) in zip(terms, drawn, strict=True) if not positive]
    found = total(plus, minus)
    values = [2.0**i for i in range(len(drawn))]  # every subset has a sum of its own
    wanted = sum(v if positive else -v for v, (_, positive) in zip(values, drawn, strict=True))
    assert float(ca.Function("f", [a], [found.value])(values)) == wanted
    # A tree of additions with leaves at these depths has the height log2 of the sum of 2^ready, rounded up.
    assert found.ready == math.ceil(math.log2(sum(2**ready for ready, _ in drawn)))


def test_what_is_zero_is_left_out_and_no_terms_are_zero() -> None:
    a = Term(symbols(1), 3)
    assert total([number(0.0), a]) is a
    assert total([]).zero


def test_numbers_are_known_at_once_and_quotients_take_longer() -> None:
    a, b = Term(symbols(1), 3), Term(symbols(1), 5)
    assert (number(2.0) * number(3.0)).ready == 0
    assert (a * b).ready == 6
    assert (a / b).ready == 5 + QUOTIENT
    assert a.over(b).ready == 5 + QUOTIENT + 1


@pytest.mark.parametrize("x", [0.3, -2.0])
def test_arithmetic_is_that_of_the_values(x: float) -> None:
    a = symbols(1)
    term = Term(a)
    for found, wanted in (
        (term + term, 2 * x),
        (term - term.times(3.0), x - 3 * x),
        (-term, -x),
        (term.over(number(4.0)), x * (1 / 4)),
        (term.apply(ca.sin), math.sin(x)),
    ):
        assert float(ca.Function("f", [a], [found.value])(x)) == wanted
