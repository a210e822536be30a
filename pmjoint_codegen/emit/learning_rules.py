"""Rules for guesses, ranges and gains of estimates, which a run may set like any other number."""

from __future__ import annotations

import sympy as sp

from pmjoint_codegen.values import COMPENSATOR, Rule
from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.conditions import Condition, conditions_of


def learning_rules(adaptation: Adaptation | None) -> tuple[Rule, ...]:
    """What a controller that guesses or estimates assumes of its own numbers; none for one that does not.

    Args:
        adaptation: of the model.
    """
    found = tuple(map(_rule, conditions_of(adaptation)))
    if adaptation is None or not adaptation.unknown or adaptation.force:
        return found
    what = "plain clipping misleads the estimates, which destroys the loop"
    allowed = "1 (on); 0 where the model file has force = true in [adaptation]"
    return (*found, Rule(COMPENSATOR, "positive", (COMPENSATOR,), what, allowed))


def _rule(item: Condition) -> Rule:
    name, relation = item.parameter.name, item.relation
    if isinstance(relation, sp.Ne):
        return Rule(name, "nonzero", (str(relation.lhs),), item.what, item.allowed)
    term = str(relation.lhs) if relation.rhs == 0 else f"{relation.lhs} - {relation.rhs}"
    strict = isinstance(relation, sp.StrictGreaterThan)
    return Rule(name, "positive" if strict else "nonnegative", (term,), item.what, item.allowed)
