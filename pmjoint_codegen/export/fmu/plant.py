"""The simulated plant as a unit: its variables, and its C, printed from the derivation's equations.

The plant's input is what the actuator is told, within or beyond its limits (10). Limits, dead zone and lag of
the actuator and all of the model's disturbance act inside. A delay of the actuator, and noise and
resolution of the sensor, are not in it: they belong to samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import sympy as sp

from pmjoint_codegen.export.fmu.units import Declared, Units
from pmjoint_codegen.export.fmu.variables import INPUT, OUTPUT, PARAMETER, Variable, listed, switches
from pmjoint_codegen.export.lines import Line, Printer, comment, identifier
from pmjoint_codegen.export.source import Identity, filled, joined
from pmjoint_codegen.export.tree import DOUBLE, operations_in, tree_of
from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.equation import Equation
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import SECOND, parse_unit
from pmjoint_derive.valve import COMMAND, drive

_TOLD: Final = sp.Symbol("in->told", real=True)  # the input; no model file can name a parameter so
_APPLIED: Final = sp.Symbol("in->applied", real=True)
# Names of the C around the printed lines.
_TAKEN: Final = frozenset(
    """
    A ATTEMPTS BOOLEAN C E FIXED HUGE_VAL INFINITY INITIALIZING INPUT INSTANTIATED INTEGER JUMPS LEAST
    MODEL_H MODEL_TOKEN MOST NAN NO_VARIABLE OUTPUT PATIENCE REAL STAGES STATES STEPPING TERMINATED TUNABLE
    applied first in inputs m model out outputs p parameters rates report starts t told tolerance x x_dot
    """.split()  # noqa: SIM905 - as words they are read at a glance
)
_SIGN: Final = """\
/* -1, 0 or 1. */
static double sign_of(double x)
{
    return (x > 0.0) ? 1.0 : ((x < 0.0) ? -1.0 : 0.0);
}
"""


def c_name(name: str) -> str:
    """A name as the unit's C takes it."""
    return f"{name}_" if name in _TAKEN else identifier(name)


@dataclass(frozen=True)
class PlantUnit:
    """The plant of a derivation, to be printed.

    Attributes:
        derivation: of the model.
    """

    derivation: Derivation

    @cached_property
    def states(self) -> tuple[sp.Symbol, ...]:
        """The plant's states, those beyond the design's last."""
        model = self.derivation.model
        return (*self.derivation.signals.x, *(extra.symbol for extra in model.extras))

    @cached_property
    def equations(self) -> dict[sp.Symbol, sp.Expr]:
        """Every name that the plant may need -> its expression, with the input in place of the controller."""
        d, s, model = self.derivation, self.derivation.signals, self.derivation.model
        table = {d.equations[name].symbol: d.equations[name].expression for name in d.equations}
        table |= {channel.symbol: channel.value for channel in model.actuator[1:]}
        lower, upper = model.limits
        table[COMMAND] = sp.Max(lower, sp.Min(_TOLD, upper))
        table[s.v] = COMMAND
        zone = model.dead_zone
        table[_APPLIED] = COMMAND if zone is None else COMMAND - sp.Max(-zone, sp.Min(zone, COMMAND))
        table[s.u] = drive(model).get(s.u, _APPLIED)
        table |= {item.symbol: item.expression for item in self.variables if item.symbol not in self.states}
        return table

    @property
    def variables(self) -> tuple[Equation, ...]:
        """Physical states that a run starts from; empty where it starts from the plant's own."""
        start = self.derivation.model.start
        return () if start is None else start.variables

    @cached_property
    def first(self) -> dict[sp.Symbol, float]:
        """What a run starts from -> its value in the model file."""
        names = [item.symbol for item in self.variables] or list(self.states)
        given = self.derivation.model.simulation.x0
        return dict(zip(names, (*given, *(0.0 for _ in names[len(given) :])), strict=True))

    @cached_property
    def parameters(self) -> tuple[sp.Symbol, ...]:
        """Parameters that rates, outputs or start depend on, in the model's order."""
        model = self.derivation.model
        begun = () if model.start is None else tuple(model.start.states.values())
        needed = self.needed([*self.rates, *self.told], begun)
        used: set[sp.Symbol] = set().union(
            *(self.equations[item].free_symbols for item in needed), *(e.free_symbols for e in begun)
        )
        return tuple(item.symbol for item in model.parameters if item.symbol in used)

    @cached_property
    def rates(self) -> tuple[sp.Symbol, ...]:
        """Names of the rates of the states."""
        return tuple(real_symbol(derivative_name(state)) for state in self.states)

    def needed(self, targets: Iterable[sp.Symbol], also: Iterable[sp.Expr] = ()) -> list[sp.Symbol]:
        """The names that some names and expressions need, themselves included, each after what it needs."""
        found: list[sp.Symbol] = []

        def need(symbol: sp.Symbol) -> None:
            if symbol in self.states or symbol not in self.equations or symbol in found:
                return
            for other in sorted(self.equations[symbol].free_symbols, key=str):
                need(other)
            found.append(symbol)

        for symbol in (*targets, *sorted(set().union(*(item.free_symbols for item in also)), key=str)):
            need(symbol)
        return found

    @cached_property
    def told(self) -> tuple[sp.Symbol, ...]:
        """What the plant reports beyond its input."""
        d, model = self.derivation, self.derivation.model
        disturbing = zip(disturbance_symbols(d.plant), d.plant.disturbance, strict=True)
        found = [
            d.signals.y,
            _APPLIED,
            *(item.symbol for item in self.variables),
            *self.states,
            *(item.symbol for item in model.reported),
            *(channel.symbol for channel in model.actuator[1:]),
            *(symbol for symbol, value in disturbing if value != 0),
        ]
        return tuple(dict.fromkeys(found))

    @property
    def input_name(self) -> str:
        """The input: u, or command where a dead zone lies between the two."""
        return "u" if self.derivation.model.dead_zone is None else "command"


