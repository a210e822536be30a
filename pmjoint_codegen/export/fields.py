"""The fields of the exported structures: name, type, meaning, unit and range, once for C and for Python."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import sympy as sp

from pmjoint_codegen.chain import LIMIT, LINKS
from pmjoint_codegen.export.learning import conditions
from pmjoint_codegen.export.lines import identifier
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.tree import Precision
from pmjoint_codegen.values import SI, from_si
from pmjoint_derive import real_symbol
from pmjoint_derive.adaptation import Setting, settings_of
from pmjoint_derive.units import parse_unit

INTEGER: Final = "int"
REAL: Final = "real"
MATRIX: Final = "matrix"
SAMPLE_TIME: Final = "sample_time"


@dataclass(frozen=True)
class Field:
    """A field of a structure.

    Attributes:
        name: in C.
        kind: `INTEGER`, `REAL` or `MATRIX`.
        about: meaning, unit and range, for its comment.
        value: default of a parameter.
    """

    name: str
    kind: str
    about: str
    value: float = 0.0


def _said(meaning: str, unit: str, allowed: str) -> str:
    bracket = f" [{unit}]" if unit else ""
    return f"{meaning}{bracket}; {allowed}" if allowed else f"{meaning}{bracket}"


def parameter_fields(program: Program) -> tuple[Field, ...]:
    """What `init` reads: parameters, gains, sample time, start."""
    d, s = program.derivation, program.derivation.signals
    model, chained = d.model, {symbol: key for key, symbol in d.model.chain.items()}
    stated = {item.symbol: item for item in model.parameters}
    gains = d.gain_values | {s.compensator: float(model.gains.compensator)}
    if s.braking:
        gains[s.braking[0]] = float(model.gains.braking or 0.0)
    gains |= {item.symbol: item.value for item in _settings(program).values()}
    found = []
    for symbol in program.parameters:
        if symbol in stated:
            item = stated[symbol]
            unit = item.unit
            if item.scale != SI:
                key = LIMIT if symbol == model.limit else chained.get(symbol, "")
                held = _bench_unit(program, key) or "SI"
                unit = f"{held}; {from_si(item.value, item.scale)!r} {item.unit} in the model"
            allowed = "> 0" if symbol == model.limit else _RANGES.get(chained.get(symbol, ""), "finite")
            found.append(Field(identifier(symbol.name), REAL, _said(item.about, unit, allowed), item.value))
        else:
            about, allowed = _gain(program, symbol.name)
            unit = str(d.units.of(symbol))
            if symbol == s.input_scale and model.measures.si is not None:
                unit = f"{unit}; {from_si(gains[symbol], model.measures.input_scale)!r} for SI units"
            found.append(Field(identifier(symbol.name), REAL, _said(about, unit, allowed), gains[symbol]))
    T = Field(SAMPLE_TIME, REAL, "time from step to step [s]; > 0", model.simulation.sample_time)
    start = "start of filters and compensator; 1: matched to the first y and reference, 0: at zero"
    return (*found, T, Field("matched", INTEGER, start, float(model.gains.matched)))


def _bench_unit(program: Program, key: str) -> str:
    """The unit in which a key of ``[actuator]`` or ``[sensor]`` is held, if it is that of y or u."""
    of = {"y": model_y(program), "u": str(program.derivation.units.of(program.derivation.signals.u))}
    label, _, over = next((link.unit for link in LINKS if link.key == key), "").partition("/")
    return of.get(label, "") + (f"/{over}" if over and label in of else "")


_RANGES: Final = {
    "rate": "> 0",
    "dead_zone": ">= 0",
    "filter": "> 0",
    "lower": "below the upper limit",
    "upper": "above the lower limit",
}


def _settings(program: Program) -> dict[str, Setting]:
    """Guesses, ranges and gains of what the controller does not know, by name."""
    d = program.derivation
    found = settings_of(d.model.adaptation, parse_unit(d.model.y_unit))
    return {item.symbol.name: item for item in found}


def _allowed(program: Program, name: str) -> str:
    """Which numbers a guess, an end of a range or a gain may be."""
    symbol = real_symbol(name)
    related = [item for item in conditions(program.derivation) if symbol in item.free_symbols]
    seen = (item if item.lhs == symbol else item.reversed for item in related)
    return ", ".join(f"{item.rel_op} {item.rhs}" for item in seen if item.lhs == symbol) or "finite"


def _gain(program: Program, name: str) -> tuple[str, str]:
    """Meaning and range of a gain."""
    s, learning = program.derivation.signals, _settings(program)
    if name in learning:
        return learning[name].about, _allowed(program, name)
    for kind, symbols in s.gains_by_kind.items():
        for place, symbol in enumerate(symbols, start=1):
            if symbol.name == name:
                of = s.r[place - 1] if kind == "ck" else place
                return _GAINS[kind][0].format(of), _GAINS[kind][1]
    return {
        s.compensator.name: ("compensator (23): 1 at work, 0 plain clipping", "0 or 1"),
        s.input_scale.name: ("weight of z_i, i > 1; 1: the paper's law", "> 0"),
    }.get(name, ("share of the limit that the compensator brakes with", "> 0, below 1"))


_GAINS: Final = {
    "c": ("damping of error z{}", "> 0"),
    "e": ("damping against the estimation error, step {}", "> 0"),
    "ck": ("decay rate of compensator state {}", "> 0"),
    "k": ("filter gain {}", "all together such that A0 = A - k e1' is Hurwitz"),
}


def state_fields(program: Program) -> tuple[Field, ...]:
    """What a controller remembers from step to step."""
    d, s = program.derivation, program.derivation.signals
    blocks = {symbol: key for key, symbols in s.controller_blocks.items() for symbol in symbols}
    about = {
        "xi": "filter (14), driven by y",
        "Xi": "filter (14), driven by Phi(y)",
        "lambda": "filter (14), driven by u",
        "r": "compensator" if s.estimates else "compensator (23)",
        "Theta": "estimate, or its logit: where it is in its range",
        "rho": "estimate of 1/b_m",
        "Gamma": "gain of least squares",
    }
    states = [
        Field(symbol.name, REAL, _said(about[blocks[symbol]], str(d.units.of(symbol)), "finite"))
        for symbol in program.states
    ]
    unit = str(d.units.of(s.u))
    reference = [
        Field(
            symbol.name, REAL, _said(f"{symbol.name} at the last sound sample", str(d.units.of(symbol)), "")
        )
        for symbol in s.y_r
    ]
    return (
        *states,
        Field(
            "y",
            REAL,
            _said("y, filtered if a filter is declared, at the last sound sample", model_y(program), ""),
        ),
        *reference,
        *_kept_fields(program),
        Field("v", REAL, _said("v of (29) at that sample", unit, "")),
        Field("u", REAL, _said("the input that acts since that sample", unit, "")),
        Field("command", REAL, _said("what the actuator was told at that sample", unit, "within the limits")),
        Field("ready", INTEGER, "1 once a sample has been taken"),
    )


def _kept_fields(program: Program) -> Iterator[Field]:
    """What the law leaves for the update of the estimates, and whether it holds."""
    for symbol in program.kept:
        item = program.derivation.equations[symbol.name]
        unit = "" if item.unit is None else str(item.unit)
        yield Field(identifier(symbol.name), REAL, _said(f"{item.meaning}, at the last sample", unit, ""))
    if program.learnt:
        yield Field("learns", INTEGER, "1 if the last sample was sound; else the estimates rest")


def model_y(program: Program) -> str:
    """Unit of the output."""
    return str(program.derivation.units.of(program.derivation.signals.y))


def input_fields(program: Program) -> tuple[Field, ...]:
    """What a step is given."""
    d, s, model = program.derivation, program.derivation.signals, program.derivation.model
    low_high = "" if model.y_range is None else f"{model.y_range[0]!r} to {model.y_range[1]!r}, "
    y = Field("y", REAL, _said("measured output", model_y(program), f"{low_high}finite"))
    meanings = ["reference", *(f"derivative {i} of the reference" for i in range(1, len(s.y_r)))]
    reference = [
        Field(symbol.name, REAL, _said(meaning, str(d.units.of(symbol)), "finite"))
        for symbol, meaning in zip(s.y_r, meanings, strict=True)
    ]
    unit = str(d.units.of(s.u))
    return (
        y,
        *reference,
        Field(
            "use_measured_u", INTEGER, "1: u_measured acted since the last step; 0: the u that step returned"
        ),
        Field("u_measured", REAL, _said("applied input since the last step", unit, "read only if asked for")),
    )


def output_fields(program: Program) -> tuple[Field, ...]:
    """What a step returns."""
    d, s = program.derivation, program.derivation.signals
    unit = str(d.units.of(s.u))
    states = zip(program.estimate, s.x, strict=True)
    return (
        Field("v", REAL, _said("control law (29), before the limits", unit, "")),
        Field("command", REAL, _said("what to tell the actuator", unit, "within the limits")),
        Field("u", REAL, _said("what of it counts beyond the dead zone, if one is declared", unit, "")),
        *(Field(hat.name, REAL, _said(f"estimate (15) of {x}", str(d.units.of(x)), "")) for hat, x in states),
        *(Field(z.name, REAL, _said("error (24)", str(d.units.of(z)), "")) for z in s.z),
        Field("flags", INTEGER, "0, or what was wrong; see below"),
    )


def constant_fields(program: Program) -> Iterator[Field]:
    """What `init` computes once, behind the parameters."""
    number = ", with T itself first" if program.learnt else " (23)"
    for label, about in (
        ("F0", "expm(A0 T) of the filters (14)"),
        ("G0", "its integral over the hold"),
        ("Fr", f"expm(Ar T) of the compensator{number}"),
        ("Gr", "its integral over the hold"),
    ):
        yield Field(label, MATRIX, about)
    if "filter" in program.derivation.model.chain:
        yield Field("filter_gain", REAL, "1 - exp(-filter T)")
    for item in program.constants:
        meaning = item.meaning or f"{item.factor * sum(item.terms)}"
        yield Field(
            identifier(item.symbol.name), REAL, _said(" ".join((item.number, meaning)).strip(), item.unit, "")
        )


def defaults(program: Program, precision: Precision) -> dict[sp.Symbol, float]:
    """The model's parameters by symbol, as numbers of the precision."""
    items = parameter_fields(program)
    values = [item.value for item in items if item.kind != INTEGER and item.name != SAMPLE_TIME]
    return {
        symbol: nearest(value, precision) for symbol, value in zip(program.parameters, values, strict=True)
    }


def nearest(value: float, precision: Precision) -> float:
    """The number of a precision that is nearest to a double."""
    return float(np.float32(value)) if precision.suffix else value
