"""``load = true``: a constant load on the last state, ``x_n' = ... + w``, as one more column of Phi.

Its number is the parameter w, 0 unless ``[parameters]`` has one, in the unit of y over s^n.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.muscle import law_lines
from pmjoint_codegen.modelfile.tables import LARGEST_ORDER, ParameterSpec
from pmjoint_codegen.modelfile.units import Wanted
from pmjoint_derive import Model, Plant, real_symbol
from pmjoint_derive.units import SECOND, parse_unit

if TYPE_CHECKING:
    from pmjoint_codegen.modelfile.schema import ModelSpec

LOAD: Final = "w"
_W: Final = real_symbol(LOAD)
_KEY: Final = "adaptation.load"


def is_loaded(spec: ModelSpec) -> bool:
    """Whether a file adds the load."""
    return spec.adaptation is not None and spec.adaptation.load


def load_unit(y: str, n: int) -> str:
    """Unit of the load: that of y over s^n."""
    return str(parse_unit(y) / SECOND**n)


def load_lines(spec: ModelSpec) -> dict[str, ParameterSpec]:
    """The load's line of ``[parameters]``, where a file adds the load.

    A number without a unit is in the load's own; elsewhere in such a table it would be in SI units.
    """
    if not is_loaded(spec):
        return {}
    unit, about = load_unit(spec.units.y, spec.order), "constant load"
    line = spec.parameters.get(LOAD)
    if line is None:
        return {LOAD: ParameterSpec(value=0.0, unit=unit, about=about)}
    stated = "unit" in line.model_fields_set
    own = ParameterSpec(value=line.value, unit=line.unit if stated else unit, about=line.about or about)
    return {LOAD: own}


def load_wanted(spec: ModelSpec) -> dict[str, Wanted]:
    """The dimension that the load's unit must have."""
    if not is_loaded(spec):
        return {}
    unit = load_unit(spec.units.y, spec.order)
    return {LOAD: Wanted(unit, unit)}


def check_load(spec: ModelSpec, where: str) -> None:
    """Check that the load's name is free.

    Args:
        spec: a validated model file.
        where: file at the start of a message.

    Raises:
        ModelError: a state, the input or a constant of a law of force is called w.
    """
    if not is_loaded(spec):
        return
    system = spec.system
    of_law = law_lines(spec.joint, spec.parameters) if spec.joint else {}
    taken = {
        "a state": (system.states or ()) if system else (),
        "the input": (system.input,) if system else (),
        "a constant of the law of force": tuple(of_law),
    }
    for what, names in taken.items():
        if LOAD in names:
            raise ModelError(
                f"adds the parameter {LOAD}, and {what} is called {LOAD}",
                where=f"{where}: {_KEY}",
                remedy="give that another name",
            )


def with_load(plant: Plant, where: str) -> Plant:
    """The plant with the load.

    Args:
        plant: in the units of the columns.
        where: file at the start of a message.

    Raises:
        ModelError: theta has w already, or no room for it.
    """
    if _W in plant.theta:
        raise ModelError(
            "theta has w already", where=f"{where}: {_KEY}", remedy='leave it out, and give unknown = ["w"]'
        )
    if plant.p >= LARGEST_ORDER:
        raise ModelError(
            f"theta has {plant.p} entries already",
            where=f"{where}: {_KEY}",
            remedy=f"allowed: {LARGEST_ORDER} with the load",
        )
    last = plant.order - 1
    Phi = tuple((*row, sp.Integer(i == last)) for i, row in enumerate(plant.Phi))
    return replace(plant, Phi=Phi, theta=(*plant.theta, _W))


def check_alone(model: Model, where: str, table: str) -> None:
    """Check that the load's parameter is nothing else in the model too, such as a frequency.

    Args:
        model: with the load as the last entry of theta.
        where: file at the start of a message.
        table: that describes the plant.

    Raises:
        ModelError: naming the table where w occurs.
    """
    places: Mapping[str, Iterator[sp.Expr]] = {
        table: _of_physics(model),
        "simulation.reference": iter((model.reference,)),
        "actuator": iter((model.limit, *model.chain.values())),
    }
    for key, expressions in places.items():
        if any(_W in item.free_symbols for item in expressions):
            raise ModelError(
                f"takes the parameter {LOAD} for the load, and {key} uses {LOAD} too",
                where=f"{where}: {_KEY}",
                remedy=f"give the {LOAD} of {key} another name",
            )


def _of_physics(model: Model) -> Iterator[sp.Expr]:
    plant = model.plant
    yield from (*plant.phi, *plant.theta[:-1], *plant.b, plant.sigma, *plant.disturbance)
    yield from (entry for row in plant.Phi for entry in row)
    yield from (item.expression for item in (*model.constants, *model.reported, *model.transformation))
    yield from (item.rate for item in model.extras)
    yield from (item.value for item in model.channels)
    yield from (item.expression for item in model.demands)
    if model.start is not None:
        yield from model.start.states.values()
