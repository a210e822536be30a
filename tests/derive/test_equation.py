"""Named equations: one name each, and expansion down to signals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import sympy as sp

from pmjoint_derive import Derivation, Equation, Equations, Model, derive, real_symbol

S = real_symbol


def equation(name: str, value: sp.Expr) -> Equation:
    return Equation(S(name), value, "Plant", "", "", None)


def test_two_equations_may_not_share_a_name() -> None:
    with pytest.raises(ValueError, match="two equations are named a"):
        Equations([equation("a", S("b")), equation("a", S("c"))])


def test_expansion_follows_names_and_keeps_what_is_asked() -> None:
    table = Equations([equation("a", S("b") + 1), equation("c", S("a") ** 2), equation("y", S("x1"))])
    assert table.expand(S("c") + S("y")) == (S("b") + 1) ** 2 + S("x1")
    assert table.expand(S("c") + S("y"), keep=frozenset({S("y"), S("a")})) == S("a") ** 2 + S("y")


def test_names_are_defined_before_they_are_used_in_the_backstepping(derivation: Derivation) -> None:
    seen: set[str] = set()
    section = [item for item in derivation.equations.values() if item.section == "Backstepping"]
    names = {item.name for item in section}
    for item in section:
        assert {symbol.name for symbol in item.expression.free_symbols} & names <= seen
        seen.add(item.name)


def test_composite_coefficients_get_names(builder: Callable[..., Model]) -> None:
    model = builder(2, 2)
    composite = replace(model.plant, b=(2 * S("b0") / S("d1"),))
    derivation = derive(replace(model, plant=composite))
    assert derivation.equations["b_0"].expression == 2 * S("b0") / S("d1")
    assert S("b_0") in derivation.equations["v"].expression.free_symbols
    assert derivation.equations.expand(S("b_0")) == 2 * S("b0") / S("d1")
