"""The linear transformation to output-feedback form, where the physics is linear beside y.

For ``w' = A w + psi(y) + gamma(y) u`` with constant A and ``w_1 = y``, and the characteristic polynomial
``s^n + a_1 s^(n-1) + ... + a_n`` of A, the rows

    T_1 = e_1',   T_{i+1} = T_i A + a_i e_1'

give ``x = T w`` with ``x_i' = x_{i+1} - a_i y + T_i psi(y) + T_i gamma(y) u``, and ``T_{n+1} = 0`` by Cayley
and Hamilton: the observer canonical form. T is regular where (A, e_1') is observable. Terms of y itself stand
in psi, so the first column of A is 0. Nothing is integrated: gravity, springs, motors, lags are all of this
kind. See H. Nijmeijer, A. J. van der Schaft, Nonlinear Dynamical Control Systems, 1990, chapter 5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.dependence import settled
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.physics import Physics, Y
from pmjoint_derive.shield import shielded


class UnobservableError(Exception):
    """Some states do not reach the output.

    Attributes:
        states: those.
    """

    def __init__(self, states: Sequence[sp.Symbol]) -> None:
        """Store the states."""
        super().__init__(", ".join(map(str, states)))
        self.states = tuple(states)


@dataclass(frozen=True)
class Form:
    """A transformation of physics to ``x_i' = x_{i+1} + phi_i(y) + gain_i(y) u``, ``y = x_1``.

    Attributes:
        forward: n expressions: x in the physical states.
        back: physical state -> its value in x1 ... xn.
        phi: n functions of y.
        gain: n functions of y.
    """

    forward: tuple[sp.Expr, ...]
    back: Mapping[sp.Symbol, sp.Expr]
    phi: tuple[sp.Expr, ...]
    gain: tuple[sp.Expr, ...]


def coordinates(order: int) -> tuple[sp.Symbol, ...]:
    """Symbols x1 ... xn."""
    return tuple(real_symbol(f"x{i}") for i in range(1, order + 1))


def observer_form(physics: Physics) -> Form | None:
    """Transform physics that is linear beside y; None where it is not.

    Raises:
        UnobservableError: a state does not reach the output.
    """
    pivot = _pivot(physics)
    if pivot is None:
        return None
    state, value = pivot
    others = tuple(item for item in physics.states if item != state)
    seen = {state: value}  # the measured state by way of y
    index = {item: i for i, item in enumerate(physics.states)}

    def rates_of(column: Sequence[sp.Expr], whole: sp.Expr) -> list[sp.Expr]:
        return [item.xreplace(seen) for item in (whole, *(column[index[other]] for other in others))]

    linear = _linear(rates_of(physics.drift, physics.along(physics.output)), others)
    driven = [settled(item, others) for item in rates_of(physics.gain, physics.driven(physics.output))]
    if linear is None or any(item.free_symbols & set(others) for item in driven):
        return None
    A, psi = linear
    T, lower = _rows(A)
    x = coordinates(len(physics.states))
    w = _inverse(T, x, others)
    phi = tuple(tidied(_dot(T.row(i), psi) - lower[i] * Y, (Y,)) for i in range(len(psi)))
    gain = tuple(tidied(_dot(T.row(i), driven), (Y,)) for i in range(len(psi)))
    whole = (physics.output, *others)
    forward = tuple(tidied(_dot(T.row(i), whole), physics.states) for i in range(len(psi)))
    back = {other: tidied(form, x) for other, form in zip(others, w[1:], strict=True)}
    back[state] = tidied(value.xreplace({**back, Y: x[0]}), x)
    return Form(forward, {item: back[item] for item in physics.states}, phi, gain)


def tidied(value: sp.Expr, moving: Sequence[sp.Symbol]) -> sp.Expr:
    """One coefficient of parameters for each product of moving quantities, functions left as written."""
    return shielded(lambda whole: _collected(whole, moving), value, moving)


def _collected(whole: sp.Expr, moving: Sequence[sp.Symbol]) -> sp.Expr:
    """Collect terms; what `shielded` hides counts as moving where it stands for a function."""
    table: dict[sp.Expr, list[sp.Expr]] = {}
    for term in sp.Add.make_args(sp.expand(whole)):
        moves = [s for s in term.free_symbols if s in moving or s.name.startswith("opaque ")]
        constant, rest = term.as_independent(*moves, as_Add=False) if moves else (term, sp.Integer(1))
        table.setdefault(rest, []).append(constant)
    return sum((sp.factor(sp.Add(*parts)) * rest for rest, parts in table.items()), sp.Integer(0))


def _pivot(physics: Physics) -> tuple[sp.Symbol, sp.Expr] | None:
    """A state that the output holds linearly, and its value in y and the other states."""
    output, states = physics.output, physics.states
    slopes = {state: settled(sp.diff(output, state), states) for state in states}
    if any(slope.free_symbols & set(states) for slope in slopes.values()):
        return None
    held = [state for state in states if slopes[state] != 0]
    if not held:
        raise UnobservableError(states)
    state = held[0]
    rest = output.xreplace({state: sp.Integer(0)})
    return state, (Y - rest) / slopes[state]


def _linear(
    rates: Sequence[sp.Expr], others: tuple[sp.Symbol, ...]
) -> tuple[sp.Matrix, list[sp.Expr]] | None:
    """A and psi of ``A w + psi(y)``, A with a first column of zeros; None where a coefficient moves."""
    moving = (Y, *others)
    A = sp.zeros(len(rates), len(rates))
    for i, rate in enumerate(rates):
        for k, other in enumerate(others, start=1):
            slope = settled(sp.diff(rate, other), moving)
            if slope.free_symbols & set(moving):
                return None
            A[i, k] = slope
    nothing = dict.fromkeys(others, sp.Integer(0))
    return A, [rate.xreplace(nothing) for rate in rates]


def _rows(A: sp.Matrix) -> tuple[sp.Matrix, list[sp.Expr]]:
    """T, and ``a_1 ... a_n`` of the characteristic polynomial."""
    order = A.rows
    lower = [sp.factor(value) for value in A.charpoly(sp.Dummy("s")).all_coeffs()[1:]]
    rows = [sp.Matrix([[int(k == 0) for k in range(order)]])]
    for a in lower[:-1]:
        rows.append((rows[-1] * A + a * rows[0]).applyfunc(sp.factor))
    return sp.Matrix.vstack(*rows), lower


def _inverse(T: sp.Matrix, x: tuple[sp.Symbol, ...], others: tuple[sp.Symbol, ...]) -> tuple[sp.Expr, ...]:
    """W in terms of x."""
    if sp.factor(T.det()) == 0:
        kernel = T.nullspace()
        hidden = [other for i, other in enumerate(others, start=1) if any(v[i] != 0 for v in kernel)]
        raise UnobservableError(hidden)
    return tuple(T.LUsolve(sp.Matrix(x)))


def _dot(row: sp.Matrix, column: Sequence[sp.Expr]) -> sp.Expr:
    return sum((a * b for a, b in zip(row, column, strict=True)), sp.Integer(0))
