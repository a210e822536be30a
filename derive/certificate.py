"""V, its rate and its bound (19), (30)-(35) as named equations, from the expressions of `lyapunov`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import sympy as sp

from pmjoint_derive.closed_loop import disturbance_symbols, output_disturbance
from pmjoint_derive.design import Derivation
from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.lyapunov import (
    certified_rate,
    error_function,
    error_weight,
    given_away,
    lyapunov_function,
    projected_symbols,
)
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix, symmetric_matrix
from pmjoint_derive.signals import Signals

READABLE = 4  # order up to which P is written in the gains: its entries grow threefold with each order

Row = tuple[str, sp.Expr, str, str]  # name, expression, number in the paper, meaning


def certificate_equations(derivation: Derivation) -> tuple[Equation, ...]:
    """(19), (30) and (32)-(35) as named equations, for a reader: no kernel is made of them.

    P is given in the gains k, or in numbers where that would fill pages; its largest eigenvalue ``lambda_P``,
    which is its norm, has no such form and is the number at the model's gains. Without a bound of the
    disturbance there is no Y and no bound of V'. The terms of V have different units, so that nothing here
    has one.
    """
    s, plant, bound = derivation.signals, derivation.plant, derivation.model.disturbance_bound
    short = plant.order <= READABLE
    P, solved = symmetric_matrix(plant.order), lyapunov_matrix(s) if short else matrix_at_gains(derivation)
    symbols, PD = disturbance_symbols(plant), projected_symbols(plant.order)
    acting = [symbol if rate != 0 else rate for symbol, rate in zip(symbols, plant.disturbance, strict=True)]
    V_epsilon, V_lost = real_symbol("V_epsilon"), real_symbol("V_lost")
    rows = [
        (
            P[i, j].name,
            solved[i, j],
            "",
            "entry of P of the Lyapunov equation below (14)"
            + ("" if short else ", at the gains of the model"),
        )
        for i in range(plant.order)
        for j in range(i, plant.order)
    ]
    rows += [
        (
            "V_epsilon",
            error_function(s, P),
            "(19)",
            "Lyapunov function of the estimation error",
        ),
        ("V", lyapunov_function(s, V_epsilon), "(30)", "Lyapunov function"),
        *(
            (name.name, value, "", "entry of P D")
            for name, value in zip(PD, P * sp.Matrix(acting), strict=True)
        ),
        (
            "V_lost",
            sum(given_away(derivation), sp.Integer(0)),
            "",
            "what (32) gives away: squares with positive factors",
        ),
        ("V_dot", certified_rate(derivation, PD) - V_lost, "(32)", "rate of V under the law, whatever u is"),
        *_decay(derivation),
    ]
    if bound is not None:
        rows += _residual(derivation, bound)
    taken = {item.name for item in derivation.model.parameters} | set(derivation.equations)
    return named_rows(rows, taken)


def named_rows(rows: Sequence[Row], taken: Collection[str]) -> tuple[Equation, ...]:
    """Rows as equations of their section, with other names where a model has its own use of them.

    Args:
        rows: what is stated.
        taken: names that mean something else.
    """
    free = {
        real_symbol(name): real_symbol(f"{name}_of_V") for name, *_ in rows if name in taken
    }  # nothing here speaks of the plant's parameters, so a name of theirs can only mean our own
    return tuple(
        Equation(
            free.get(real_symbol(name), real_symbol(name)),
            expression.xreplace(free),
            "Certificate",
            number,
            meaning,
            None,
        )
        for name, expression, number, meaning in rows
    )


def least_rate(s: Signals) -> sp.Expr:
    """``f_-`` of (34), with ``1/(4 e_2)`` where the paper prints ``1/(4 e_1)`` twice."""
    return sp.Min(*s.c, *(1 / (4 * e) for e in s.e))


def greatest_weight(s: Signals, lambda_P: sp.Symbol) -> sp.Expr:
    """``f_+`` of (34), given the largest eigenvalue of P."""
    return sp.Max(sp.Rational(1, 2), *(lambda_P / (2 * e) for e in s.e))


def residual(derivation: Derivation, lambda_P: sp.Symbol, D_max: sp.Symbol) -> sp.Expr:
    """``Y`` of (33), given the largest eigenvalue of P and the bound of the disturbance."""
    norm = lambda_P**2
    factor = norm if output_disturbance(derivation.plant) == 0 else 2 * norm + 1
    return error_weight(derivation.signals) * factor * D_max**2


def _decay(derivation: Derivation) -> list[Row]:
    """(34): name, expression, number and meaning of each constant."""
    s, largest = derivation.signals, real_symbol("lambda_P")
    rate = real_symbol("f_minus") / real_symbol("f_plus")
    return [
        (
            "lambda_P",
            largest_eigenvalue(matrix_at_gains(derivation)),
            "",
            "largest eigenvalue of P, at the gains of the model",
        ),
        (
            "f_minus",
            least_rate(s),
            "(34)",
            "least rate in (32), with every e, where (34) prints the first one twice",
        ),
        ("f_plus", greatest_weight(s, largest), "(34)", "greatest weight in (30)"),
        ("f", rate, "(35)", "rate at which V decays at least"),
    ]


def _residual(derivation: Derivation, bound: float) -> list[Row]:
    """(33) and (35), likewise."""
    V, Y, f, D_max = (real_symbol(name) for name in ("V", "Y", "f", "D_max"))
    return [
        ("D_max", sp.Rational(repr(bound)), "(9)", "bound of the disturbance"),
        (
            "Y",
            residual(derivation, real_symbol("lambda_P"), D_max),
            "(33)",
            "what the disturbance adds at most",
        ),
        ("V_dot_max", Y - f * V, "(35)", "V_dot is at most this"),
    ]


def matrix_at_gains(derivation: Derivation) -> sp.ImmutableMatrix:
    """P at the filter gains of the model, exactly."""
    numbers = tuple(sp.Rational(repr(gain)) for gain in derivation.model.gains.k)
    return lyapunov_matrix(replace(derivation.signals, k=numbers))


def largest_eigenvalue(P: sp.ImmutableMatrix) -> sp.Float:
    """The largest eigenvalue of a symmetric matrix of numbers, to 15 digits."""
    roots = sp.Poly(P.charpoly().as_expr()).nroots(n=30, maxsteps=200)
    return sp.Float(max(sp.re(root) for root in roots), 15)
