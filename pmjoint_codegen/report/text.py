"""A derivation as plain text that can be pasted into code: comments explain, assignments compute."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import sympy as sp

from pmjoint_codegen.report.notation import scaled_sum, text_expression
from pmjoint_codegen.report.sections import by_section, own_parameters
from pmjoint_codegen.values import from_si
from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model
from pmjoint_derive.sampling import SECTION as SAMPLED
from pmjoint_derive.true_plant import SECTION as TRUE_PLANT

_WIDTH = 96  # characters of an assignment before it is broken at its terms
_COLUMN = 44  # where the comment behind a short assignment begins

_HELD = (
    "# F0_ij, G0_ij: entries of expm(A0 T) and of the integral of expm(A0 tau) over the sample time T;",
    "# Fr_ij, Gr_ij: the same for the matrix of (23)",
)


def text_report(model: Model, equations: Iterable[Equation]) -> str:
    """Print a derivation, section by section.

    Args:
        model: what was derived from.
        equations: the derivation, in its order.

    Returns:
        lines in Python's syntax, without a newline at the end.
    """
    lines = [*_heading(model), *_parameters(model)]
    for section, members in by_section(equations):
        lines += ["", f"# {section}", "# " + "-" * len(section), ""]
        if section == TRUE_PLANT:
            lines += [
                _commented(f"{own} = {name}", "the plant's own, unless another value is set")
                for own, name in own_parameters(model, members).items()
            ]
        if section == SAMPLED:
            lines += _HELD
        for equation in members:
            lines += equation_lines(equation)
    return "\n".join(lines)


def _heading(model: Model) -> Iterator[str]:
    plant = model.plant
    yield f"# {model.title}"
    if model.source:
        yield f"# {model.source}"
    yield f"# order n = {plant.order}, zeros m = {plant.m}, relative degree rho = {plant.rho}"
    yield "# numbers in brackets are the paper's; x_dot is a time derivative, da_db a partial derivative"


def _parameters(model: Model) -> list[str]:
    lines = ["", "# Parameters", "# ----------", ""]
    for item in model.parameters:
        statement = f"{item.name} = {from_si(item.value, item.scale)!r}"
        lines.append(_commented(statement, _remark("", item.about, item.unit)))
    for stem, values in model.gains.by_kind.items():
        if not values:
            continue
        names = ", ".join(f"{stem}{i}" for i in range(1, len(values) + 1))
        lines.append(f"{names} = {', '.join(f'{value!r}' for value in values)}")
    lines.append(
        _commented(
            f"compensator = {int(model.gains.compensator)}", _remark("(23)", "1: at work, 0: r = 0", "")
        )
    )
    scale = f"input_scale = {from_si(model.gains.input_scale, model.measures.input_scale)!r}"
    lines.append(_commented(scale, "not in the paper; 1: the paper's law. It weighs z_i, i > 1, in V"))
    if model.gains.braking is not None:
        remark = _remark("", "share of the limit of u", "")
        lines.append(_commented(f"braking = {model.gains.braking!r}", remark))
    if model.gains.observer is not None:
        lines.append(_commented(f"observer = {model.gains.observer!r}", _remark("", "bandwidth", "1/s")))
    if model.gains.matched:
        lines.append("# a run starts at the matched start")
    return lines


def equation_lines(equation: Equation) -> list[str]:
    """Print one equation: a line with its remark or, when it is long, the remark and a line for each term."""
    assignment = f"{equation.name} = {text_expression(equation.expression)}"
    unit = "" if equation.unit is None else str(equation.unit)
    remark = _remark(equation.number, equation.meaning, unit)
    if len(assignment) <= _COLUMN:
        return [_commented(assignment, remark)]
    if len(assignment) <= _WIDTH:
        return [f"# {remark}", assignment]
    factor, terms = scaled_sum(equation.expression)
    opening = "(" if factor == 1 else f"{text_expression(factor)} * ("
    return [f"# {remark}", f"{equation.name} = {opening}", *(f"    {term}" for term in _signed(terms)), ")"]


def _signed(terms: list[sp.Expr]) -> Iterator[str]:
    """Print the terms of a sum, each with its sign."""
    for index, term in enumerate(terms):
        text = text_expression(term)
        if text.startswith("-"):
            yield f"- {text[1:]}"
        else:
            yield text if index == 0 else f"+ {text}"


def _remark(number: str, meaning: str, unit: str) -> str:
    bracketed = f"[{unit}]" if unit and unit != "1" else ""
    return " ".join(part for part in (number, meaning, bracketed) if part)


def _commented(statement: str, remark: str) -> str:
    return f"{statement:<{_COLUMN}}  # {remark}" if remark else statement
