"""The files beside the controller: example, build files, README."""

from __future__ import annotations

import json
import re
from typing import Final

import sympy as sp

from pmjoint_codegen.export import fields
from pmjoint_codegen.export.example import example_plant, in_numbers
from pmjoint_codegen.export.fields import INTEGER
from pmjoint_codegen.export.hold import BAKED, COMPUTED
from pmjoint_codegen.export.learning import logits
from pmjoint_codegen.export.lines import Line, Printer, comment, spellings
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import TEMPLATES, Identity, banner, filled, joined, replaced, words_of
from pmjoint_codegen.export.tree import Precision
from pmjoint_derive import real_symbol
from pmjoint_derive.estimation import LARGEST

_MOST: Final = 20_000  # samples of the example
_ROWS: Final = 10  # of them printed
_FILES: Final = ("main.c", "analyse.c", "Makefile", "CMakeLists.txt", "README.md")
_LIBRARY: Final = ("library.properties", "library.json")  # of Arduino and of PlatformIO
_WIDE: Final = 10.0  # range of y in the static analysis, times |y(0)|, where the model declares none
_RATES: Final = 1000.0  # range of each derivative of the reference, times that of y
_LONGEST: Final = 50  # characters of a name in PlatformIO


def companion_files(
    program: Program, identity: Identity, precision: Precision, hold: str = COMPUTED
) -> dict[str, str]:
    """File name -> text."""
    words = words_of(program, identity, precision, hold)
    words |= {"model": comment(identity.model), "rho": str(program.derivation.plant.rho)}
    words |= _library_words(program, identity)
    blocks, ranges = _analysis(program, precision)
    words |= ranges
    blocks |= {
        "banner": banner(program, identity, precision),
        "parameters": parameter_rows(program, precision),
    }
    about = (TEMPLATES / "baked.md.in").read_text(encoding="utf-8")
    blocks["baked"] = [Line(text) for text in about.splitlines()] if hold == BAKED else []
    blocks["learning"] = _learning(program)
    example, numbers = _example(program, precision)
    found = {}
    for name in (*_FILES, *_LIBRARY):
        template = (TEMPLATES / f"{name}.in").read_text(encoding="utf-8")
        found[name] = joined(filled(template, {**blocks, **example}, {**words, **numbers}))
    return found


def parameter_rows(program: Program, precision: Precision) -> list[Line]:
    """The parameters as rows of a table: name, default, meaning."""
    return [Line(_row(item, precision)) for item in fields.parameter_fields(program)]


def _analysis(program: Program, precision: Precision) -> tuple[dict[str, list[Line]], dict[str, str]]:
    """The blocks and words of the static analysis: ranges of states and inputs."""
    s, model = program.derivation.signals, program.derivation.model
    widest = _WIDE * (abs(model.simulation.x0[0]) or 1.0)
    low, high = model.y_range or (-widest, widest)
    printer = Printer(spellings(program), precision)
    lower, upper = (printer.text(limit) for limit in model.limits)
    size = "any(-RATES, RATES)"
    reference = [f"{item} = {size if place else 'any(Y_LOW, Y_HIGH)'};" for place, item in enumerate(s.y_r)]
    zero, limit = precision.literal(0.0), "_STATE_RANGE"
    filtered = "filter" in model.chain  # then y is a state of the controller's own
    kept = [*program.states, *program.kept, *([s.y] if filtered else [])]
    wide = f"any(-@NAME@{limit}, @NAME@{limit})"
    far = precision.literal(float(LARGEST))
    any_of = dict.fromkeys(logits(program.derivation), f"any(-{far}, {far})")
    lines = {
        "inputs": [f"    in->{text}" for text in reference],
        "any_reference": [f"    s->{text}" for text in reference],
        "first": [f"    first.{item} = {zero};" for item in s.y_r],
        "any_y": [] if filtered else ["    s->y = any(Y_LOW, Y_HIGH);"],
        "any_state": [f"    s->{item} = {any_of.get(item, wide)};" for item in kept],
    }
    lines["any_state"] += ["    s->learns = Frama_C_interval(0, 1);"] if program.learnt else []
    words = {
        "lower": lower,
        "upper": upper,
        "y_low": precision.literal(low),
        "y_high": precision.literal(high),
    }
    words |= {"finite_function": "__finitef" if precision.suffix else "__finite"}  # Frama-C's isfinite
    words |= {"rates": precision.literal(_RATES * max(abs(low), abs(high)))}
    return {name: [Line(text) for text in texts] for name, texts in lines.items()}, words


