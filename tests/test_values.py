"""The rules that the numbers of a design obey."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.errors import ModelError, UsageError
from pmjoint_codegen.values import Rule, check_rules, check_values, gain_names, is_hurwitz, obeys

PAPER = {
    **{"d1": 0.2, "b0": 2.0, "u_max": 10.0, "c1": 15.0, "c2": 15.0, "e1": 0.1, "e2": 0.1},
    **{"ck1": 1.0, "ck2": 1.0, "k1": 6.0, "k2": 8.0, "compensator": 1.0},
    "input_scale": 1.0,
}


def check(**changes: float) -> None:
    check_values(PAPER | changes, n=2, rho=2, limit="u_max", leading="b0", where="--set", error=UsageError)


def test_the_papers_numbers_pass() -> None:
    check()
    check(d1=-127.0, b0=-2.0, compensator=0)


@pytest.mark.parametrize("name", PAPER)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_every_number_is_finite(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=rf"^--set: {name}: is .*; allowed: a finite number$"):
        check(**{name: value})


@pytest.mark.parametrize("name", ["c1", "c2", "e1", "e2", "ck1", "ck2", "u_max", "input_scale"])
@pytest.mark.parametrize("value", [0.0, -0.0, -1e-300, -3.0])
def test_gains_and_limit_are_positive(name: str, value: float) -> None:
    with pytest.raises(UsageError, match=rf"^--set: {name}: is .*; allowed: a number greater than 0$"):
        check(**{name: value})


def test_b_m_is_not_zero() -> None:
    with pytest.raises(UsageError, match="b0: is 0, so b_m = 0"):
        check(b0=0.0)


def test_the_switch_is_on_or_off() -> None:
    with pytest.raises(UsageError, match=r"compensator: is 0\.5; allowed: 1 \(on\) or 0 \(off\)"):
        check(compensator=0.5)


def test_unstable_filter_gains_are_named_with_their_eigenvalues() -> None:
    with pytest.raises(
        UsageError, match=r"k: leaves A0 .* unstable, eigenvalues -7\.12311, 1\.12311; allowed: k1 > 0"
    ):
        check(k2=-8.0)


def test_marginal_filter_gains_are_unstable() -> None:
    with pytest.raises(UsageError, match=r"eigenvalues 0-2\.82843j, 0\+2\.82843j"):
        check(k1=0.0)


def test_gains_too_large_for_eigenvalues_are_still_judged() -> None:
    with pytest.raises(UsageError, match="unstable"):
        check(k1=-1e308, k2=1e308)
    check(k1=1e-300, k2=1e308)


def test_file_and_key_are_the_callers() -> None:
    with pytest.raises(ModelError, match=r"^m\.toml: design, c1: is -1"):
        check_values(
            PAPER | {"c1": -1.0},
            n=2,
            rho=2,
            limit="u_max",
            leading=None,
            where="m.toml",
            key=lambda name: f"design, {name}",
        )


def test_gain_names_go_kind_by_kind() -> None:
    assert gain_names(("c", "e"), 2) == ("c1", "c2", "e1", "e2")


REAL_PART = st.floats(-4, 4).filter(lambda x: abs(x) > 0.05)


@given(
    st.lists(REAL_PART, max_size=3),
    st.lists(st.tuples(REAL_PART, st.floats(0, 4)), max_size=2),
    st.sampled_from([1.0, -2.5]),
)
def test_routh_agrees_with_the_roots_that_a_polynomial_was_made_of(
    real: list[float], pairs: list[tuple[float, float]], lead: float
) -> None:
    roots = [*real, *(complex(a, s * b) for a, b in pairs for s in (1, -1))]
    coefficients = lead * np.real(np.poly(roots)) if roots else np.array([lead])
    assert is_hurwitz(list(coefficients)) == all(np.real(root) < 0 for root in roots)


@given(st.floats(1e-300, 1e300), st.floats(1e-300, 1e300), st.floats(1e-300, 1e300))
def test_third_order_is_decided_exactly(k1: float, k2: float, k3: float) -> None:
    exact = int(k1.as_integer_ratio()[0]) * k2.as_integer_ratio()[0] * k3.as_integer_ratio()[1] > (
        k3.as_integer_ratio()[0] * k1.as_integer_ratio()[1] * k2.as_integer_ratio()[1]
    )
    assert is_hurwitz([1.0, k1, k2, k3]) == exact


def test_no_leading_coefficient_no_stability() -> None:
    assert not is_hurwitz([0.0, 1.0])
    assert is_hurwitz([-2.0])


def rule(kind: Literal["finite", "positive", "nonzero", "hurwitz"], *terms: str) -> Rule:
    return Rule("it", kind, terms, "it is wrong", "what is right")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a", 2.0),
        ("-a + 3*b", 7.0),
        ("(1/3)*a**2/b", 4 / 3 / 3),
        ("sqrt(a)*exp(b)*pi - exp(1)", math.sqrt(2) * math.exp(3) * math.pi - math.e),
        ("atan(a) + sinh(b)*cosh(-a)", math.atan(2) + math.sinh(3) * math.cosh(2)),
        (
            "abs(-a) + tanh(a) + log(b) + sin(a)*cos(a)/tan(a)",
            2 + math.tanh(2) + math.log(3) + math.cos(2) ** 2,
        ),
    ],
)
def test_terms_are_the_arithmetic_they_say(text: str, value: float) -> None:
    columns = {"a": np.array([2.0]), "b": np.array([3.0])}
    assert obeys(rule("positive", f"{text} - {value - 1e-12!r}"), columns)[0]
    assert not obeys(rule("positive", f"{text} - {value + 1e-12!r}"), columns)[0]


@pytest.mark.parametrize("text", ["a.real", "a[0]", "__import__('os')", "a if a else b", "a < b", "'a'"])
def test_terms_are_arithmetic_and_nothing_else(text: str) -> None:
    with pytest.raises((ValueError, KeyError)):
        obeys(rule("positive", text), {"a": np.array([2.0]), "b": np.array([3.0])})


def test_a_rule_knows_its_parameters() -> None:
    assert rule("finite", "a*sqrt(b)", "c_plant").names == {"a", "b", "sqrt", "c_plant"}
    assert rule("positive", "lambda").names == {"lambda"}
    assert obeys(rule("positive", "lambda"), {"lambda": np.array([1.0])})[0]


def test_rules_hold_design_by_design() -> None:
    a = {"a": np.array([-1.0, 0.0, 1.0, math.nan, math.inf])}
    assert obeys(rule("positive", "a"), a).tolist() == [False, False, True, False, False]
    assert obeys(rule("nonzero", "a"), a).tolist() == [True, False, True, False, False]
    assert obeys(rule("finite", "a", "1/a"), a).tolist() == [True, False, True, False, False]
    assert obeys(rule("nonzero", "1/a"), a).tolist() == [True, False, True, False, False]
    assert obeys(rule("hurwitz", "1", "a"), a).tolist() == [False, False, True, False, False]


def test_a_broken_rule_is_told_with_the_value() -> None:
    with pytest.raises(UsageError, match=r"^it: it is wrong: a - 3 = -1; allowed: what is right$"):
        check_rules({"a": 2.0}, [rule("nonzero", "a"), rule("positive", "a - 3")], error=UsageError)
    with pytest.raises(ModelError, match=r"^it: it is wrong has the roots 2; allowed: what is right$"):
        check_rules({"a": 2.0}, [rule("hurwitz", "1", "-a")])
    with pytest.raises(ModelError, match=r"^it: has no finite value at these parameters; allowed: "):
        check_rules({"a": 0.0}, [rule("positive", "1/a")])
