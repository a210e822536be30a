r"""A derivation as a LaTeX document (class article, package amsmath) in the paper's notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import sympy as sp

from pmjoint_codegen.report.notation import (
    escape,
    latex_expression,
    latex_name,
    latex_prose,
    latex_unit,
    scaled_sum,
)
from pmjoint_codegen.report.sections import by_section, own_parameters
from pmjoint_codegen.values import GAINS, from_si
from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model, Parameter
from pmjoint_derive.sampling import SECTION as SAMPLED
from pmjoint_derive.true_plant import SECTION as TRUE_PLANT

_WIDTH = 62  # printed characters of a line of mathematics, about what 16 cm hold

_PREAMBLE = r"""\documentclass[11pt,a4paper]{article}
\usepackage[utf8]{inputenc}
\usepackage{amsmath}
\usepackage[margin=22mm]{geometry}
\setlength{\parindent}{0pt}
\allowdisplaybreaks
"""

_HELD = (
    r"With the sample time $T$ and $A_r$ for the matrix of (23): $F_0 = e^{A_0 T}$, "
    r"$G_0 = \int_0^T e^{A_0 \tau}\,d\tau$, $\mathrm{Fr} = e^{A_r T}$, "
    r"$\mathrm{Gr} = \int_0^T e^{A_r \tau}\,d\tau$."
)


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
        rf"\author{{\parbox{{0.9\linewidth}}{{\centering {escape(model.source)}}}}}",
    ]
    lines += [r"\begin{document}", r"\maketitle", _scope(model), "", *_parameters(model.parameters)]
    lines += ["", r"\medskip", _gains(model)]
    for section, members in by_section(equations):
        lines += ["", rf"\section*{{{escape(section)}}}"]
        if section == TRUE_PLANT:
            pairs = own_parameters(model, members).items()
            same = ", ".join(f"${latex_name(own)} = {latex_name(name)}$" for own, name in pairs)
            lines.append(f"Where no other value is set, the plant has what the controller believes: {same}.")
        if section == SAMPLED:
            lines.append(_HELD)
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
    yield r"\begin{tabular}{@{}lllp{0.6\linewidth}@{}}"
    for item in parameters:
        unit = "" if item.unit in ("", "1") else latex_unit(item.unit)
        value = from_si(item.value, item.scale)
        yield rf"${latex_name(item.name)}$ & ${value:g}$ & {unit} & {latex_prose(item.about)} \\"
    yield r"\end{tabular}"


def _gains(model: Model) -> str:
    values = model.gains.by_kind
    lists = ", ".join(
        f"${kind.latex} = ({', '.join(f'{x:g}' for x in values[kind.name])})$" for kind in GAINS
    )
    switch = f"${latex_name('compensator')} = {int(model.gains.compensator)}$"
    return f"Gains: {lists}. The switch {switch} is 1 where the compensator (23) works and 0 where $r = 0$."


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
    lines = list(_filled(_signed(terms)))
    if len(lines) == 1 or _length(whole) <= _WIDTH:
        return [f"{left} = {whole}"]
    if factor != 1:
        lines = [rf"{latex_expression(factor)} \Bigl[ {lines[0]}", *lines[1:-1], rf"{lines[-1]} \Bigr]"]
    first, *rest = lines
    body = [rf"{left} ={{}}& {first}", *(rf"& {line}" for line in rest)]
    return [r"\begin{aligned}", " \\\\\n".join(body), r"\end{aligned}"]


def _signed(terms: list[sp.Expr]) -> Iterator[str]:
    """Give the terms of a sum, each but the first with its sign; a term that no line holds, in pieces."""
    for i, term in enumerate(terms):
        for piece in _pieces(term):
            yield piece if i == 0 or piece[0] in "-+" else f"+ {piece}"


def _pieces(term: sp.Expr) -> list[str]:
    """Give a product whole or, where it is too long for a line, as a factor and the terms of its sum."""
    whole = latex_expression(term)
    factor, terms = scaled_sum(term)
    if _length(whole) <= _WIDTH or factor == 1 or len(terms) < 2:
        return [whole]
    inner = list(_signed(terms))
    return [
        rf"{latex_expression(factor)} \Bigl( {inner[0]}",
        *(text if text[0] in "-+" else f"+ {text}" for text in inner[1:-1]),
        rf"{inner[-1]} \Bigr)",
    ]


def _filled(terms: Iterable[str]) -> Iterator[str]:
    """Fill lines with terms."""
    line = ""
    for text in terms:
        if line and _length(line) + _length(text) > _WIDTH:
            yield line
            line = text
        else:
            line = f"{line} {text}" if line else text
    yield line


def _length(latex: str) -> int:
    """Estimate how many characters a line of LaTeX prints.

    A fraction is as wide as its wider half; what stands beside a sign between terms is as wide as another.
    """
    symbols = re.sub(r"[_^]\{([^{}]*)\}", r"\1", latex.replace(r"\left", "").replace(r"\right", ""))
    symbols = re.sub(r"\\(?!frac)[A-Za-z]+(?:\{(\w)\})?", "x", symbols)
    fraction = re.compile(r"\\frac\{([^{}]*)\}\{([^{}]*)\}")
    while fraction.search(symbols):
        symbols = fraction.sub(lambda halves: max(halves.groups(), key=len), symbols)
    return len(re.sub(r"[{}_^\s\\]", "", symbols)) + len(re.findall(r" [-+] ", symbols))
