"""Variables of a unit, and the C that reaches them by value reference."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from pmjoint_codegen.export.fmu.units import Declared
from pmjoint_codegen.export.lines import Line

REAL, INTEGER, BOOLEAN = "REAL", "INTEGER", "BOOLEAN"  # kinds, as the C names them
INPUT, OUTPUT, LOCAL, PARAMETER, TIME = "input", "output", "local", "parameter", "independent"
_WIDTH: Final = 10  # cases on a line


@dataclass(frozen=True)
class Variable:
    """A variable of a unit; its value reference is its place in the list.

    Attributes:
        name: in modelDescription.xml.
        causality: `INPUT`, `OUTPUT`, `LOCAL`, `PARAMETER` or `TIME`.
        variability: as the FMI names it.
        about: one line for the reader.
        value: C that reads it.
        place: C that it is stored in; empty if it cannot be set.
        stored: C type of the place.
        start: its value before it is set; None for what is calculated.
        unit: physical unit; None for a plain number.
        kind: `REAL`, `INTEGER` or `BOOLEAN`.
    """

    name: str
    causality: str
    variability: str
    about: str
    value: str
    place: str = ""
    stored: str = "double"
    start: float | None = None
    unit: Declared | None = None
    kind: str = REAL

    @property
    def role(self) -> str:
        """When it can be set, as the C names it."""
        if self.causality == INPUT:
            return "INPUT"
        if not self.place:
            return "OUTPUT"
        return "TUNABLE" if self.variability == "tunable" else "FIXED"


def time_variable() -> Variable:
    """The independent variable, which has value reference 0."""
    return Variable("time", TIME, "continuous", "time", "m->time", unit=Declared("s", (("s", 1),)))


def listed(variables: Iterable[Variable]) -> tuple[Variable, ...]:
    """The variables behind the time; one whose name an earlier one has gets an underscore."""
    taken: set[str] = set()
    found = []
    for item in (time_variable(), *variables):
        name = item.name
        while name in taken:
            name += "_"
        taken.add(name)
        found.append(replace(item, name=name))
    return tuple(found)


def switches(variables: Sequence[Variable]) -> dict[str, list[Line]]:
    """The blocks ``kinds``, ``roles``, ``gets`` and ``sets`` of a template."""
    blocks = {
        "kinds": _grouped("kind", [item.kind for item in variables], skipped=""),
        "roles": _grouped("role", [item.role for item in variables], skipped="OUTPUT"),
        "gets": [],
        "sets": [],
    }
    for reference, item in enumerate(variables):
        blocks["gets"] += _case(reference, f"value = (double){item.value};")
        if item.place:
            value = "(value != 0.0)" if item.kind == BOOLEAN else "value"
            cast = "" if item.stored == "double" else f"({item.stored})"
            blocks["sets"] += _case(reference, f"{item.place} = {cast}{value};")
    return blocks


def _case(reference: int, text: str) -> list[Line]:
    return [Line(f"    case {reference}:"), Line(f"        {text}"), Line("        break;")]


def _grouped(target: str, values: list[str], skipped: str) -> list[Line]:
    lines: list[Line] = []
    for value in dict.fromkeys(values):
        if value == skipped:
            continue
        cases = [f"case {reference}:" for reference, found in enumerate(values) if found == value]
        rows = [cases[at : at + _WIDTH] for at in range(0, len(cases), _WIDTH)]
        lines += [Line("    " + " ".join(row)) for row in rows]
        lines += [Line(f"        {target} = {value};"), Line("        break;")]
    return lines
