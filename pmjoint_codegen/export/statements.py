"""The statements of an exported controller, read off the equations of a derivation.

Three groups, each in an order in which it can be computed. ``constants`` depend on parameters alone and are
computed once; ``law`` is (24)-(29) and the estimate (15) at a sample; ``update`` takes filters (14) and
compensator (23) over one hold; ``start`` is the matched start. A factor of parameters alone is taken out of
each term and becomes a constant too, so a step divides by none of them. Of a design with estimates ``update``
moves these too; see `learning`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.export.learning import kept_symbols, learnt_states, rest_values
from pmjoint_codegen.export.tree import Tree, joined, tree_of
from pmjoint_codegen.report.notation import scaled_sum
from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.equation import Equation
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.hold import Hold
from pmjoint_derive.signals import derivative_name, named
from pmjoint_derive.start import SECTION as START
from pmjoint_derive.start import start_symbol

CHAINED: Final = ("rate", "dead_zone", "filter")  # keys of actuator and sensor that the controller acts on


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


def program_of(derivation: Derivation) -> Program:
    """Read the statements off a derivation.

    Raises:
        ModelError: the design's observer is not stepped by an exact hold, which an export is made of.
    """
    if not derivation.design.exact_hold:
        raise ModelError(
            f'law = "{derivation.model.design}" is not exported: it is a law to compare with, in simulation',
            where=f"model {derivation.model.name}: design.law",
            remedy='give law = "backstepping"',
        )
    return _Reader(derivation).program()


@dataclass
class _Reader:
    """Collects statements; constants grow as terms are read."""

    derivation: Derivation
    constants: list[Statement] = field(default_factory=list)
    known: dict[sp.Expr, sp.Symbol] = field(default_factory=dict)

    def __post_init__(self) -> None:
        d, s = self.derivation, self.derivation.signals
        self.hold = Hold.of(s)
        self.settable = (*(item.symbol for item in d.model.parameters), *s.gains)
        self.fixed = {*self.settable, *self.hold.symbols}  # what constants may consist of
        self.names = {symbol.name for symbol in self.fixed}
        self.inputs = {s.y, s.u, s.v, *s.y_r, *s.controller_state}

    def program(self) -> Program:
        d, s = self.derivation, self.derivation.signals
        x_hat = named("x_hat", len(s.xi))
        matrices = (*self.matrix("A0", filter_matrix(s)), *self.matrix("Ar", compensator_matrix(s)))
        kept = kept_symbols(d)
        law = self.group((*s.z, *s.alpha, s.v, *x_hat, *kept), taken=self.inputs - {s.v})
        update = self.updates(kept)
        start = self.group([start_symbol(state) for state in s.controller_state], self.inputs)
        program = Program(
            d,
            self.hold,
            (),
            matrices,
            tuple(self.constants),
            law,
            update,
            start,
            s.controller_state,
            x_hat,
            kept,
        )
        chained = {symbol for key, symbol in d.model.chain.items() if key in CHAINED}
        begun = set[sp.Symbol]().union(*(value.free_symbols for value in program.rest.values()))
        used = _used(program) | {s.compensator, *chained, *_limits(d), *begun}
        present = tuple(symbol for symbol in self.settable if symbol in used)
        return replace(program, parameters=present)

    def group(self, targets: Iterable[sp.Symbol], taken: set[sp.Symbol]) -> tuple[Statement, ...]:
        """The equations that some names need, each after what it needs, without those of parameters alone.

        Args:
            targets: the names.
            taken: what is given and needs no equation.
        """
        equations = self.derivation.equations
        wanted: list[str] = []

        def need(symbol: sp.Symbol) -> None:
            if symbol.name in equations and symbol not in taken and symbol.name not in wanted:
                order = [item for item in equations if item in names(equations[symbol.name].expression)]
                for name in order:
                    need(equations[name].symbol)
                wanted.append(symbol.name)

        def names(value: sp.Expr) -> set[str]:
            return {item.name for item in value.free_symbols}

        places = {name: place for place, name in enumerate(equations)}
        for symbol in sorted(targets, key=lambda item: places.get(item.name, -1)):
            need(symbol)
        return tuple(item for name in wanted for item in self.statement(equations[name]))

    def statement(self, equation: Equation) -> Iterator[Statement]:
        """An equation as a statement; one of parameters alone joins the constants."""
        factor, terms = scaled_sum(equation.expression)
        sources = tuple(terms)
        if equation.section == START and equation.expression == 0:
            return
        if equation.expression.free_symbols <= self.fixed:
            if equation.symbol not in self.fixed:
                self.constants.append(self.made(equation, factor, sources, sources))
                self.fixed.add(equation.symbol)
                self.names.add(equation.name)
            return
        if len(sources) == 1:
            factor, sources = sp.Integer(1), (equation.expression,)
        sources = tuple(sorted(sources, key=self.place))
        lifted = tuple(self.lifted(term, equation.name) for term in sources)
        constant = factor.free_symbols <= self.fixed
        scale = (
            self.constant(factor, equation.name, "scale") if constant else self.lifted(factor, equation.name)
        )
        yield self.made(equation, scale, lifted, sources)

    def place(self, term: sp.Expr) -> tuple[int, bool]:
        """Where a term is added: those that wait for other statements last, so that no processor waits."""
        places = {name: place for place, name in enumerate(self.derivation.equations)}
        moving = term.free_symbols - self.fixed - self.inputs
        last = max((places[symbol.name] for symbol in moving), default=-1)
        return last, bool(term.could_extract_minus_sign())

    def made(
        self, equation: Equation, factor: sp.Expr, terms: tuple[sp.Expr, ...], sources: tuple[sp.Expr, ...]
    ) -> Statement:
        unit = "" if equation.unit is None else str(equation.unit)
        return Statement(
            equation.symbol, factor, terms, equation.name, equation.number, equation.meaning, unit, sources
        )

    def lifted(self, value: sp.Expr, stem: str) -> sp.Expr:
        """An expression with a name in place of each part that consists of parameters."""
        if value.free_symbols <= self.fixed:
            return self.constant(value, stem, "offset")
        if value.is_Mul:
            outer, inner = value.as_independent(*(value.free_symbols - self.fixed), as_Add=False)
            moving = [self.lifted(part, stem) for part in sp.Mul.make_args(inner)]
            about = "_".join(sorted(str(symbol) for symbol in inner.free_symbols - self.fixed)[:2])
            return sp.Mul(self.constant(outer, stem, about), *moving)
        if value.is_Atom:
            return value
        return value.func(*(self.lifted(part, stem) for part in value.args))

    def constant(self, value: sp.Expr, stem: str, about: str) -> sp.Expr:
        """A name for a value of parameters alone, unless it is a number or a parameter already."""
        if value.could_extract_minus_sign():
            return -self.constant(-value, stem, about)
        if value.is_number or value.is_Symbol:
            return value
        if value not in self.known:
            inverse = value.is_Pow and value.exp == -1 and value.base.is_Symbol
            name = f"inverse_{value.base}" if inverse else f"{stem}_{about}"
            while name in self.names:
                name += "_"
            self.names.add(name)
            self.known[value] = real_symbol(name)
            self.fixed.add(self.known[value])
            equation = self.derivation.equations.get(stem)
            number = "" if inverse or equation is None else equation.number
            meaning = f"factor in {stem}" if about != "offset" else f"part of {stem}"
            meaning = "" if inverse else meaning
            one = sp.Integer(1)
            self.constants.append(Statement(self.known[value], one, (value,), stem, number, meaning, ""))
        return self.known[value]

    def matrix(self, label: str, matrix: sp.ImmutableMatrix) -> Iterator[MatrixEntry]:
        """Entries of a matrix, and the terms of rates that they stand for."""
        s = self.derivation.signals
        rows = [s.r] if label == "Ar" else [s.xi, s.lambda_, *zip(*s.Xi, strict=True)]
        for i in range(matrix.rows):
            for j in range(matrix.cols):
                if matrix[i, j] != 0:
                    number = "(23)" if label == "Ar" else "(14)"
                    yield MatrixEntry(label, i, j, matrix[i, j], number, tuple(self.carried(rows, i, j)))

    def carried(self, rows: list[tuple[sp.Symbol, ...]], i: int, j: int) -> Iterator[tuple[str, sp.Expr]]:
        """The terms of rates with which state j of a block drives state i of it."""
        s = self.derivation.signals
        for block in rows:
            if (s.braking or s.estimates) and block == s.r:
                continue  # its hold is of another matrix; see `updates`
            name = derivative_name(block[i])
            for term in sp.Add.make_args(self.derivation.equations[name].expression):
                if term.has(block[j]):
                    yield name, term

    def updates(self, kept: tuple[sp.Symbol, ...]) -> tuple[Statement, ...]:
        """The states one sample later: what drives each, then the exact hold of every block.

        Args:
            kept: what the law left for it.
        """
        s, hold = self.derivation.signals, self.hold
        taken = self.inputs
        found = list(self.group((s.du,), taken))
        blocks = [
            (s.xi, hold.F0, hold.G0),
            *((column, hold.F0, hold.G0) for column in zip(*s.Xi, strict=True)),
        ]
        blocks.append((s.lambda_, hold.F0, hold.G0))
        if not s.braking and not s.estimates:
            blocks.append((s.r, hold.Fr, hold.Gr))
        drives: list[Statement] = []
        steps: list[Statement] = []
        for block, F, G in blocks:
            driven = sp.Matrix([self.drive(state, block, drives) for state in block])
            values = list(F * sp.Matrix(block) + G * driven)
            steps += [self.step(state, value) for state, value in zip(block, values, strict=True)]
        if s.braking:
            names = ("r2_middle", *(f"r1_slope{i}" for i in range(1, 5)), "r1_next", "r2_next")
            steps += self.group([real_symbol(name) for name in names], taken | {s.du})
        if s.estimates:
            moved = (*s.r, *learnt_states(self.derivation))
            steps += self.group([next_symbol(state) for state in moved], taken | {s.du, *kept})
        return (*found, *drives, *steps)

    def drive(self, state: sp.Symbol, block: tuple[sp.Symbol, ...], drives: list[Statement]) -> sp.Expr:
        """What drives a state, by a name of its own if it is more than one symbol."""
        equation = self.derivation.equations[derivative_name(state)]
        terms = [term for term in sp.Add.make_args(equation.expression) if not term.has(*block)]
        value = sp.Add(*terms)
        if value == 0:
            return value
        sources = tuple(scaled_sum(value)[1]) if value.is_Add else (value,)
        self.group(value.free_symbols, self.inputs | {self.derivation.signals.du})  # constants alone
        lifted = tuple(self.lifted(term, equation.name) for term in sources)
        unit = "" if equation.unit is None else str(equation.unit)
        symbol, meaning = drive_symbol(state), f"what drives {state}"
        one = sp.Integer(1)
        drives.append(Statement(symbol, one, lifted, equation.name, equation.number, meaning, unit, sources))
        return symbol

    def step(self, state: sp.Symbol, value: sp.Expr) -> Statement:
        equation = self.derivation.equations[f"{state.name}_next"]
        terms = tuple(sp.Add.make_args(value))
        return self.made(equation, sp.Integer(1), terms, terms)


def _limits(derivation: Derivation) -> set[sp.Symbol]:
    """Parameters in the actuator's limits."""
    return set().union(*(limit.free_symbols for limit in derivation.model.limits))


def _used(program: Program) -> set[sp.Symbol]:
    """Every symbol that a statement or a matrix reads."""
    groups = (program.constants, program.law, program.update, program.start)
    read = [item.factor for group in groups for item in group]
    read += [term for group in groups for item in group for term in item.terms]
    read += [entry.value for entry in program.matrices]
    return set().union(*(value.free_symbols for value in read))