def plant_variables(unit: PlantUnit, units: Units) -> tuple[Variable, ...]:
    """Inputs, outputs and parameters, in this order."""
    return listed([*_inputs(unit, units), *_outputs(unit, units), *_parameters(unit, units)])


def _inputs(unit: PlantUnit, units: Units) -> Iterator[Variable]:
    d = unit.derivation
    about = "what the actuator is told, held from step to step"
    yield _input(unit.input_name, about, "m->in.told", units.of(str(d.units.of(d.signals.u))))
    for place, (state, label) in enumerate(zip(unit.states, _labels(unit), strict=True)):
        name = f"{derivative_name(state)}_added"
        yield _input(
            name,
            f"disturbance: added to the rate of {state}",
            f"m->in.added[{place}]",
            units.of(str(parse_unit(label) / SECOND)),
        )


def _input(name: str, about: str, place: str, unit: Declared | None) -> Variable:
    return Variable(name, INPUT, "continuous", about, place, place, start=0.0, unit=unit)


def _labels(unit: PlantUnit) -> list[str]:
    """Units of the states."""
    d = unit.derivation
    return [*(str(d.units.of(state)) for state in d.signals.x), *(item.unit for item in d.model.extras)]


def _outputs(unit: PlantUnit, units: Units) -> Iterator[Variable]:
    d, labels = unit.derivation, dict(zip(unit.states, _labels(unit), strict=True))
    u_unit = str(d.units.of(d.signals.u))
    meanings = {item.symbol: (item.meaning, str(item.unit or "")) for item in unit.variables}
    meanings |= {channel.symbol: (channel.about, channel.unit) for channel in d.model.actuator[1:]}
    for symbol in unit.told:
        if symbol in meanings:
            about, label = meanings[symbol]
        elif symbol == _APPLIED:
            about, label = "what of the input counts: within the limits, beyond the dead zone", u_unit
        elif symbol in labels:
            about, label = f"state {symbol} of (11)", labels[symbol]
        else:
            equation = d.equations[symbol.name]
            about, label = equation.meaning, str(equation.unit or "")
        name = "u_applied" if symbol == _APPLIED else symbol.name
        start = unit.first.get(symbol)
        place = "" if start is None else f"m->first.{c_name(symbol.name)}"
        value = f"m->out.{_field(symbol)}"
        yield Variable(name, OUTPUT, "continuous", about, value, place, start=start, unit=units.of(label))


def _field(symbol: sp.Symbol) -> str:
    return "u_applied" if symbol == _APPLIED else c_name(symbol.name)


def _parameters(unit: PlantUnit, units: Units) -> Iterator[Variable]:
    stated = {item.symbol: item for item in unit.derivation.model.parameters}
    for symbol in unit.parameters:
        item, place = stated[symbol], f"m->p.{c_name(symbol.name)}"
        yield Variable(
            symbol.name,
            PARAMETER,
            "tunable",
            item.about,
            place,
            place,
            start=item.value,
            unit=units.of(item.unit, item.scale),
        )
    about = "local error of the integration, relative to max(1, |value|)"
    yield Variable("tolerance", PARAMETER, "tunable", about, "m->p.tolerance", "m->p.tolerance", start=1e-12)


