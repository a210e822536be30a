"""The operations that kernels consist of, one row each; all code that handles operations reads this table.

A column that needs CasADi, SymPy or mpmath is a function of the module that holds its building blocks: a
recurrence of `emit.recurrences`, a ball of `emit.balls`, a rounding of `check.oracles.rounding`. So the table
imports none of them, and the runtime can read it too.

A new function is one row: its spelling in C, its recurrence, its ball and its rounding. Lanes need no code of
their own: ``pmj_each(f, {0})`` calls the C library lane by lane.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Rule = Callable[[Any], Any]


@dataclass(frozen=True, kw_only=True)
class Operation:
    """One operation.

    Attributes:
        name: on tapes, and of the function in CasADi, mpmath, Python and C.
        arity: number of operands.
        opcodes: names of CasADi's numbers of it.
        scalar: C on doubles, ``{0}`` and ``{1}`` its operands. A printer types the literals in it.
        lanes: C on vectors of doubles.
        apply: what it is on numbers of any kind; None where a library's function of its name computes it.
        recurrence: gives the Taylor recurrence; None if there is none, as loops never see the operation.
        ball: gives the bound on a disc of the complex plane; None if there is none.
        rounding: gives the value with a bound on its error.
        written: whether a model file may call it.
        sympy: name of SymPy's class, empty if expressions have none.
        numpy: its name in NumPy 1, if different.
        exact: whether lanes give the same bits as IEEE 754 on doubles, without a library.
        entire: whether it has no singularity in the complex plane and grows at most like a polynomial on the
            real line; steps over such operations alone are compared at their end only.
        feature: argument at which a function that is flat or steep elsewhere is of order one.
        expands: whether SymPy expands its argument into real and imaginary parts, at any cost.
        rises: whether it increases everywhere, so its image of an interval lies between the end values.
        enclosure: gives its image of an interval, from interval context and interval; None if mpmath does.
    """

    name: str
    arity: int = 1
    opcodes: tuple[str, ...]
    scalar: str
    lanes: str
    apply: Callable[..., Any] | None = None
    recurrence: Rule | None = None
    ball: Rule | None = None
    rounding: Rule
    written: bool = False
    sympy: str = ""
    numpy: str = ""
    exact: bool = False
    entire: bool = False
    feature: float | None = None
    expands: bool = False
    rises: bool = False
    enclosure: Callable[[Any, Any], Any] | None = None

    def of(self, library: Any) -> Callable[..., Any]:
        """The operation on the numbers of a library, such as CasADi or Python's ``math``."""
        name = self.name if hasattr(library, self.name) else self.numpy
        function: Callable[..., Any] = self.apply or getattr(library, name)
        return function


