"""What a controller that guesses or estimates assumes of its own numbers, once for runs and for exported C.

The true values obey no condition: one outside its range is allowed, and leaves no V.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import sympy as sp
from sympy.core.relational import Relational

from pmjoint_derive.adaptation import (
    LEAKAGE,
    LS_FORGETTING,
    LS_K_MAX,
    LS_KAPPA,
    LS_P0,
    RHO_GAMMA,
    RHO_GUESS,
    RHO_LEAKAGE,
    Adaptation,
    Entry,
)

_POSITIVE, _NOT_NEGATIVE = "a number greater than 0", "a number of 0 or greater"


@dataclass(frozen=True)
class Condition:
    """A relation between run-time parameters.

    Attributes:
        parameter: the one at fault where it does not hold.
        relation: ``a > b``, ``a >= b`` or ``a != 0``, as written.
        allowed: what the parameter may be.
        what: what is wrong where it does not hold; empty where the value itself shows it.
    """

    parameter: sp.Symbol
    relation: Relational
    allowed: str
    what: str = ""


def conditions_of(adaptation: Adaptation | None) -> tuple[Condition, ...]:
    """The conditions of a model's controller; none where it knows all.

    Args:
        adaptation: of the model.
    """
    return () if adaptation is None else tuple(_conditions(adaptation))


def _conditions(adaptation: Adaptation) -> Iterator[Condition]:
    tuned = adaptation.least_squares is None
    for entry in adaptation.entries:
        if entry.unknown and entry.range is not None:
            yield from _inside(
                entry, (entry.guess_symbol, entry.prior_symbol) if tuned else (entry.guess_symbol,)
            )
        if entry.place == 0:
            yield _of_leading(entry, adaptation.sign)
        if entry.unknown and tuned:
            yield _not_negative(entry.gamma)
    if adaptation.unknown and tuned:
        yield _not_negative(LEAKAGE)
    if adaptation.inverse is not None:
        yield _not_negative(RHO_GAMMA)
        yield _not_negative(RHO_LEAKAGE)
        yield _signed(RHO_GUESS, adaptation.sign, "1/b_m")
    if adaptation.least_squares is not None:
        yield Condition(LS_KAPPA, LS_KAPPA > 0, _POSITIVE)
        yield _not_negative(LS_P0)  # from 0 the matrix stays at 0, and the estimates at their guesses
        yield _not_negative(LS_FORGETTING)
        yield Condition(LS_K_MAX, LS_K_MAX > 0, _POSITIVE)
        trace = len(adaptation.unknown) * LS_P0
        what = "less than the initial trace of the gain matrix"
        yield Condition(LS_K_MAX, sp.GreaterThan(LS_K_MAX, trace), f"at least {trace}", what)


def _inside(entry: Entry, values: tuple[sp.Symbol, ...]) -> Iterator[Condition]:
    """The estimate starts inside its range, and leakage pulls it to a place there."""
    low, high = entry.ends
    what, allowed = f"not inside the range of {entry.estimate}", f"a number between {low} and {high}"
    for value in values:
        yield Condition(value, sp.StrictGreaterThan(value, low), allowed, what)
        yield Condition(value, sp.StrictGreaterThan(high, value), allowed, what)


def _of_leading(entry: Entry, sign: int) -> Condition:
    """The sign of b_m is known, and the law divides by what stands for it."""
    guess = entry.guess_symbol
    if not entry.unknown:
        return Condition(guess, sp.Ne(guess, 0), "a number other than 0")
    if entry.range is None:
        return _signed(guess, sign, "b_m")
    low, high = entry.ends
    what = f"the range of {entry.estimate} contains 0, and the law divides by it"
    end = low if sign > 0 else high
    return Condition(end, sp.StrictGreaterThan(sign * end, 0), f"{low} and {high} of one sign", what)


def _signed(value: sp.Symbol, sign: int, what: str) -> Condition:
    """The law was derived for one sign of b_m."""
    side = "greater" if sign > 0 else "less"
    relation = sp.StrictGreaterThan(sign * value, 0)
    return Condition(value, relation, f"a number {side} than 0", f"another sign of {what} than the model's")


def _not_negative(value: sp.Symbol) -> Condition:
    return Condition(value, value >= 0, _NOT_NEGATIVE)
