"""The exact hold in numbers, with the bits that the exported C finds for the model's own parameters.

It takes the operations of ``c/hold.c.in`` one by one, in the type of the C.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import sympy as sp

from pmjoint_codegen.export.fields import defaults
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.tree import Precision, Tree, evaluated, number, tree_of
from pmjoint_codegen.export.twin import DEGREE

COMPUTED: Final = "computed"
BAKED: Final = "baked"
HOLDS: Final = (COMPUTED, BAKED)
_ROUNDS: Final = 4  # of balancing

Matrix = list[list[Any]]


def shaping(program: Program) -> list[sp.Symbol]:
    """The parameters that shape the matrices of the hold, besides the sample time."""
    found = set[Any]().union(*(entry.value.free_symbols for entry in program.matrices))
    return [symbol for symbol in program.parameters if symbol in found]


def baked_matrices(program: Program, precision: Precision) -> dict[str, list[list[float]]]:
    """F0, G0, Fr and Gr by name, rows of numbers of the precision.

    Args:
        program: for the matrices and the model's own parameters.
        precision: of the C.
    """
    kind: Any = np.float32 if precision.suffix else np.float64
    values = {symbol: kind(value) for symbol, value in defaults(program, precision).items()}
    T = kind(program.derivation.model.simulation.sample_time)

    def literal(tree: Tree) -> Any:
        return kind(number(tree))

    table: dict[str, Callable[..., Any]] = {
        "number": literal,
        "add": operator.add,
        "sub": operator.sub,
        "neg": operator.neg,
    }
    table |= {"mul": operator.mul, "div": operator.truediv}
    found: dict[str, list[list[float]]] = {}
    for label, n, names in (
        ("A0", int(program.hold.F0.rows), ("F0", "G0")),
        ("Ar", int(program.hold.Fr.rows), ("Fr", "Gr")),
    ):
        A = [[kind(0.0)] * n for _ in range(n)]
        for entry in program.matrices:
            if entry.matrix == label:
                A[entry.row][entry.column] = evaluated(tree_of(entry.value), values, table)
        with np.errstate(all="ignore"):  # what overflows is no finite number in the C either
            for name, matrix in zip(names, _hold(A, T, kind), strict=True):
                found[name] = [[float(entry) for entry in row] for row in matrix]
    return found


def _hold(A: Matrix, T: Any, kind: Any) -> tuple[Matrix, Matrix]:
    """``expm(A T)`` and its integral."""
    n = len(A)
    norm = _norm(A, kind) * T
    _, exponent = np.frexp((norm if np.isfinite(norm) else kind(0.0)) / kind(0.5))
    halvings = max(0, int(exponent))
    h = np.ldexp(T, -halvings)
    one = [[kind(float(i == j)) for j in range(n)] for i in range(n)]
    step = [[entry * h for entry in row] for row in A]
    F = [[entry * (kind(1.0) / kind(DEGREE + 1)) for entry in row] for row in one]
    for k in range(DEGREE, 0, -1):
        F = [[entry / kind(k) for entry in row] for row in _sum(one, _product(step, F))]
    E = _sum(one, _product(step, F))
    F = [[entry * h for entry in row] for row in F]
    for _ in range(halvings):
        F = _sum(F, _product(E, F))
        E = _product(E, E)
    return E, F


def _norm(A: Matrix, kind: Any) -> Any:
    """Largest sum of magnitudes in a row, after balancing by powers of two."""
    M = [[abs(entry) for entry in row] for row in A]
    n = len(M)
    for _ in range(_ROUNDS if n > 1 else 0):
        for i in range(n):
            row = _total(M[i]) - M[i][i]
            column = _total([line[i] for line in M]) - M[i][i]
            if row > 0 and column > 0:
                half = int(np.frexp(row / column)[1]) // 2
                M[i] = [np.ldexp(entry, -half) for entry in M[i]]
                for line in M:
                    line[i] = np.ldexp(line[i], half)
    return max((_total(row) for row in M), default=kind(0.0))


def _total(entries: list[Any]) -> Any:
    """The sum from left to right."""
    total = entries[0]
    for entry in entries[1:]:
        total = total + entry
    return total


def _product(a: Matrix, b: Matrix) -> Matrix:
    n = range(len(a))
    return [[_total([a[i][k] * b[k][j] for k in n]) for j in n] for i in n]


def _sum(a: Matrix, b: Matrix) -> Matrix:
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]
