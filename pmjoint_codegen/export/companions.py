"""The files beside the controller: example, build files, README."""

from __future__ import annotations

from typing import Final

import sympy as sp

from pmjoint_codegen.export import fields
from pmjoint_codegen.export.fields import INTEGER
from pmjoint_codegen.export.lines import Line, Printer, comment
from pmjoint_codegen.export.source import TEMPLATES, Identity, banner, filled, joined, words_of
from pmjoint_codegen.export.statements import Program
from pmjoint_codegen.export.tree import Precision
from pmjoint_derive import real_symbol

_MOST: Final = 20_000  # samples of the example
_ROWS: Final = 10  # of them printed


def companion_files(program: Program, identity: Identity, precision: Precision) -> dict[str, str]:
    """File name -> text."""
    words = words_of(program, identity, precision)
    words |= {"model": comment(identity.model), "rho": str(program.derivation.plant.rho)}
    blocks = {
        "banner": banner(program, identity, precision),
        "parameters": parameter_rows(program, precision),
    }
    example, numbers = _example(program, precision)
    found = {}
    for name in ("main.c", "Makefile", "CMakeLists.txt", "README.md"):
        template = (TEMPLATES / f"{name}.in").read_text(encoding="utf-8")
        found[name] = joined(filled(template, {**blocks, **example}, {**words, **numbers}))
    return found


def parameter_rows(program: Program, precision: Precision) -> list[Line]:
    """The parameters as rows of a table: name, default, meaning."""
    return [Line(_row(item, precision)) for item in fields.parameter_fields(program)]


def _row(item: fields.Field, precision: Precision) -> str:
    value = str(int(item.value)) if item.kind == INTEGER else precision.literal(item.value)
    return f"| `{item.name}` | {value} | {comment(item.about).replace('|', '/')} |"


def _example(program: Program, precision: Precision) -> tuple[dict[str, list[Line]], dict[str, str]]:
    """The blocks and words of the example: a plant in numbers, its start at rest, the reference."""
    d, s = program.derivation, program.derivation.signals
    n, run = d.plant.order, d.model.simulation
    spelling = {symbol: f"x[{i}]" for i, symbol in enumerate(s.x)}
    spelling |= {s.t: "t", s.u: "u", s.y: "x[0]", real_symbol("y0"): "y0"}
    printer = Printer(spelling, precision)
    following = (*s.x[1:], sp.Integer(0))
    rates = [
        f"    x_dot[{i}] = {printer.text(_in_numbers(program, after + known))};"
        for i, (after, known) in enumerate(zip(following, d.plant.known_rates(s.u), strict=True))
    ]
    drift = [value.xreplace({s.y: real_symbol("y0")}) for value in d.plant.drift]
    rest = ["    x[0] = y0;"]
    rest += [
        f"    x[{i}] = {printer.text(_in_numbers(program, -drift[i - 1]))}; /* at rest */"
        for i in range(1, n)
    ]
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
        f"    in->{y_r} = {printer.text(_in_numbers(program, value))};"
        for y_r, value in zip(d.signals.y_r, values, strict=True)
    ]


def _in_numbers(program: Program, value: sp.Expr) -> sp.Expr:
    """An expression with every parameter replaced by the model's number."""
    d, s = program.derivation, program.derivation.signals
    numbers = {item.symbol: sp.Float(item.value) for item in d.model.parameters}
    whole = d.equations.expand(value, keep=frozenset({s.y, s.u, s.t, *s.x}))
    return whole.xreplace(numbers)
