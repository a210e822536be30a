r"""A derivation as a LaTeX document (class article, packages of every LaTeX) in the paper's notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import starmap

from pmjoint_codegen.report.notation import (
    escape,
    latex_name,
    latex_number,
    latex_prose,
    latex_unit,
)
from pmjoint_codegen.report.rows import equation_rows, too_wide
from pmjoint_codegen.report.sections import by_section, own_parameters
from pmjoint_codegen.values import GAINS, from_si
from pmjoint_derive.adaptation import Adaptation
from pmjoint_derive.equation import Equation
from pmjoint_derive.model import Model, Parameter
from pmjoint_derive.sampling import SECTION as SAMPLED
from pmjoint_derive.true_plant import SECTION as TRUE_PLANT

_PREAMBLE = r"""\documentclass[11pt,a4paper]{article}
\usepackage[utf8]{inputenc}
\usepackage{amsmath}
\usepackage[margin=22mm]{geometry}
\usepackage{graphicx,tabularx}
\setlength{\parindent}{0pt}
\setlength{\emergencystretch}{3em}
\allowdisplaybreaks
\newsavebox{\formula}
\newlength{\room}
% a formula that cannot be broken: smaller, where it would not fit beside its number
\newcommand{\shrunk}[1]{%
  \sbox{\formula}{$\displaystyle #1$}\setlength{\room}{\linewidth}\addtolength{\room}{-3em}%
  \ifdim\wd\formula>\room \resizebox{\room}{!}{\usebox{\formula}}\else\usebox{\formula}\fi}
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
    lines += ["", r"\medskip", _breakable(gains(model))]
    for section, members in by_section(equations):
        lines += ["", rf"\section*{{{escape(section)}}}"]
        lines += map(_breakable, section_note(section, model, members))
        for equation in members:
            lines += ["", *_display(equation)]
    return "\n".join([*lines, "", r"\end{document}"])


def section_note(section: str, model: Model, members: Iterable[Equation]) -> list[str]:
    """Say what a section needs besides its equations: at most one paragraph."""
    if section == TRUE_PLANT:
        pairs = own_parameters(model, members).items()
        if not pairs:
            return []
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
    yield r"\begin{tabularx}{\linewidth}{@{}lll>{\raggedright\arraybackslash}X@{}}"
    for item in parameters:
        unit = "" if item.unit in ("", "1") else latex_unit(item.unit)
        value = from_si(item.value, item.scale)
        yield rf"${latex_name(item.name)}$ & ${latex_number(value)}$ & {unit} & {latex_prose(item.about)} \\"
    yield r"\end{tabularx}"


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
    if model.gains.observer is not None:
        bandwidth = _equal("observer", model.gains.observer)
        text += f" The observer has all its poles at $-{latex_name('observer')}$, {bandwidth}."
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
    return text + (_least_squares(adaptation) if adaptation.least_squares else _tuning(adaptation))


def _tuning(adaptation: Adaptation) -> str:
    """Give the gains of tuning functions, and of the estimate of 1/b_m, in sentences."""
    rates = ", ".join(_equal(entry.gamma.name, entry.gain) for entry in adaptation.unknown)
    text = f" Adaptation gains: {rates}. Leakage {_equal('leakage', adaptation.leakage)} pulls the estimates"
    text += " towards their priors."
    inverse = adaptation.inverse
    if inverse is None:
        return text
    values = {"rho_guess": inverse.guess, "gamma_rho": inverse.gain, "rho_leakage": inverse.leakage}
    found = ", ".join(starmap(_equal, {**values, "rho_prior": inverse.prior}.items()))
    return f"{text} The estimate ${latex_name('rho_hat')}$ of $1/b_m$ has {found}."


def _least_squares(adaptation: Adaptation) -> str:
    """Give the settings of least squares in a sentence."""
    squares = adaptation.least_squares
    if squares is None:
        return ""
    values = {"ls_kappa": squares.kappa, "ls_forgetting": squares.forgetting, "ls_P0": squares.P0}
    found = ", ".join(starmap(_equal, {**values, "ls_k_max": squares.k_max}.items()))
    return f" Least squares with {found} give the estimates."


def _equal(name: str, value: float) -> str:
    return f"${latex_name(name)} = {latex_number(value)}$"


def _breakable(sentence: str) -> str:
    """Let a line of text end behind a comma inside a formula, as in a list of gains."""
    return re.sub(r"\$[^$]+\$", lambda formula: formula[0].replace(", ", r",\allowbreak "), sentence)


def _display(equation: Equation) -> Iterator[str]:
    unit = (
        "" if equation.unit is None or str(equation.unit) == "1" else f" [{latex_unit(str(equation.unit))}]"
    )
    yield f"{latex_prose(equation.meaning)}{unit}"
    environment = "equation" if equation.number else "equation*"
    yield rf"\begin{{{environment}}}"
    if equation.number:
        yield rf"\tag{{{equation.number.strip('()')}}}"
    rows = equation_rows(equation)
    yield from [r"\shrunk{", *rows, "}"] if too_wide(equation, rows) else rows
    yield rf"\end{{{environment}}}"
