"""What an exported controller with estimates remembers of a sample, and which numbers it can learn with.

The estimates move over a hold by what the law found at the sample before it. The law of that sample has these
numbers at hand, so the controller keeps them: evaluating its law again a sample later would double the cost
of a step. What depends on the applied input waits until that is known, at the end of the hold.
"""

from __future__ import annotations

from collections.abc import Iterator

import sympy as sp
from sympy.core.relational import Relational

from pmjoint_derive import Derivation, real_symbol
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
from pmjoint_derive.sampling import SECTION as SAMPLED
from pmjoint_derive.start import estimate_starts


def learnt_states(derivation: Derivation) -> tuple[sp.Symbol, ...]:
    """The states of the controller that it learns in: estimates, and the gain matrix of least squares."""
    s = derivation.signals
    return (*s.estimates, *s.inverse, *s.covariance)


def kept_symbols(derivation: Derivation) -> tuple[sp.Symbol, ...]:
    """What the law finds at a sample and the update of the estimates reads, in the order of the equations."""
    s, equations = derivation.signals, derivation.equations
    given = {s.y, s.u, s.v, *s.y_r, *s.controller_state}
    late: dict[sp.Symbol, bool] = {}
    found: set[sp.Symbol] = set()

    def waits(symbol: sp.Symbol) -> bool:
        """Whether a value is known only at the end of the hold."""
        if symbol == s.u:
            return True
        if symbol in given or symbol.name not in equations:
            return False
        if symbol not in late:
            item = equations[symbol.name]
            late[symbol] = item.section == SAMPLED or any(map(waits, item.expression.free_symbols))
        return late[symbol]

    def read(symbol: sp.Symbol) -> None:
        if symbol in given or symbol.name not in equations or symbol in found:
            return
        if not waits(symbol):
            found.add(symbol)
            return
        for item in equations[symbol.name].expression.free_symbols:
            read(item)

    for state in learnt_states(derivation):
        read(real_symbol(f"{state.name}_next"))
    places = {name: place for place, name in enumerate(equations)}
    return tuple(sorted(found, key=lambda symbol: places[symbol.name]))


def rest_values(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """State -> where it starts unmatched: 0, an estimate at its guess."""
    known = estimate_starts(derivation.design)
    return {state: known.get(state, sp.Integer(0)) for state in derivation.signals.controller_state}


def ranged_estimates(derivation: Derivation) -> dict[sp.Symbol, tuple[sp.Symbol, sp.Symbol]]:
    """Estimate -> the ends of the range that the update keeps it in, if it has one."""
    adaptation = derivation.model.adaptation
    entries = () if adaptation is None else adaptation.unknown
    return {entry.estimate: entry.ends for entry in entries if entry.range is not None}


def conditions(derivation: Derivation) -> tuple[Relational, ...]:
    """What guesses, ranges and gains must fulfil: inequalities between parameters."""
    adaptation = derivation.model.adaptation
    return () if adaptation is None else tuple(item.canonical for item in _conditions(adaptation))


def _conditions(adaptation: Adaptation) -> Iterator[Relational]:
    for entry in adaptation.entries:
        if entry.place == 0:  # the law knows the sign of b_m
            yield entry.guess_symbol * adaptation.sign > 0
        if entry.unknown:
            yield from _of_estimate(entry, adaptation)
    if adaptation.unknown and adaptation.least_squares is None:
        yield LEAKAGE >= 0
    if adaptation.inverse is not None:
        yield RHO_GUESS * adaptation.sign > 0
        yield RHO_GAMMA >= 0
        yield RHO_LEAKAGE >= 0
    if adaptation.least_squares is not None:
        yield from (LS_KAPPA > 0, LS_FORGETTING >= 0, LS_P0 > 0)
        yield len(adaptation.unknown) * LS_P0 <= LS_K_MAX


def _of_estimate(entry: Entry, adaptation: Adaptation) -> Iterator[Relational]:
    tuned = adaptation.least_squares is None
    if tuned:
        yield entry.gamma >= 0
    if entry.range is None:
        return
    low, high = entry.ends
    inside = (entry.guess_symbol, entry.prior_symbol) if tuned else (entry.guess_symbol,)
    for value in inside:
        yield low < value
        yield value < high
    if entry.place == 0:  # the law divides by the estimate
        yield low > 0 if adaptation.sign > 0 else high < 0
