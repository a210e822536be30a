"""The records of an exported controller: its statements, the matrices of its hold, and what it remembers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp

from pmjoint_codegen.export.learning import learnt_states, rest_values
from pmjoint_codegen.export.tree import Tree, joined, tree_of
from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.hold import Hold
from pmjoint_derive.start import start_symbol


@dataclass(frozen=True)
class Statement:
    """``symbol = factor (sum of terms)`` in C.

    Attributes:
        symbol: the left-hand side.
        factor: of all terms; 1 for a plain sum.
        terms: what is added.
        equation: name of the derivation's equation that it belongs to.
        number: the equation's number, such as ``(29)``, or empty.
        meaning: one line for the reader.
        unit: physical unit of the left-hand side, empty if it has none.
        sources: the derivation's own form of each term, in the same order; empty where it is a part only.
    """

    symbol: sp.Symbol
    factor: sp.Expr
    terms: tuple[sp.Expr, ...]
    equation: str
    number: str
    meaning: str
    unit: str
    sources: tuple[sp.Expr, ...] = ()

    @property
    def divisor(self) -> sp.Expr | None:
        """What the sum is divided by, where the factor is an inverse."""
        return 1 / self.factor if self.factor.is_Pow and self.factor.exp.could_extract_minus_sign() else None

    @cached_property
    def tree(self) -> Tree:
        """The right-hand side, in the order of its operations in C."""
        total = joined(list(self.terms))
        if self.factor == 1:
            return total
        if self.divisor is not None:
            return Tree("div", (total, tree_of(self.divisor)))
        return Tree("mul", (tree_of(self.factor), total))


@dataclass(frozen=True)
class MatrixEntry:
    """An entry of A0 of (14) or of the matrix of (23) that is not zero, and the terms that it stands for.

    Attributes:
        matrix: ``A0`` or ``Ar``.
        row: from 0.
        column: from 0.
        value: an expression of parameters.
        number: of the equations.
        sources: (equation, term) of each term of a rate that this entry gives.
    """

    matrix: str
    row: int
    column: int
    value: sp.Expr
    number: str
    sources: tuple[tuple[str, sp.Expr], ...]


@dataclass(frozen=True)
class Program:
    """All statements of one controller.

    Attributes:
        derivation: where they come from.
        hold: symbols of the exact hold.
        parameters: symbols that the statements use, in the order of the model file, then gains.
        matrices: entries of the matrices that the hold is made of.
        constants: computed once.
        law: at a sample, from y, the controller's states and the reference.
        update: over the hold that ends there, from y, u, v and the states at its beginning.
        start: the matched start, from y and the reference.
        states: the controller's states.
        estimate: symbols of x_hat.
        kept: what the law finds at a sample and the update at the end of its hold reads.
    """

    derivation: Derivation
    hold: Hold
    parameters: tuple[sp.Symbol, ...]
    matrices: tuple[MatrixEntry, ...]
    constants: tuple[Statement, ...]
    law: tuple[Statement, ...]
    update: tuple[Statement, ...]
    start: tuple[Statement, ...]
    states: tuple[sp.Symbol, ...]
    estimate: tuple[sp.Symbol, ...]
    kept: tuple[sp.Symbol, ...]

    @cached_property
    def learnt(self) -> tuple[sp.Symbol, ...]:
        """The states that the controller learns in."""
        return learnt_states(self.derivation)

    @cached_property
    def rest(self) -> dict[sp.Symbol, sp.Expr]:
        """State -> its value at the start that is not matched."""
        return rest_values(self.derivation)

    @property
    def starts(self) -> dict[sp.Symbol, sp.Expr]:
        """State -> its value at the matched start, a name or 0; that of r without the factor compensator."""
        made = {item.symbol for item in (*self.start, *self.constants)}
        names = {state: start_symbol(state) for state in self.states}
        return {state: name if name in made else sp.Integer(0) for state, name in names.items()}

    @property
    def size(self) -> int:
        """Rows of the larger of the two matrices."""
        return max(int(self.hold.F0.rows), int(self.hold.Fr.rows))


def next_symbol(state: sp.Symbol) -> sp.Symbol:
    """A state one sample later."""
    return real_symbol(f"{state.name}_next")


def drive_symbol(state: sp.Symbol) -> sp.Symbol:
    """What drives a linear state: the part of its rate without states of its own block."""
    return real_symbol(f"{state.name}_drive")