def plant_header(unit: PlantUnit, variables: tuple[Variable, ...], identity: Identity, token: str) -> str:
    """``model.h`` of the plant."""
    template = (Path(__file__).parent / "plant.h.in").read_text(encoding="utf-8")
    model = unit.derivation.model
    blocks: dict[str, list[Line]] = {
        "banner": [
            Line(f"/* {comment(model.title)}"),
            Line(f" * Simulated plant of the model {comment(identity.model)}."),
            Line(f" * Made by pmjoint export {identity.version}, model {identity.model_hash[:16]}."),
            Line(" * Numbers in brackets are equations of Cai, Qian, Yu, Shen, IEEE Access 8 (2020)."),
            Line(" */"),
        ],
        **_structures(unit, variables),
        **switches(variables),
        **_functions(unit),
    }
    words = {"token": token, "states": str(len(unit.states)), "jumps": "1" if blocks["helpers"] else "0"}
    return joined(filled(template, blocks, words))


def _structures(unit: PlantUnit, variables: tuple[Variable, ...]) -> dict[str, list[Line]]:
    """Fields of the structures, and the values that they begin with."""
    found: dict[str, list[Line]] = {
        "parameters": [],
        "starts": [],
        "inputs": [],
        "outputs": [],
        "defaults": [],
    }
    for item in variables:
        remark = comment(f"{item.about} [{item.unit.name}]" if item.unit else item.about)
        for field, within in ((item.place, "p"), (item.place, "first"), (item.value, "out")):
            name = field.removeprefix(f"m->{within}.")
            if name != field and name != "tolerance":
                block = {"p": "parameters", "first": "starts", "out": "outputs"}[within]
                found[block].append(Line(f"    double {name}; /* {remark} */"))
        if item.place and item.causality != INPUT and item.start is not None and item.name != "tolerance":
            found["defaults"].append(Line(f"    {item.place} = {DOUBLE.literal(item.start)};"))
    found["inputs"] = [
        Line("    double told; /* what the actuator is told */"),
        Line("    double added[STATES]; /* to the rates */"),
    ]
    return found


def _functions(unit: PlantUnit) -> dict[str, list[Line]]:
    """The printed lines of the functions."""
    printer = Printer(_spelling(unit), DOUBLE)
    rates, report = unit.needed(unit.rates), unit.needed(unit.told)
    blocks = {
        "rates": [*_locals(unit, printer, rates)],
        "report": [*_locals(unit, printer, report)],
        "begin": [*_begin(unit, printer)],
    }
    blocks["rates"] += [
        Line(f"    x_dot[{i}] = {c_name(rate.name)} + in->added[{i}];") for i, rate in enumerate(unit.rates)
    ]
    blocks["report"] += [Line(f"    out->{_field(symbol)} = {printer.text(symbol)};") for symbol in unit.told]
    used = {name for symbol in (*rates, *report) for name in operations_in(tree_of(unit.equations[symbol]))}
    blocks["helpers"] = [Line(text) for text in _SIGN.splitlines()] if "sign" in used else []
    return blocks


def _begin(unit: PlantUnit, printer: Printer) -> Iterator[Line]:
    """The states in what a run starts from."""
    start = unit.derivation.model.start
    states = {state: state for state in unit.states} if start is None else start.states
    begun = set().union(*(value.free_symbols for value in states.values())) - unit.first.keys()
    first = {symbol: f"first->{c_name(symbol.name)}" for symbol in unit.first}
    given = Printer({**printer.spelling, **first}, DOUBLE)
    yield from _locals(unit, given, unit.needed(sorted(begun, key=str)))
    for i, state in enumerate(unit.states):
        yield Line(f"    m->x[{i}] = {given.text(states[state])};")


def _spelling(unit: PlantUnit) -> dict[sp.Symbol, str]:
    s = unit.derivation.signals
    found = {symbol: c_name(symbol.name) for symbol in unit.equations}
    found |= {symbol: f"p->{c_name(symbol.name)}" for symbol in unit.parameters}
    found |= {state: f"x[{i}]" for i, state in enumerate(unit.states)}
    return found | {s.t: "t", _TOLD: "in->told", _APPLIED: "u_applied"}


def _locals(unit: PlantUnit, printer: Printer, names: Iterable[sp.Symbol]) -> Iterator[Line]:
    for symbol in names:
        yield Line(f"    const double {printer.spelling[symbol]} = {printer.text(unit.equations[symbol])};")
