"""The entries of ``Theta = (b_m, ..., b_0, theta)`` and the names by which ``[adaptation]`` calls them.

Entries of b are called ``b0`` ... ``bm``, whatever stands there, and those of theta by their parameter.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sp

from pmjoint_codegen.errors import ModelError, did_you_mean, quoted
from pmjoint_codegen.modelfile.load import LOAD, load_unit
from pmjoint_codegen.modelfile.points import value_at
from pmjoint_derive import Model, Plant
from pmjoint_derive.units import SECOND, parse_unit


@dataclass(frozen=True)
class Slot:
    """One entry of Theta.

    Attributes:
        place: index in Theta, b_m first.
        names: what a file may call it; the first is the usual one.
        value: at the file's parameters, in the units that the law uses.
        position: where it stands, for a message.
        shown: what stands there, for a message.
        unit: of it, for the reader; empty if no label says it.
        about: what it is, for the reader.
        load: whether it is a constant load.
    """

    place: int
    names: tuple[str, ...]
    value: float
    position: str
    shown: str
    unit: str = ""
    about: str = ""
    load: bool = False

    @property
    def leading(self) -> bool:
        """Whether it is b_m."""
        return self.place == 0


def slots_of(model: Model) -> tuple[Slot, ...]:
    """The entries of Theta in their order.

    Args:
        model: with numbers that have been checked.
    """
    point: dict[sp.Symbol, float] = {item.symbol: item.value for item in model.parameters}
    for constant in model.constants:
        point[constant.symbol] = value_at(constant.expression, point)
    labels = _labels(model)
    y, u = parse_unit(model.y_unit), parse_unit(model.u_unit)
    plant, found = model.plant, []
    for i, entry in enumerate(plant.b):
        usual = f"b{plant.m - i}"
        own = entry.name if entry in labels else usual
        names = tuple(dict.fromkeys((usual, own)))
        unit = str(y / SECOND ** (plant.rho + i) / u)
        about = labels[entry][1] if entry in labels else ""
        position = f"entry {i + 1} of b"
        about = about or "input coefficient"
        found.append(Slot(i, names, value_at(entry, point), position, str(entry), unit, about))
    for i, entry in enumerate(plant.theta):
        alone = entry in labels and plant.theta.count(entry) == 1
        load = alone and entry.name == LOAD and _is_load(plant, i)
        unit, about = labels.get(entry, ("", ""))
        found.append(
            Slot(
                len(plant.b) + i,
                (entry.name if alone else f"theta{i + 1}",),
                value_at(entry, point),
                f"entry {i + 1} of theta",
                str(entry),
                load_unit(model.y_unit, plant.order) if load else unit,
                about or "coefficient",
                load,
            )
        )
    return tuple(found)


def _labels(model: Model) -> dict[sp.Expr, tuple[str, str]]:
    """Parameters, and the coefficients of a joint -> unit and meaning."""
    found: dict[sp.Expr, tuple[str, str]] = {}
    found |= {item.symbol: (item.unit, item.about) for item in model.parameters}
    for constant in model.constants:
        unit = "" if constant.unit is None else str(constant.unit)
        found[constant.symbol] = (unit, constant.meaning)
    return found


def _is_load(plant: Plant, column: int) -> bool:
    """Whether a column of Phi is a multiple of e_n."""
    *above, last = (row[column] for row in plant.Phi)
    return last.is_number and last != 0 and not any(above)


def slot_called(name: str, key: str, slots: Iterable[Slot], where: str) -> Slot:
    """The entry of a name.

    Args:
        name: as in the file.
        key: its place in the file.
        slots: all entries.
        where: file at the start of a message.

    Raises:
        ModelError: no entry, or more than one, has this name.
    """
    slots = tuple(slots)
    found = [slot for slot in slots if name in slot.names]
    place = f"{where}: {key}"
    if len(found) == 1:
        return found[0]
    if found:
        raise ModelError(
            f"{quoted(name)} may be {' or '.join(slot.position for slot in found)}",
            where=place,
            remedy="give the parameter another name",
        )
    if name == LOAD:
        raise ModelError(
            f"{quoted(name)} is no entry of theta", where=place, remedy="give load = true, which adds it"
        )
    known = [each for slot in slots for each in slot.names]
    raise ModelError(
        f"{quoted(name)} is no entry of b or theta",
        where=place,
        remedy=f"{did_you_mean(name, known)}allowed: {', '.join(_listed(slot) for slot in slots)}",
    )


def _listed(slot: Slot) -> str:
    """Names of an entry, and what stands there unless that is one of them."""
    names = " or ".join(slot.names)
    return names if slot.shown in slot.names else f"{names} ({quoted(slot.shown)})"
