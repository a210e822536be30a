"""The statements of an exported controller, read off the equations of a derivation.

Three groups, each in an order in which it can be computed. ``constants`` depend on parameters alone and are
computed once; ``law`` is (24)-(29) and the estimate (15) at a sample; ``update`` takes filters (14) and
compensator (23) over one hold; ``start`` is the matched start. A factor of parameters alone is taken out of
each term and becomes a constant too, so a step divides by none of them. Of a design with estimates ``update``
moves these too; see `learning`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.export.learning import kept_symbols, learnt_states
from pmjoint_codegen.export.program import MatrixEntry, Program, Statement, drive_symbol, next_symbol
from pmjoint_codegen.export.tree import bounded_from_both_sides
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


def is_whole(terms: Sequence[sp.Expr], fixed: Set[sp.Symbol]) -> bool:
    """Whether a factor and the sum of some terms are computed as one term: nothing in the sum moves.

    Args:
        terms: of the sum.
        fixed: parameters and constants.
    """
    return len(terms) == 1 or all(term.free_symbols <= fixed for term in terms)


def gathered(terms: Sequence[sp.Expr], fixed: Set[sp.Symbol]) -> tuple[sp.Expr, ...]:
    """Terms of a sum, those of parameters alone as one term, which is then one constant.

    Args:
        terms: of the sum.
        fixed: parameters and constants.
    """
    still = [term for term in terms if term.free_symbols <= fixed]
    if len(still) < 2:
        return tuple(terms)
    return (sp.Add(*still), *(term for term in terms if term not in still))


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
        law = self.divided_once(law)
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
        if is_whole(sources, self.fixed):
            factor, sources = sp.Integer(1), (equation.expression,)
        sources = tuple(sorted(sources, key=self.place))
        if not equation.number:
            sources = gathered(sources, self.fixed)
        lifted = tuple(self.lifted(term, equation.name) for term in sources)
        constant = factor.free_symbols <= self.fixed
        scale = (
            self.constant(factor, equation.name, "scale") if constant else self.lifted(factor, equation.name)
        )
        yield self.made(equation, scale, lifted, sources)

    def divided_once(self, law: tuple[Statement, ...]) -> tuple[Statement, ...]:
        """The law with one division by an estimate in place of many: the others multiply by its inverse."""
        for hat in self.derivation.signals.estimates:
            inverse = real_symbol(f"inverse_{hat}")
            while inverse.name in self.names:
                inverse = real_symbol(f"{inverse}_")
            found = {
                place: replace(
                    item,
                    factor=_multiplied(item.factor, hat, inverse),
                    terms=tuple(_multiplied(term, hat, inverse) for term in item.terms),
                )
                for place, item in enumerate(law)
            }
            changed = [place for place, item in found.items() if item != law[place]]
            if len(changed) > 1:
                first, one = law[changed[0]], sp.Integer(1)
                made = Statement(inverse, one, (1 / hat,), first.equation, "", f"inverse of {hat}", "")
                items = [*found.values()]
                law = (*items[: changed[0]], made, *items[changed[0] :])
                self.names.add(inverse.name)
        return law

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
            pairs = [part.as_content_primitive() for part in sp.Mul.make_args(inner)]
            outer *= sp.Mul(*(content for content, _ in pairs))
            moving = [self.lifted(part, stem) for _, part in pairs]
            about = "_".join(sorted(str(symbol) for symbol in inner.free_symbols - self.fixed)[:2])
            return sp.Mul(self.constant(outer, stem, about), *moving)
        if value.is_Atom:
            return value
        if value.is_Add:
            taken_out = sp.factor_terms(value)
            common = {*sp.Mul.make_args(taken_out)} & (value.free_symbols - self.fixed)
            if common:
                return self.lifted(taken_out, stem)
        return bounded_from_both_sides(value.func(*(self.lifted(part, stem) for part in value.args)))

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


def _multiplied(value: sp.Expr, hat: sp.Symbol, inverse: sp.Symbol) -> sp.Expr:
    """An expression with powers of an inverse in place of divisions by a symbol."""
    found = value.atoms(sp.Pow)
    divisions = [item for item in found if item.base == hat and item.exp.is_Integer and item.exp < 0]
    return value.xreplace({item: inverse**-item.exp for item in divisions})


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
