r"""A derivation as a LaTeX document (class article, package amsmath) in the paper's notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import sympy as sp

from pmjoint_codegen.report.notation import (
    escape,
    latex_expression,
    latex_name,
    latex_number,
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
    lines += [r"\begin{document}", r"\maketitle", scope(model), "", *_parameters(model.parameters)]
    lines += ["", r"\medskip", gains(model)]
    for section, members in by_section(equations):
        lines += ["", rf"\section*{{{escape(section)}}}"]
        lines += section_note(section, model, members)
        for equation in members:
            lines += ["", *_display(equation)]
    return "\n".join([*lines, "", r"\end{document}"])


def section_note(section: str, model: Model, members: Iterable[Equation]) -> list[str]:
    """Say what a section needs besides its equations: at most one paragraph."""
    if section == TRUE_PLANT:
        pairs = own_parameters(model, members).items()
        same = ", ".join(f"${latex_name(own)} = {latex_name(name)}$" for own, name in pairs)
        return [f"Where no other value is set, the plant has what the controller believes: {same}."]
    return [_HELD] if section == SAMPLED else []


def scope(model: Model) -> str:
    """Give order, zeros and relative degree in a sentence, and say what the numbers of equations are."""
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
        yield rf"${latex_name(item.name)}$ & ${latex_number(value)}$ & {unit} & {latex_prose(item.about)} \\"
    yield r"\end{tabular}"


def gains(model: Model) -> str:
    """Give the gains in a sentence."""
    values = model.gains.by_kind
    lists = ", ".join(
        f"${kind.latex} = ({', '.join(map(latex_number, values[kind.name]))})$"
        for kind in GAINS
        if values[kind.name]
    )
    switch = f"${latex_name('compensator')} = {int(model.gains.compensator)}$"
    text = f"Gains: {lists}. The switch {switch} is 1 where the compensator (23) works and 0 where $r = 0$."
    kappa = from_si(model.gains.input_scale, model.measures.input_scale)
    scale = f"${latex_name('input_scale')} = {latex_number(kappa)}$"
    text += (
        f" The input scale {scale}, which the paper does not have, weighs $z_i$, $i > 1$, in $V$; "
        "1 gives the paper's law."
    )
    if model.gains.braking is not None:
        share = f"${latex_name('braking')} = {latex_number(model.gains.braking)}$"
        text += f" The compensator brakes with the share {share} of the limit of $u$."
    text += _guesses(model)
    return text + (" A run starts at the matched start." if model.gains.matched else "")


def _guesses(model: Model) -> str:
    """Give guesses in a sentence, and what the controller does with them."""
    adaptation = model.adaptation
    if adaptation is None:
        return ""
    names = (
        f"${latex_name(entry.guess_symbol.name)} = {latex_number(entry.guess)}$"
        for entry in adaptation.entries
    )
    text = f" The controller takes {', '.join(names)}"
    unknown = adaptation.unknown
    if not unknown:
        return f"{text} for the plant's."
    hats = ", ".join(f"${latex_name(entry.estimate.name)}$" for entry in unknown)
    text += f" and estimates {hats} from there"
    ranges = [
        f"${latex_name(entry.estimate.name)} \\in ({', '.join(map(latex_number, entry.range))})$"
        for entry in unknown
        if entry.range is not None
    ]
    text += f", each within its range: {', '.join(ranges)}." if ranges else "."
    if adaptation.least_squares is None:
        rates = ", ".join(
            f"${latex_name(entry.gamma.name)} = {latex_number(entry.gain)}$" for entry in unknown
        )
        pull = f"${latex_name('leakage')} = {latex_number(adaptation.leakage)}$"
        text += f" Adaptation gains: {rates}. Leakage {pull} pulls the estimates towards their priors."
    return text


def _display(equation: Equation) -> Iterator[str]:
    unit = (
        "" if equation.unit is None or str(equation.unit) == "1" else f" [{latex_unit(str(equation.unit))}]"
    )
    yield f"{latex_prose(equation.meaning)}{unit}"
    environment = "equation" if equation.number else "equation*"
    yield rf"\begin{{{environment}}}"
    if equation.number:
        yield rf"\tag{{{equation.number.strip('()')}}}"
    yield from equation_rows(equation)
    yield rf"\end{{{environment}}}"


def equation_rows(equation: Equation, *, fill: bool = True) -> list[str]:
    """Give an equation on one line, or broken between terms where the line would be too long.

    Args:
        equation: what to print.
        fill: put as many terms into a line as it holds. Without it, each term has its own, and a change of
            one leaves the others where they were.
    """
    left, expression = latex_name(equation.name), equation.expression
    whole = latex_expression(expression)
    factor, terms = scaled_sum(expression)
    rows = list(_signed(terms))
    filled = list(_filled(rows))
    if len(filled) == 1 or _length(whole) <= _WIDTH:
        return [f"{left} = {whole}"]
    first, *rest = filled if fill else rows
    if factor != 1:
        first, rest[-1] = rf"{latex_expression(factor)} \Bigl[ {first}", rf"{rest[-1]} \Bigr]"
    return [r"\begin{aligned}", f"{left} ={{}}& {first}", *(rf"\\ & {row}" for row in rest), r"\end{aligned}"]


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
