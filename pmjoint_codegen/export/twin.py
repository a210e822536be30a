"""The exported controller in Python, in any arithmetic: exact, or with bounds on the C's rounding errors.

It takes the statements that the C is printed from. What stands around them in C, the start, the limits and
the order of a step, is stated here once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.export.bounds import Bounded, bounded_operations
from pmjoint_codegen.export.exact import context, exact_hold, exact_operations
from pmjoint_codegen.export.program import Program, Statement, next_symbol
from pmjoint_codegen.export.tree import Precision, Tree, evaluated, tree_of

Values = dict[sp.Symbol, Any]
DEGREE: Final = 14  # of Taylor's series of the hold
COMMAND: Final = sp.Symbol("command of the actuator", real=True)  # no model's own symbol has blanks


@dataclass(frozen=True)
class Arithmetic:
    """Numbers of one kind.

    Attributes:
        table: the operations by name.
        number: makes one from a double.
        between: clips one between two.
        hold: the exact hold of a matrix over T: two matrices, rows of numbers.
    """

    table: Mapping[str, Callable[..., Any]]
    number: Callable[[float], Any]
    between: Callable[[Any, Any, Any], Any]
    hold: Callable[[Sequence[Sequence[Any]], Any], tuple[Any, Any]]


def exact_arithmetic() -> Arithmetic:
    """Fifty digits."""
    mp = context()
    return Arithmetic(
        exact_operations(mp),
        mp.mpf,
        lambda value, low, high: max(low, min(value, high)),
        lambda A, T: exact_hold(mp, A, T),
    )


def bounded_arithmetic(precision: Precision) -> Arithmetic:
    """Doubles with bounds on the errors of the C in some precision; inputs and parameters are its numbers."""
    table = bounded_operations(precision)
    return Arithmetic(
        table,
        lambda value: Bounded(value, 0.0),
        _clipped,
        lambda A, T: _bounded_hold(table, A, T, precision.roundoff),
    )


def _clipped(value: Bounded, low: Bounded, high: Bounded) -> Bounded:
    found, above, below = (
        np.clip(value.value + shift, low.value, high.value) for shift in (0.0, value.error, -value.error)
    )
    spread = np.maximum(above - found, found - below)
    return Bounded(found, spread + np.maximum(low.error, high.error))


def _bounded_hold(
    table: Mapping[str, Callable[..., Any]], A: Sequence[Sequence[Bounded]], T: Bounded, roundoff: float
) -> tuple[Any, Any]:
    """Scaling, Taylor's series and squaring as in the C, each operation with its bound."""
    n = len(A)
    rows = range(n)
    values = np.array([[entry.value for entry in row] for row in A])
    halvings = _halvings(values, T.value)
    h = Bounded(np.ldexp(T.value, -halvings), T.error * 0.5**halvings)
    one, none = Bounded(1.0, 0.0), Bounded(0.0, 0.0)
    step = [[table["mul"](A[i][j], h) if values[i, j] else none for j in rows] for i in rows]

    def times(a: Any, b: Any) -> Any:
        found = [[none] * n for _ in rows]
        for i in rows:
            for j in rows:
                total = none
                for k in rows:
                    if a[i][k] is not none and b[k][j] is not none:
                        part = table["mul"](a[i][k], b[k][j])
                        total = part if total is none else table["add"](total, part)
                found[i][j] = total
        return found

    def plus_one(a: Any) -> Any:
        return [[table["add"](one, a[i][j]) if i == j else a[i][j] for j in rows] for i in rows]

    last = table["div"](one, Bounded(float(DEGREE + 1), 0.0))
    F = [[last if i == j else none for j in rows] for i in rows]
    for k in range(DEGREE, 0, -1):
        divisor = Bounded(float(k), 0.0)
        F = [
            [entry if entry is none else table["div"](entry, divisor) for entry in row]
            for row in plus_one(times(step, F))
        ]
    E = plus_one(times(step, F))
    F = [[entry if entry is none else table["mul"](entry, h) for entry in row] for row in F]
    for _ in range(halvings):
        product = times(E, F)
        F = [[_sum(table, F[i][j], product[i][j], none) for j in rows] for i in rows]
        E = times(E, E)
    rest = 2.0**-58  # of the series, relative to the largest entry; and so after squaring
    first, second = (
        [[entry if entry is none else _wider(entry, rest, matrix) for entry in row] for row in matrix]
        for matrix in (E, F)
    )
    return first, second


def _sum(table: Mapping[str, Callable[..., Any]], a: Bounded, b: Bounded, none: Bounded) -> Bounded:
    return b if a is none else a if b is none else table["add"](a, b)


def _wider(entry: Bounded, rest: float, matrix: Any) -> Bounded:
    largest = max(abs(item.value) for row in matrix for item in row)
    return Bounded(entry.value, entry.error + rest * largest * len(matrix))


def _halvings(A: Any, T: float) -> int:
    """How often the C halves: found from its result would be circular, so the norm without balancing."""
    norm = float(np.max(np.sum(np.abs(A), axis=1))) * T
    return max(0, int(np.frexp(norm / 0.5)[1])) if np.isfinite(norm) else 0


