"""The exported controller as a unit: its variables, and the C between them and the interface."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pmjoint_codegen.export import fields
from pmjoint_codegen.export.fmu.units import Declared, Units
from pmjoint_codegen.export.fmu.variables import (
    BOOLEAN,
    INPUT,
    INTEGER,
    LOCAL,
    OUTPUT,
    PARAMETER,
    REAL,
    Variable,
    listed,
    switches,
)
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import banner, filled, joined, words_of

_RENAMED: Final = {"u_measured": "u_applied"}  # field of the C -> variable


def controller_variables(export: Export, units: Units) -> tuple[Variable, ...]:
    """Inputs, outputs, parameters and states, in this order."""
    program, real = export.program, export.precision.name
    return listed(
        [
            *_inputs(program, units, real),
            *_outputs(program, units),
            *_parameters(program, units, real),
            *(
                Variable(
                    item.name,
                    LOCAL,
                    "discrete",
                    item.about,
                    f"m->state.{item.name}",
                    unit=_unit_of(program, units, item.name),
                )
                for item in fields.state_fields(program)
                if item.name in {state.name for state in program.states}
            ),
        ]
    )


def _inputs(program: Program, units: Units, real: str) -> Iterator[Variable]:
    for item in fields.input_fields(program):
        flag = item.kind == fields.INTEGER
        place = f"m->in.{item.name}"
        yield Variable(
            _RENAMED.get(item.name, item.name),
            INPUT,
            "discrete" if flag else "continuous",
            item.about.replace("u_measured", "u_applied").replace("step returned", "the unit returned"),
            place,
            place,
            "int" if flag else real,
            0.0,
            None if flag else _unit_of(program, units, item.name),
            BOOLEAN if flag else REAL,
        )


def _outputs(program: Program, units: Units) -> Iterator[Variable]:
    for item in fields.output_fields(program):
        flag = item.kind == fields.INTEGER
        about = "0, or a sum of 1 (y or reference), 2 (u_applied) and 4 (v) no finite number"
        yield Variable(
            item.name,
            OUTPUT,
            "discrete",
            about if flag else item.about,
            f"m->out.{item.name}",
            unit=None if flag else _unit_of(program, units, item.name),
            kind=INTEGER if flag else REAL,
        )


def _parameters(program: Program, units: Units, real: str) -> Iterator[Variable]:
    stated = {item.symbol: item for item in program.derivation.model.parameters}
    found: list[Declared | None] = [
        units.of(stated[symbol].unit, stated[symbol].scale)
        if symbol in stated
        else units.of(str(program.derivation.units.of(symbol)))
        for symbol in program.parameters
    ]
    found += [units.of("s"), None]  # sample time, start
    for item, unit in zip(fields.parameter_fields(program), found, strict=True):
        flag = item.kind == fields.INTEGER
        place = f"m->params.{item.name}"
        fixed = flag or item.name == fields.SAMPLE_TIME
        yield Variable(
            item.name,
            PARAMETER,
            "fixed" if fixed else "tunable",
            item.about,
            place,
            place,
            "int" if flag else real,
            item.value,
            unit,
            BOOLEAN if flag else REAL,
        )


def _unit_of(program: Program, units: Units, name: str) -> Declared | None:
    """The unit of an input, output or state by its name in the C."""
    d, s = program.derivation, program.derivation.signals
    symbols = {symbol.name: symbol for symbol in (s.y, *s.y_r, *s.z, *program.states)}
    symbols |= {hat.name: x for hat, x in zip(program.estimate, s.x, strict=True)}
    return units.of(str(d.units.of(symbols.get(name, s.u))))


def controller_header(export: Export, variables: tuple[Variable, ...], token: str) -> str:
    """``model.h`` of the controller."""
    program, identity, precision = export.program, export.identity, export.precision
    template = (Path(__file__).parent / "controller.h.in").read_text(encoding="utf-8")
    blocks = {"banner": banner(program, identity, precision), **switches(variables)}
    words = words_of(program, identity, precision) | {"token": token}
    return joined(filled(template, blocks, words))
