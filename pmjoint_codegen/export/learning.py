"""What an exported controller with estimates remembers of a sample, and which numbers it can learn with.

The estimates move over a hold by what the law found at the sample before it. The law of that sample has these
numbers at hand, so the controller keeps them: evaluating its law again a sample later would double the cost
of a step. What depends on the applied input waits until that is known, at the end of the hold.
"""

from __future__ import annotations

import sympy as sp
from sympy.core.relational import Relational

from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.conditions import conditions_of
from pmjoint_derive.sampling import SECTION as SAMPLED
from pmjoint_derive.start import estimate_starts


def learnt_states(derivation: Derivation) -> tuple[sp.Symbol, ...]:
    """The states of the controller that it learns in: estimates, and the gain matrix of least squares."""
    s = derivation.signals
    return (*s.learnt, *s.inverse, *s.covariance)


def kept_symbols(derivation: Derivation) -> tuple[sp.Symbol, ...]:
    """What the law finds at a sample and the update of the estimates reads, in the order of the equations.

    The estimates are among it: a caller may want to see them where their states are their logits.
    """
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
    found |= {hat for hat in s.estimates if hat not in given}
    places = {name: place for place, name in enumerate(equations)}
    return tuple(sorted(found, key=lambda symbol: places[symbol.name]))


def rest_values(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """State -> where it starts unmatched: 0, an estimate at its guess."""
    known = estimate_starts(derivation.design)
    return {state: known.get(state, sp.Integer(0)) for state in derivation.signals.controller_state}


def kept_at_start(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """What is kept -> where it starts: an estimate at its guess, anything else at 0."""
    adaptation = derivation.model.adaptation
    guesses = {} if adaptation is None else {item.estimate: item.guess_symbol for item in adaptation.ranged}
    return {symbol: guesses.get(symbol, sp.Integer(0)) for symbol in kept_symbols(derivation)}


def logits(derivation: Derivation) -> tuple[sp.Symbol, ...]:
    """The states that the update itself keeps within bounds."""
    s = derivation.signals
    return tuple(state for state, hat in zip(s.learnt, s.estimates, strict=True) if state != hat)


def conditions(derivation: Derivation) -> tuple[Relational, ...]:
    """What guesses, ranges and gains must fulfil: inequalities between parameters.

    Where a run asks for a guess of b_m other than 0, the C holds on to the sign of the model's.
    """
    adaptation = derivation.model.adaptation
    found = []
    for item in conditions_of(adaptation):
        relation = item.relation
        if adaptation is not None and isinstance(relation, sp.Ne):
            relation = sp.StrictGreaterThan(adaptation.sign * relation.lhs, 0)
        found.append(relation.canonical)
    return tuple(found)
