"""The chapters of a derivation in the order in which a reader wants them."""

from __future__ import annotations

from collections.abc import Iterable

from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model
from pmjoint_derive.true_plant import own_symbol

ORDER = (
    "System",
    "Plant",
    "Filters",
    "Estimate",
    "Compensator",
    "Reference",
    "Backstepping",
    "Adaptation",
    "ADRC",
    "Start",
    "Certificate",
    "Closed loop",
)


def own_parameters(model: Model, equations: Iterable[Equation]) -> dict[str, str]:
    """Values of the true plant's own -> the controller's, which they equal where nobody sets others."""
    used = {symbol.name for equation in equations for symbol in equation.expression.free_symbols}
    names = {own_symbol(item.symbol).name: item.name for item in model.parameters}
    return {own: name for own, name in names.items() if own in used}


def by_section(equations: Iterable[Equation]) -> list[tuple[str, list[Equation]]]:
    """Gather equations under their sections, keeping their order; a section not known here comes last."""
    table: dict[str, list[Equation]] = {}
    for equation in equations:
        table.setdefault(equation.section, []).append(equation)
    return [
        (name, table[name])
        for name in (*ORDER, *(name for name in table if name not in ORDER))
        if name in table
    ]
