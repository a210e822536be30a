"""Statements as lines of C; each line knows the terms of equations that it computes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import sympy as sp

from pmjoint_codegen.export.program import MatrixEntry, Program, Statement
from pmjoint_codegen.export.tree import Precision, c_text, tree_of

WIDTH = 96  # characters of a statement before it is broken at its terms
_KEYWORDS = frozenset(
    """
    auto break case char const continue default do double else enum extern float for goto if inline int
    long register restrict return short signed sizeof static struct switch typedef union unsigned void
    volatile while bool catch class delete false friend new operator private protected public template
    this throw true try using virtual
    """.split()  # noqa: SIM905 - as words they are read at a glance
)  # of C99 and of C++


@dataclass(frozen=True)
class Source:
    """A term of an equation.

    Attributes:
        equation: name of the equation.
        number: its number, or empty.
        term: the term.
    """

    equation: str
    number: str
    term: sp.Expr


@dataclass(frozen=True)
class Line:
    """A line of C.

    Attributes:
        text: without a newline.
        sources: the terms that it computes.
    """

    text: str
    sources: tuple[Source, ...] = ()


def identifier(name: str) -> str:
    """A name as C takes it: keywords of C and C++ get an underscore."""
    return f"{name}_" if name in _KEYWORDS else name


def comment(text: str) -> str:
    """Text that can stand in a comment of C: ASCII, without what would end the comment or its line."""
    plain = " ".join(text.encode("ascii", "backslashreplace").decode().split())
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").replace("\\", "/")


def spellings(program: Program) -> dict[sp.Symbol, str]:
    """Every symbol as C names it: a field of a structure, or a local variable of its own name."""
    s = program.derivation.signals
    groups = (program.constants, program.law, program.update, program.start)
    found = {item.symbol: identifier(item.symbol.name) for group in groups for item in group}
    found |= {item.symbol: f"c->{identifier(item.symbol.name)}" for item in program.constants}
    found |= {symbol: f"p->{identifier(symbol.name)}" for symbol in program.parameters}
    found |= {symbol: f"s->{symbol.name}" for symbol in (*program.states, s.y, s.u, s.v, *s.y_r)}
    for label in ("F0", "G0", "Fr", "Gr"):
        matrix = getattr(program.hold, label)
        for i in range(matrix.rows):
            for j in range(matrix.cols):
                found[matrix[i, j]] = f"c->{label}[{i}][{j}]"
    return found


@dataclass(frozen=True)
class Printer:
    """Prints statements.

    Attributes:
        spelling: of each symbol.
        precision: of the numbers.
    """

    spelling: Mapping[sp.Symbol, str]
    precision: Precision

    def text(self, value: sp.Expr) -> str:
        """An expression in C."""
        return c_text(tree_of(value), self.spelling, self.precision)

    def constants(self, statements: Iterable[Statement]) -> Iterator[Line]:
        """Statements that set fields of the structure of constants."""
        for item in statements:
            yield from self.lines(item, f"{self.spelling[item.symbol]} =")

    def locals(self, statements: Iterable[Statement]) -> Iterator[Line]:
        """Statements that define local variables."""
        for item in statements:
            yield from self.lines(item, f"const {self.precision.name} {identifier(item.symbol.name)} =")

    def lines(self, item: Statement, opening: str) -> Iterator[Line]:
        """One statement: a line with its remark before it, or a line for each term."""
        sources = [Source(item.equation, item.number, term) for term in item.sources]
        remark = comment(" ".join(part for part in (item.number, item.meaning, _unit(item.unit)) if part))
        if remark:
            yield Line(f"    /* {remark} */")
        whole = f"    {opening} {c_text(item.tree, self.spelling, self.precision)};"
        if len(whole) <= WIDTH or len(item.terms) == 1:
            yield Line(whole, tuple(sources))
            return
        before, after = self.around(item)
        yield Line(f"    {opening}{before}")
        terms = list(item.terms)
        for place, term in enumerate(terms):
            negative = bool(term.could_extract_minus_sign())
            sign = "-" if negative else "+" if place else ""
            text = self.operand(-term if negative else term, tight=True)
            end = f"{after};" if place == len(terms) - 1 else ""
            gap = " " if sign and place else ""
            yield Line(f"        {sign}{gap}{text}{end}", tuple(sources[place : place + 1]))

    def around(self, item: Statement) -> tuple[str, str]:
        """What stands before and after the terms of a long sum."""
        if item.factor == 1:
            return "", ""
        if item.divisor is not None:
            return " (", f") / {self.operand(item.divisor, tight=True)}"
        return f" {self.operand(item.factor)} * (", ")"

    def operand(self, value: sp.Expr, *, tight: bool = False) -> str:
        """An expression as one operand: a sum, and if tight a product or quotient, in brackets."""
        text = self.text(value)
        whole = tree_of(value).operation in ("mul", "div", "neg")
        return f"({text})" if value.is_Add or (tight and whole) else text

    def matrix(self, entries: Iterable[MatrixEntry]) -> Iterator[Line]:
        """Entries of the matrices of the hold."""
        for entry in entries:
            sources = tuple(Source(name, entry.number, term) for name, term in entry.sources)
            about = " ".join(str(term) for _, term in entry.sources[:1])
            remark = comment(f"{entry.number} {about}".strip())
            text = f"    {entry.matrix}[{entry.row}][{entry.column}] = {self.text(entry.value)};"
            yield Line(f"{text} /* {remark} */", sources)


def _unit(unit: str) -> str:
    return f"[{unit}]" if unit and unit != "1" else ""
