"""The text of ``pmjoint_<model>.c`` and ``.h``: templates in ``c/`` with the statements filled in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pmjoint_codegen.export import fields
from pmjoint_codegen.export.fields import INTEGER, MATRIX, SAMPLE_TIME, Field
from pmjoint_codegen.export.hold import BAKED, COMPUTED, baked_matrices, shaping
from pmjoint_codegen.export.learning import conditions, kept_at_start, logits
from pmjoint_codegen.export.lines import Line, Printer, comment, identifier, spellings
from pmjoint_codegen.export.program import Program, next_symbol
from pmjoint_codegen.export.tree import Precision, operations_in
from pmjoint_codegen.export.twin import DEGREE

TEMPLATES: Final = Path(__file__).parent / "c"
_SIGN: Final = """\
/* -1, 0 or 1. */
static @real@ sign_of(@real@ x)
{
    return (x > 0.0@f@) ? 1.0@f@ : ((x < 0.0@f@) ? -1.0@f@ : 0.0@f@);
}
"""


@dataclass(frozen=True)
class Identity:
    """What an export is called and where it comes from.

    Attributes:
        model: name of the model.
        model_hash: of its file.
        version: of this package.
    """

    model: str
    model_hash: str
    version: str

    @property
    def prefix(self) -> str:
        """What every exported name begins with."""
        return "pmjoint_" + re.sub(r"\W", "_", self.model, flags=re.ASCII)


def filled(template: str, blocks: Mapping[str, Iterable[Line]], words: Mapping[str, str]) -> list[Line]:
    """A template with blocks in place of lines ``@block@``, and words in place of ``@word@``."""
    lines: list[Line] = []
    for text in template.splitlines():
        key = text.strip("@")
        lines += blocks[key] if text == f"@{key}@" and key in blocks else [Line(text)]
    return [Line(replaced(line.text, words), line.sources) for line in lines]


def replaced(text: str, words: Mapping[str, str]) -> str:
    """The text with every ``@word@`` replaced."""
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text


def words_of(
    program: Program, identity: Identity, precision: Precision, hold: str = COMPUTED
) -> dict[str, str]:
    """What stands for each word of the templates."""
    model = program.derivation.model
    baked = hold == BAKED
    return {
        "or_baked": ", or the baked-in hold is of another sample_time or gain" if baked else "",
        "or_guess": ", or a guess, range or gain makes no sense" if conditions(program.derivation) else "",
        "rest": ", estimates rest" if program.learnt else "",
        "prepared": "the baked-in hold" if baked else "the exact hold for params->sample_time",
        "baked_for": ", ".join(f"`{name}`" for name in _shaping_fields(program)),
        "name": identity.prefix,
        "NAME": identity.prefix.upper(),
        "real": precision.name,
        "f": precision.suffix,
        "title": comment(f"{model.title}. {model.source}".strip()),
        "hash": identity.model_hash,
        "version": identity.version,
        "DEGREE": str(DEGREE),
        "SIZE": str(program.size),
        "ROWS_A0": str(program.hold.F0.rows),
        "ROWS_AR": str(program.hold.Fr.rows),
    }


def banner(program: Program, identity: Identity, precision: Precision) -> list[Line]:
    """Who made the file, from what."""
    model = program.derivation.model
    return [
        Line(f"/* {comment(model.title)}"),
        Line(f" * Output-feedback controller of the model {comment(identity.model)}, in {precision.name}."),
        Line(f" * Made by pmjoint export {identity.version}, model {identity.model_hash[:16]}; do not edit."),
        Line(" * Numbers in brackets are equations of Cai, Qian, Yu, Shen, IEEE Access 8 (2020)."),
        Line(" */"),
    ]


def source_lines(
    program: Program,
    identity: Identity,
    precision: Precision,
    self_test: Iterable[Line],
    hold: str = COMPUTED,
) -> list[Line]:
    """The lines of the C file.

    Args:
        program: what to print.
        identity: names and hash.
        precision: double or float.
        self_test: the lines of the self test.
        hold: `COMPUTED` by init, or `BAKED` in.
    """
    baked = hold == BAKED
    printer = Printer(spellings(program), precision)
    free = [state for state in program.states if state not in logits(program.derivation)]
    template = (TEMPLATES / "controller.c.in").read_text(encoding="utf-8")
    blocks = {
        "banner": banner(program, identity, precision),
        "helpers": _helpers(program),
        "defaults": _defaults(program, precision),
        "hold_code": _hold_code(program, precision, baked=baked),
        "matrices": list(_literals(program, precision) if baked else _computed(program, printer)),
        "constants": [*_filter_gain(program, precision), *printer.constants(program.constants)],
        "finite": _finite(program),
        "take": [Line(f"    s->{y_r} = in->{y_r};") for y_r in program.derivation.signals.y_r],
        "can_start": _can_start(program, printer),
        "zeros": _zeros(program, printer),
        "rest": list(_rest(program, printer)),
        "start": [Line("    " + line.text) for line in _start(program, printer)],
        "update": list(_update(program, printer)),
        "confine": [Line(f"    s->{item} = confined(s->{item}, &flags);") for item in free],
        "law": [*printer.locals(program.law), *_outputs(program), *_keeping(program)],
        "actuate": list(_actuate(program, printer)),
        "measure": list(_measure(program, precision)),
        "sampled": [Line(f"    state->learns = {value};") for value in ("0",) if program.learnt],
        "learns": [Line("        state->learns = 1;")] if program.learnt else [],
        "report": [Line(f"    out->{name} = state->{name};") for name in ("v", "command", "u")],
        "self_test": list(self_test),
    }
    words = words_of(program, identity, precision)
    sound = ["in->y", *(f"in->{y_r}" for y_r in program.derivation.signals.y_r)]
    words |= {"const": "" if program.kept else "const "}
    words = {"sound": " && ".join(f"(isfinite({name}) != 0)" for name in sound), **words}
    refused = ["(params->sample_time <= 0.0@f@)", "(are_finite(constants) == 0)"]
    refused += ["(can_start(params) == 0)"] if conditions(program.derivation) else []
    words = {"refused": " || ".join([*refused, *(["(fits_hold(params) == 0)"] if baked else [])]), **words}
    return filled(template, blocks, words)


def _hold_code(program: Program, precision: Precision, *, baked: bool) -> list[Line]:
    """The matrix exponential; or, where the hold is baked in, the check that it fits."""
    text = (TEMPLATES / ("baked.c.in" if baked else "hold.c.in")).read_text(encoding="utf-8")
    own = {item.name: item.value for item in fields.parameter_fields(program)}
    compared = [
        Line(text)
        for name in _shaping_fields(program)
        for text in (
            f"    if (are_equal(p->{name}, {precision.literal(own[name])}) == 0) {{",
            "        fits = 0;",
            "    }",
        )
    ]
    return filled(text, {"compared": compared}, {})


def _shaping_fields(program: Program) -> list[str]:
    """The fields of the parameters that shape the matrices of the hold."""
    return [SAMPLE_TIME, *(identifier(symbol.name) for symbol in shaping(program))]


def _computed(program: Program, printer: Printer) -> Iterator[Line]:
    """The matrices A0 and Ar, and their hold."""
    yield Line("    matrix A0 = {{0.0@f@}};")
    yield Line("    matrix Ar = {{0.0@f@}};")
    yield from printer.matrix(program.matrices)
    yield Line("    hold(@ROWS_A0@, A0, p->sample_time, c->F0, c->G0);")
    yield Line("    hold(@ROWS_AR@, Ar, p->sample_time, c->Fr, c->Gr);")


def _literals(program: Program, precision: Precision) -> Iterator[Line]:
    """The hold in numbers; the matrices that it is made of are not in the C."""
    for name, matrix in baked_matrices(program, precision).items():
        for i, row in enumerate(matrix):
            for j, value in enumerate(row):
                yield Line(f"    c->{name}[{i}][{j}] = {precision.literal(value)};")


def _helpers(program: Program) -> list[Line]:
    groups = (program.constants, program.law, program.update, program.start)
    used = set[str]().union(*(operations_in(item.tree) for group in groups for item in group))
    return [Line(text) for text in _SIGN.splitlines()] if "sign" in used else []


def _defaults(program: Program, precision: Precision) -> list[Line]:
    return [
        Line(
            f"    params->{item.name} = "
            f"{int(item.value) if item.kind == INTEGER else precision.literal(item.value)};"
        )
        for item in fields.parameter_fields(program)
    ]


def _filter_gain(program: Program, precision: Precision) -> Iterator[Line]:
    chain = program.derivation.model.chain
    if "filter" in chain:
        yield Line("    /* exact hold of the sensor's filter */")
        corner = f"p->{identifier(chain['filter'].name)}"
        yield Line(f"    c->filter_gain = -expm1{precision.suffix}(-{corner} * p->sample_time);")


def _finite(program: Program) -> list[Line]:
    return [
        Line(text)
        for item in fields.constant_fields(program)
        if item.kind != MATRIX
        for text in (f"    if (isfinite(c->{item.name}) == 0) {{", "        finite = 0;", "    }")
    ]


def _can_start(program: Program, printer: Printer) -> list[Line]:
    """The check of guesses, ranges and gains; nothing where all is known."""
    found = conditions(program.derivation)
    if not found:
        return []
    said = [
        f"({printer.operand(item.lhs, tight=True)} {item.rel_op} {printer.operand(item.rhs, tight=True)})"
        for item in found
    ]
    return [
        Line("/* Whether guesses, ranges and gains are such that the estimates keep the sign of b_m. */"),
        Line("static int can_start(const @name@_params *p)"),
        Line("{"),
        Line(f"    return ({said[0]}"),
        *(Line(f"        && {text}") for text in said[1:]),
        Line("    ) ? 1 : 0;"),
        Line("}"),
        Line(""),
    ]


def _zeros(program: Program, printer: Printer) -> list[Line]:
    zero = printer.precision.literal(0.0)
    found = [Line(f"    s->{state} = {printer.text(value)};") for state, value in program.rest.items()]
    names = ["y", *map(str, program.derivation.signals.y_r)]
    found += [Line(f"    s->{name} = {zero};") for name in names]
    found += [
        Line(f"    s->{identifier(symbol.name)} = {printer.text(value)};")
        for symbol, value in kept_at_start(program.derivation).items()
    ]
    return [*found, *([Line("    s->learns = 0;")] if program.learnt else [])]


def _kept_names(program: Program) -> list[str]:
    return [identifier(symbol.name) for symbol in program.kept]


def _keeping(program: Program) -> Iterator[Line]:
    for name in _kept_names(program):
        yield Line(f"    s->{name} = {name};")


def _rest(program: Program, printer: Printer) -> Iterator[Line]:
    lower, upper = (printer.text(limit) for limit in program.derivation.model.limits)
    yield Line(f"    s->command = between({printer.precision.literal(0.0)}, {lower}, {upper});")
    yield from _left(program, printer)


def _left(program: Program, printer: Printer) -> Iterator[Line]:
    zone = program.derivation.model.dead_zone
    if zone is None:
        yield Line("    s->u = s->command;")
    else:
        width = printer.text(zone)
        yield Line(f"    s->u = s->command - between(s->command, -{width}, {width});")


def _start(program: Program, printer: Printer) -> Iterator[Line]:
    s = program.derivation.signals
    yield from printer.locals(program.start)
    for state, value in program.starts.items():
        text = printer.text(value * s.compensator if state in s.r else value)
        yield Line(f"    s->{state} = {text};")


def _update(program: Program, printer: Printer) -> Iterator[Line]:
    kept = {symbol: f"s->{identifier(symbol.name)}" for symbol in program.kept}
    yield from Printer({**printer.spelling, **kept}, printer.precision).locals(program.update)
    for state in program.states:
        if state not in program.learnt:
            yield Line(f"    s->{state} = {next_symbol(state)};")
    if program.learnt:
        yield Line("    if (s->learns != 0) {")
        yield from (Line(f"        s->{state} = {next_symbol(state)};") for state in program.learnt)
        yield Line("    }")


def _outputs(program: Program) -> Iterator[Line]:
    for symbol in (*program.estimate, *program.derivation.signals.z):
        yield Line(f"    out->{symbol} = {symbol};")


def _actuate(program: Program, printer: Printer) -> Iterator[Line]:
    model, real, zero = program.derivation.model, printer.precision.name, printer.precision.literal(0.0)
    lower, upper = (printer.text(limit) for limit in model.limits)
    wanted = "v"
    if model.dead_zone is not None:
        width = printer.text(model.dead_zone)
        yield Line("    /* beyond the dead zone */")
        yield Line(
            f"    const {real} wanted = (v > {zero}) ? (v + {width}) : ((v < {zero}) ? (v - {width}) : v);"
        )
        wanted = "wanted"
    if "rate" in model.chain:
        yield Line("    /* no further from the last command than the actuator's rate allows */")
        yield Line(f"    const {real} reach = {printer.text(model.chain['rate'])} * p->sample_time;")
        near = f"between({wanted}, s->command - reach, s->command + reach)"
        yield Line(f"    const {real} reached = {near};")
        wanted = "reached"
    yield Line("    /* (10) within the limits */")
    yield Line(f"    s->command = between({wanted}, {lower}, {upper});")
    yield from _left(program, printer)


def _measure(program: Program, precision: Precision) -> Iterator[Line]:
    if "filter" not in program.derivation.model.chain:
        yield Line("        state->y = in->y;")
        return
    whole = f"(state->ready == 0) || (constants->filter_gain >= {precision.literal(1.0)})"
    yield Line(f"        if ({whole}) {{")
    yield Line("            state->y = in->y;")
    yield Line("        } else {")
    step = "state->y + (constants->filter_gain * (in->y - state->y))"
    yield Line(f"            state->y = confined({step}, &flags);")
    yield Line("        }")


def header_text(program: Program, identity: Identity, precision: Precision, hold: str = COMPUTED) -> str:
    """The header's text."""
    template = (TEMPLATES / "controller.h.in").read_text(encoding="utf-8")
    size = f"{identity.prefix.upper()}_SIZE"

    def declared(items: Iterable[Field]) -> list[Line]:
        return [Line(_declaration(item, precision, size)) for item in items]

    blocks = {
        "banner": banner(program, identity, precision),
        "params": declared(fields.parameter_fields(program)),
        "constants": declared(fields.constant_fields(program)),
        "state": declared(fields.state_fields(program)),
        "input": declared(fields.input_fields(program)),
        "output": declared(fields.output_fields(program)),
    }
    return joined(filled(template, blocks, words_of(program, identity, precision, hold)))


def _declaration(item: Field, precision: Precision, size: str) -> str:
    kind = "int" if item.kind == INTEGER else precision.name
    shape = f"[{size}][{size}]" if item.kind == MATRIX else ""
    return f"    {kind} {item.name}{shape}; /**< {comment(item.about)} */"


def joined(lines: Iterable[Line]) -> str:
    """The text of some lines."""
    return "\n".join(line.text.rstrip() for line in lines) + "\n"
