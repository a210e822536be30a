r"""A derivation as a LaTeX document (class article, package amsmath) in the paper's notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import sympy as sp

from derive.equation import Equation
from derive.model import Model, Parameter
from derive.true_plant import SECTION as TRUE_PLANT
from pmjoint_codegen.report.notation import escape, latex_expression, latex_name, latex_prose, scaled_sum
from pmjoint_codegen.report.sections import by_section, own_parameters

_WIDTH = 62  # printed characters of a line of mathematics, about what 16 cm hold

_PREAMBLE = r"""\documentclass[11pt,a4paper]{article}
\usepackage[utf8]{inputenc}
\usepackage{amsmath}
\usepackage[margin=25mm]{geometry}
\setlength{\parindent}{0pt}
\allowdisplaybreaks
"""


def latex_report(model: Model, equations: Iterable[Equation]) -> str:
    """Print a derivation as a document that compiles as it stands.

    Args:
        model: what was derived from.
        equations: the derivation, in its order.

    Returns:
        the LaTeX source, without a newline at the end.
    """
    lines = [
        _PREAMBLE,
        rf"\title{{{escape(model.title)}}}",
        r"\date{}",
        rf"\author{{{escape(model.source)}}}",
    ]
    lines += [r"\begin{document}", r"\maketitle", _scope(model), "", *_parameters(model.parameters)]
    for section, members in by_section(equations):
        lines += ["", rf"\section*{{{escape(section)}}}"]
        if section == TRUE_PLANT:
            pairs = own_parameters(model, members).items()
            same = ", ".join(f"${latex_name(own)} = {latex_name(name)}$" for own, name in pairs)
            lines.append(f"Where no other value is set, the plant has what the controller believes: {same}.")
        for equation in members:
            lines += ["", *_display(equation)]
    return "\n".join([*lines, "", r"\end{document}"])


def _scope(model: Model) -> str:
    plant = model.plant
    return (
        f"Order $n = {plant.order}$, zeros $m = {plant.m}$, relative degree $\\rho = {plant.rho}$. Numbers "
        "in brackets are equations of the paper; an equation without a number is a step of the derivation."
    )


def _parameters(parameters: tuple[Parameter, ...]) -> Iterator[str]:
    yield r"\section*{Parameters}"
    yield r"\begin{tabular}{@{}llll@{}}"
    for item in parameters:
        unit = "" if item.unit in ("", "1") else latex_unit(item.unit)
        yield rf"${latex_name(item.name)}$ & ${item.value:g}$ & {unit} & {latex_prose(item.about)} \\"
    yield r"\end{tabular}"


def _display(equation: Equation) -> Iterator[str]:
    unit = (
        "" if equation.unit is None or str(equation.unit) == "1" else f" [{latex_unit(str(equation.unit))}]"
    )
    yield f"{latex_prose(equation.meaning)}{unit}"
    environment = "equation" if equation.number else "equation*"
    yield rf"\begin{{{environment}}}"
    if equation.number:
        yield rf"\tag{{{equation.number.strip('()')}}}"
    yield from _broken(latex_name(equation.name), equation.expression)
    yield rf"\end{{{environment}}}"


def _broken(left: str, expression: sp.Expr) -> list[str]:
    """Give the equation on one line, or broken between terms where the line would be too long."""
    whole = latex_expression(expression)
    factor, terms = scaled_sum(expression)
    lines = list(_filled(terms))
    if len(lines) == 1 or _length(whole) <= _WIDTH:
        return [f"{left} = {whole}"]
    if factor != 1:
        lines = [rf"{latex_expression(factor)} \Bigl[ {lines[0]}", *lines[1:-1], rf"{lines[-1]} \Bigr]"]
    first, *rest = lines
    body = [rf"{left} ={{}}& {first}", *(rf"& {line}" for line in rest)]
    return [r"\begin{aligned}", " \\\\\n".join(body), r"\end{aligned}"]


def _filled(terms: list[sp.Expr]) -> Iterator[str]:
    """Fill lines with the terms of a sum, each with its sign."""
    line = ""
    for term in terms:
        text = latex_expression(term)
        signed = text if text.startswith("-") else f"+ {text}"
        if line and _length(line) + _length(signed) > _WIDTH:
            yield line
            line = signed
        else:
            line = f"{line} {signed}" if line else text
    yield line


def _length(latex: str) -> int:
    """Estimate how many characters a line of LaTeX prints: a fraction is as wide as its wider half."""
    symbols = re.sub(r"[_^]\{([^{}]*)\}", r"\1", latex.replace(r"\left", "").replace(r"\right", ""))
    symbols = re.sub(r"\\(?!frac)[A-Za-z]+(?:\{(\w)\})?", "x", symbols)
    fraction = re.compile(r"\\frac\{([^{}]*)\}\{([^{}]*)\}")
    while fraction.search(symbols):
        symbols = fraction.sub(lambda halves: max(halves.groups(), key=len), symbols)
    return len(re.sub(r"[{}_^\s\\]", "", symbols))


def latex_unit(unit: str) -> str:
    r"""Set a unit such as ``rad/(s^2 V)`` upright, with its powers raised."""
    pieces = re.split(r"(\^-?\d+)", unit)
    return "".join(f"$^{{{piece[1:]}}}$" if piece.startswith("^") else escape(piece) for piece in pieces)