def _learning(program: Program) -> list[Line]:
    """The section on estimates; nothing where all is known."""
    adaptation = program.derivation.model.adaptation
    if adaptation is None or not adaptation.unknown:
        return []
    about = (TEMPLATES / "learning.md.in").read_text(encoding="utf-8")
    unknown = ", ".join(f"`{entry.name}`" for entry in adaptation.unknown)
    return [Line(text) for text in replaced(about, {"unknown": unknown}).splitlines()]


def _library_words(program: Program, identity: Identity) -> dict[str, str]:
    """What the two descriptions of a library need: names and versions as their registries allow them."""
    sentence = comment(f"Controller of {program.derivation.model.title}")
    found = re.match(r"\d+\.\d+\.\d+", identity.version)
    return {
        "library_version": found[0] if found else "0.0.0",
        "sentence": sentence,
        "description": json.dumps(sentence),
        "slug": re.sub(r"[^a-z0-9]+", "-", identity.prefix.lower())[:_LONGEST].strip("-"),
    }


def _row(item: fields.Field, precision: Precision) -> str:
    value = str(int(item.value)) if item.kind == INTEGER else precision.literal(item.value)
    return f"| `{item.name}` | {value} | {comment(item.about).replace('|', '/')} |"


def _example(program: Program, precision: Precision) -> tuple[dict[str, list[Line]], dict[str, str]]:
    """The blocks and words of the example: a plant in numbers, its start at rest, the reference."""
    d, s = program.derivation, program.derivation.signals
    n, run, plant = d.plant.order, d.model.simulation, example_plant(d)
    spelling = {symbol: f"x[{i}]" for i, symbol in enumerate(s.x)}
    spelling |= {s.t: "t", s.u: "u", s.y: "x[0]", real_symbol("y0"): "y0"}
    printer = Printer(spelling, precision)
    following = (*s.x[1:], sp.Integer(0))
    rates = [
        f"    x_dot[{i}] = {printer.text(in_numbers(d, after + known))};"
        for i, (after, known) in enumerate(zip(following, plant.known_rates(s.u), strict=True))
    ]
    drift = [value.xreplace({s.y: real_symbol("y0")}) for value in plant.drift]
    rest = ["    x[0] = y0;"]
    rest += [f"    x[{i}] = {printer.text(in_numbers(d, -drift[i - 1]))}; /* at rest */" for i in range(1, n)]
    samples = max(1, min(_MOST, round(run.horizon / run.sample_time)))
    words = {
        "order": str(n),
        "y0": precision.literal(run.x0[0]),
        "samples": str(samples),
        "every": str(max(1, samples // _ROWS)),
    }
    lines = {"rates": rates, "rest": rest, "reference": _reference(program, printer)}
    return {name: [Line(text) for text in texts] for name, texts in lines.items()}, words


def _reference(program: Program, printer: Printer) -> list[str]:
    """The reference; a constant one, 0, where it is data."""
    d = program.derivation
    values = [d.equations[y_r.name].expression for y_r in d.signals.y_r]
    if d.model.segment:
        values = [sp.Integer(0)] * len(values)
    return [
        f"    in->{y_r} = {printer.text(in_numbers(d, value))};"
        for y_r, value in zip(d.signals.y_r, values, strict=True)
    ]
