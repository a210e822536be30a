"""The chapters of a derivation in the order in which a reader wants them."""

from __future__ import annotations

from collections.abc import Iterable

from derive.equation import Equation

ORDER = (
    "Plant",
    "Filters",
    "Estimate",
    "Compensator",
    "Reference",
    "Backstepping",
    "Certificate",
    "Closed loop",
)


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