@dataclass
class Twin:
    """One controller.

    Attributes:
        program: its statements.
        arithmetic: of its numbers.
        parameters: by symbol, numbers of that arithmetic; with ``sample_time`` and ``matched`` apart.
        sample_time: T.
        matched: whether it starts matched.
    """

    program: Program
    arithmetic: Arithmetic
    parameters: Mapping[sp.Symbol, Any]
    sample_time: Any
    matched: bool
    values: Values = field(default_factory=dict)
    fixed: Values = field(default_factory=dict)
    ready: bool = False
    _trees: dict[sp.Expr, Tree] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.fixed = dict(self.parameters)
        for label, F, G in (("A0", "F0", "G0"), ("Ar", "Fr", "Gr")):
            self._hold(label, getattr(self.program.hold, F), getattr(self.program.hold, G))
        self.run(self.program.constants, self.fixed, self.fixed)

    def _hold(self, label: str, F: sp.ImmutableMatrix, G: sp.ImmutableMatrix) -> None:
        n = F.rows
        A = [[self.arithmetic.number(0.0) for _ in range(n)] for _ in range(n)]
        for entry in self.program.matrices:
            if entry.matrix == label:
                A[entry.row][entry.column] = self.of(entry.value, self.fixed)
        found = self.arithmetic.hold(A, self.sample_time)
        for symbols, matrix in zip((F, G), found, strict=True):
            self.fixed |= {symbols[i, j]: matrix[i][j] for i in range(n) for j in range(n)}

    def of(self, value: sp.Expr, known: Mapping[sp.Symbol, Any]) -> Any:
        """An expression's value."""
        if value not in self._trees:
            self._trees[value] = tree_of(value)
        return evaluated(self._trees[value], known, self.arithmetic.table)

    def run(self, statements: Iterable[Statement], known: Mapping[sp.Symbol, Any], into: Values) -> Values:
        """Evaluate statements one after the other, into a table by symbol."""
        values = known if known is into else {**self.fixed, **known}
        for item in statements:
            into[item.symbol] = values[item.symbol] = evaluated(item.tree, values, self.arithmetic.table)
        return into

    def reset(self, y: Any, y_r: Sequence[Any]) -> None:
        """The start, zero or matched to y and the reference."""
        s, zero = self.program.derivation.signals, self.arithmetic.number(0.0)
        self.values = {state: self.of(value, self.fixed) for state, value in self.program.rest.items()}
        self.values |= dict.fromkeys((s.v, *self.program.kept), zero)
        self.ready = False
        self.actuate(zero, first=True)
        if self.matched:
            given = {s.y: y, **dict(zip(s.y_r, y_r, strict=True))}
            found = {**self.fixed, **given, **self.run(self.program.start, given, {})}
            for state, value in self.program.starts.items():
                self.values[state] = self.of(value * s.compensator if state in s.r else value, found)

    def keep(self) -> None:
        """What the law of the present sample leaves for the update, if that has not been kept yet."""
        if self.program.kept:
            found = self.run(self.program.law, self.values, {})
            self.values |= {symbol: found[symbol] for symbol in self.program.kept}

    def advance(self) -> None:
        """The states over the hold that has ended."""
        found = self.run(self.program.update, self.values, {})
        self.values |= {state: found[next_symbol(state)] for state in self.program.states}

    def step(self, y: Any, y_r: Sequence[Any], measured_u: Any = None) -> Values:
        """One sample: z, x_hat, v, u by symbol; and ``command`` as the key of the command."""
        s = self.program.derivation.signals
        if self.ready:
            if measured_u is not None:
                self.values[s.u] = measured_u
            self.advance()
        self.values[s.y] = self.filtered(y)
        self.values |= dict(zip(s.y_r, y_r, strict=True))
        found = self.run(self.program.law, self.values, {})
        self.values |= {symbol: found[symbol] for symbol in (s.v, *self.program.kept)}
        self.actuate(found[s.v], first=False)
        self.ready = True
        return {**found, s.u: self.values[s.u], COMMAND: self.values[COMMAND]}

    def filtered(self, y: Any) -> Any:
        """What the controller makes of a reading."""
        chain, table = self.program.derivation.model.chain, self.arithmetic.table
        if "filter" not in chain or not self.ready:
            return y
        before = self.values[self.program.derivation.signals.y]
        exponent = table["mul"](table["neg"](self.fixed[chain["filter"]]), self.sample_time)
        gain = table["neg"](table["expm1"](exponent))
        return table["add"](before, table["mul"](gain, table["sub"](y, before)))

    def actuate(self, v: Any, *, first: bool) -> None:
        """The command and u, from v and the command before."""
        model, table, between = self.program.derivation.model, self.arithmetic.table, self.arithmetic.between
        low, high = (self.of(limit, self.fixed) for limit in model.limits)
        zone = None if model.dead_zone is None else self.of(model.dead_zone, self.fixed)
        wanted = v
        if zone is not None and not first:
            wanted = table["add"](v, table["mul"](zone, table["sign"](v)))
        if "rate" in model.chain and not first:
            reach = table["mul"](self.fixed[model.chain["rate"]], self.sample_time)
            before = self.values[COMMAND]
            wanted = between(wanted, table["sub"](before, reach), table["add"](before, reach))
        command = between(wanted, low, high)
        self.values[COMMAND] = command
        left = command
        if zone is not None:
            left = table["sub"](command, between(command, table["neg"](zone), zone))
        self.values[self.program.derivation.signals.u] = left
