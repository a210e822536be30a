"""Verdicts by comparison, on small chains whose truth is plain."""

from __future__ import annotations

from typing import Any

import pytest
import sympy as sp

from pmjoint_codegen.audit.judgement import (
    Verdict,
    is_sum_of_squares,
    judge_lines,
    no_proofs,
    shown,
    vanishes,
    verdict,
)
from pmjoint_codegen.audit.notation import value

a, b, c = sp.symbols("a b c", real=True)


def evaluate(text: str) -> Any:
    return value(text, {"a": a, "b": b, "c": c, "x": sp.Matrix([a, b])})


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        ("(a - b)**2 + 1/(4*c)*b**2", True),
        ("c*(a + b)**2", True),
        ("-1*(a - b)**2", False),
        ("(a - b)**2 - b**2", False),
        ("a*b", True),  # a product of positive gains
        ("a**3", True),  # the same
        ("(a - b)**3", False),
    ],
)
def test_sums_of_squares(text: str, is_one: bool) -> None:
    assert is_sum_of_squares(text, evaluate) is is_one


def test_an_equality_must_vanish() -> None:
    (right, wrong) = judge_lines(("(a + b)**2 = a**2 + 2*a*b + b**2", "a = b"), evaluate, no_proofs())
    assert right.holds
    assert not wrong.holds
    assert wrong.remark == "right - left = -a + b"


def test_an_inequality_needs_its_own_proof() -> None:
    line = ("2*a*b <= a**2 + b**2",)
    assert not judge_lines(line, evaluate, no_proofs())[0].holds
    assert judge_lines(line, evaluate, {(0, 0): "(a - b)**2"})[0].holds
    assert not judge_lines(line, evaluate, {(0, 0): "(a + b)**2"})[0].holds
    assert not judge_lines(line, evaluate, {(0, 0): "a**2 - 2*a*b + b**2"})[0].holds


def test_an_inequality_printed_as_an_equality_is_called_one() -> None:
    (link,) = judge_lines(("2*a*b = a**2 + b**2",), evaluate, {(0, 0): "(a - b)**2"})
    assert not link.holds
    assert "inequality" in link.remark


def test_sizes_that_do_not_fit_are_a_fault() -> None:
    (sum_, sides) = judge_lines(("a = a + x", "x = a"), evaluate, no_proofs())
    assert (sum_.holds, sides.holds) == (False, False)
    assert "do not add up" in sum_.remark
    assert judge_lines(("x - x = 0",), evaluate, no_proofs())[0].holds


def test_large_differences_are_shown_at_a_point() -> None:
    big = sp.expand((a + b + c) ** 12) + a**13 * b**7
    assert "at a = 2, b = 3, c = 5" in shown(big)


def test_verdicts() -> None:
    good = judge_lines(("a = a",), evaluate, no_proofs())
    bad = judge_lines(("a = b",), evaluate, no_proofs())
    assert verdict(good, ()) is Verdict.FOLLOWS
    assert verdict(good, (), Verdict.DEFINITION) is Verdict.DEFINITION
    assert verdict(bad, good) is Verdict.CORRECTED
    assert verdict(bad, bad) is verdict(bad, ()) is Verdict.FAILS


def test_vanishing_is_exact() -> None:
    assert vanishes(sp.Matrix([1 / (a + 1) - 1 / (1 + a), 0]))
    assert not vanishes(sp.Rational(1, 10**40) * a)