OPERATIONS = (
    Operation(
        name="add",
        arity=2,
        opcodes=("OP_ADD",),
        scalar="{0} + {1}",
        lanes="{0} + {1}",
        apply=operator.add,
        recurrence=lambda r: r.linear(operator.add),
        ball=lambda b: b.linear(operator.add),
        rounding=lambda r: r.linear(operator.add),
        exact=True,
        entire=True,
    ),
    Operation(
        name="sub",
        arity=2,
        opcodes=("OP_SUB",),
        scalar="{0} - {1}",
        lanes="{0} - {1}",
        apply=operator.sub,
        recurrence=lambda r: r.linear(operator.sub),
        ball=lambda b: b.linear(operator.sub),
        rounding=lambda r: r.linear(operator.sub),
        exact=True,
        entire=True,
    ),
    Operation(
        name="neg",
        opcodes=("OP_NEG",),
        scalar="-{0}",
        lanes="-{0}",
        apply=operator.neg,
        recurrence=lambda r: r.linear(operator.neg),
        ball=lambda b: lambda a: b.Ball(-a.centre, a.radius, a.rest, a.constant),
        rounding=lambda r: lambda a: (-a.value, a.error),
        exact=True,
        entire=True,
    ),
    Operation(
        name="twice",
        opcodes=("OP_TWICE",),
        scalar="{0} + {0}",
        lanes="{0} + {0}",
        apply=lambda a: 2 * a,
        recurrence=lambda r: r.linear(lambda a: a.times(2.0)),
        ball=lambda b: lambda a: b.scaled(a, b.ca.SX(2)),
        rounding=lambda r: lambda a: (2 * a.value, 2 * a.error),
        exact=True,
        entire=True,
    ),
    Operation(
        name="mul",
        arity=2,
        opcodes=("OP_MUL",),
        scalar="{0} * {1}",
        lanes="{0} * {1}",
        apply=operator.mul,
        recurrence=lambda r: r.multiply,
        ball=lambda b: b.multiply,
        rounding=lambda r: r.multiply,
        exact=True,
        entire=True,
    ),
    Operation(
        name="sq",
        opcodes=("OP_SQ",),
        scalar="{0} * {0}",
        lanes="{0} * {0}",
        apply=lambda a: a * a,
        recurrence=lambda r: r.square,
        ball=lambda b: b.square,
        rounding=lambda r: lambda a: r.multiply(a, a),
        exact=True,
        entire=True,
    ),
    Operation(
        name="div",
        arity=2,
        opcodes=("OP_DIV",),
        scalar="{0} / {1}",
        lanes="{0} / {1}",
        apply=operator.truediv,
        recurrence=lambda r: r.divide,
        ball=lambda b: b.divide,
        rounding=lambda r: r.divide,
        exact=True,
    ),
    Operation(
        name="inv",
        opcodes=("OP_INV",),
        scalar="1.0 / {0}",
        lanes="1.0 / {0}",
        apply=lambda a: 1 / a,
        recurrence=lambda r: r.invert,
        ball=lambda b: lambda a: b.divide(b.fixed(b.ca.SX(1)), a),
        rounding=lambda r: r.invert,
        exact=True,
    ),
    Operation(
        name="sin",
        opcodes=("OP_SIN",),
        scalar="sin({0})",
        lanes="pmj_sin({0})",
        recurrence=lambda r: r.pair("sin", "cos", 1, -1),
        ball=lambda b: b.pair("sin", "cos"),
        rounding=lambda r: r.library("sin", 1.5, lambda x, e, value: e),
        written=True,
        sympy="sin",
        entire=True,
    ),
    Operation(
        name="cos",
        opcodes=("OP_COS",),
        scalar="cos({0})",
        lanes="pmj_cos({0})",
        recurrence=lambda r: r.pair("cos", "sin", -1, 1),
        ball=lambda b: b.pair("cos", "sin"),
        rounding=lambda r: r.library("cos", 1.5, lambda x, e, value: e),
        written=True,
        sympy="cos",
        entire=True,
    ),
    Operation(
        name="tan",
        opcodes=("OP_TAN",),
        scalar="tan({0})",
        lanes="pmj_tan({0})",
        recurrence=lambda r: r.riccati("tan", 1),
        ball=lambda b: b.tangent,
        rounding=lambda r: r.library("tan", 1.5, r.of_tangent),
        written=True,
        sympy="tan",
        feature=0.0,
    ),
    Operation(
        name="exp",
        opcodes=("OP_EXP",),
        scalar="exp({0})",
        lanes="pmj_exp({0})",
        recurrence=lambda r: r.exponential,
        # as a difference: far below a pulse e^r alone would overflow
        ball=lambda b: b.bounded("exp", lambda c, r: b.ca.exp(c + r) - b.ca.exp(c)),
        rounding=lambda r: r.library("exp", 1.5, r.of_exponential),
        written=True,
        sympy="exp",
        feature=0.0,
    ),
    Operation(
        name="log",
        opcodes=("OP_LOG",),
        scalar="log({0})",
        lanes="pmj_log({0})",
        recurrence=lambda r: r.inverse_slope("log", r.itself),
        ball=lambda b: b.bounded("log", b.log_radius),
        rounding=lambda r: r.library("log", 1.5, r.of_logarithm),
        written=True,
        sympy="log",
        feature=1.0,
    ),
    Operation(
        name="sqrt",
        opcodes=("OP_SQRT",),
        scalar="sqrt({0})",
        lanes="pmj_sqrt({0})",
        recurrence=lambda r: r.root,
        ball=lambda b: b.bounded("sqrt", lambda c, r: b.ca.sqrt(c) * (1.0 - b.ca.sqrt(1.0 - r / c))),
        rounding=lambda r: r.root,
        written=True,
        exact=True,
    ),
    Operation(
        name="tanh",
        opcodes=("OP_TANH",),
        scalar="tanh({0})",
        lanes="pmj_tanh({0})",
        recurrence=lambda r: r.riccati("tanh", -1),
        ball=lambda b: b.hyperbolic_tangent,
        rounding=lambda r: r.library("tanh", 2.5, r.of_hyperbolic_tangent),
        written=True,
        sympy="tanh",
        feature=0.0,
        expands=True,
        rises=True,
    ),
    Operation(
        name="atan",
        opcodes=("OP_ATAN",),
        scalar="atan({0})",
        lanes="pmj_atan({0})",
        recurrence=lambda r: r.inverse_slope("atan", r.one_plus_square(1)),
        # tan of the difference is w/(1 + c(c + w)), |w| <= r
        ball=lambda b: b.bounded(
            "atan", lambda c, r: b.inverse_hyperbolic(r / b.positive(1.0 + c * c - b.ca.fabs(c) * r))
        ),
        rounding=lambda r: r.library("atan", 1.5, lambda x, e, value: e),
        written=True,
        sympy="atan",
        numpy="arctan",
        feature=0.0,
        rises=True,
    ),
    Operation(
        name="sinh",
        opcodes=("OP_SINH",),
        scalar="sinh({0})",
        lanes="pmj_sinh({0})",
        recurrence=lambda r: r.pair("sinh", "cosh", 1, 1),
        # sinh(c + r) - sinh c, about c > 0, without a difference
        ball=lambda b: b.bounded(
            "sinh", lambda c, r: 2.0 * b.ca.sinh(0.5 * r) * b.ca.cosh(b.ca.fabs(c) + 0.5 * r)
        ),
        rounding=lambda r: r.library("sinh", 2.5, lambda x, e, value: e * r.above("cosh", abs(x) + e)),
        written=True,
        sympy="sinh",
        feature=0.0,
        expands=True,
        rises=True,
    ),
    Operation(
        name="cosh",
        opcodes=("OP_COSH",),
        scalar="cosh({0})",
        lanes="pmj_cosh({0})",
        recurrence=lambda r: r.pair("cosh", "sinh", 1, 1),
        ball=lambda b: b.bounded(
            "cosh", lambda c, r: 2.0 * b.ca.sinh(0.5 * r) * b.ca.sinh(b.ca.fabs(c) + 0.5 * r)
        ),
        rounding=lambda r: r.library("cosh", 2.5, lambda x, e, value: e * r.above("sinh", abs(x) + e)),
        written=True,
        sympy="cosh",
        feature=0.0,
        expands=True,
        enclosure=lambda m, a: (m.exp(a) + m.exp(-a)) / 2,
    ),
    Operation(
        name="pow",
        arity=2,
        opcodes=("OP_POW", "OP_CONSTPOW"),
        scalar="pow({0}, {1})",
        lanes="pmj_pow({0}, {1})",
        apply=operator.pow,
        recurrence=lambda r: r.constant_power,
        ball=lambda b: b.power,
        rounding=lambda r: r.power,
    ),
    Operation(
        name="fmin",
        arity=2,
        opcodes=("OP_FMIN",),
        scalar="pmj_fmin({0}, {1})",
        lanes="pmj_min({0}, {1})",
        rounding=lambda r: r.extreme(least=True),
        sympy="Min",
        exact=True,
    ),
    Operation(
        name="fmax",
        arity=2,
        opcodes=("OP_FMAX",),
        scalar="pmj_fmax({0}, {1})",
        lanes="pmj_max({0}, {1})",
        rounding=lambda r: r.extreme(least=False),
        sympy="Max",
        exact=True,
    ),
    Operation(
        name="fabs",
        opcodes=("OP_FABS",),
        scalar="fabs({0})",
        lanes="pmj_max({0}, -{0})",
        recurrence=lambda r: r.magnitude,
        rounding=lambda r: lambda a: (abs(a.value), a.error),
        sympy="Abs",
        exact=True,
    ),
    Operation(
        name="sign",
        opcodes=("OP_SIGN",),
        scalar="pmj_sign({0})",
        lanes="pmj_select({0} > 0.0, pmj_all(1.0), pmj_select({0} < 0.0, pmj_all(-1.0), pmj_all(0.0)))",
        recurrence=lambda r: r.sign,
        rounding=lambda r: (
            lambda a: (
                r.np.sign(a.value),
                r.np.where((abs(a.value) <= a.error) & (a.error > 0), 2.0, 0.0),  # 0 itself has a sign: 0
            )
        ),
        sympy="sign",
        exact=True,
    ),
)


def by_name() -> dict[str, Operation]:
    """Every operation by its name on tapes."""
    return {item.name: item for item in OPERATIONS}


def by_sympy() -> dict[str, Operation]:
    """Every function with a SymPy class, by that class's name."""
    return {item.sympy: item for item in OPERATIONS if item.sympy}


def functions() -> tuple[str, ...]:
    """The functions that a model file may call; a disturbance may also call abs, sign, min and max."""
    return tuple(item.name for item in OPERATIONS if item.written)


def remedy() -> str:
    """Text of a message about an operation that is none of these."""
    return f"use + - * / **, {', '.join(functions())}"
