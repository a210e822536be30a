"""``trace.json``: the line of each term of the equations, and the check that it is right.

The check reads the C, not what it was printed from: it puts each equation together again from the lines that
the trace names, fills in the constants from the lines that set them, and compares with the derivation.
"""

from __future__ import annotations

import json
import random
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence, Set
from typing import Any, Final

import sympy as sp

from pmjoint_codegen.export.hold import BAKED, COMPUTED
from pmjoint_codegen.export.lines import Line, identifier
from pmjoint_codegen.export.program import Program, drive_symbol, next_symbol
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.statements import gathered, is_whole
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.export.twin import bounded_arithmetic, exact_arithmetic
from pmjoint_codegen.report.notation import scaled_sum
from pmjoint_derive import real_symbol
from pmjoint_derive.equation import Equation
from pmjoint_derive.signals import derivative_name

_DIGITS: Final = 30
_LITERAL: Final = 2.0**-50  # of a term: a few literals, each the nearest double
TRACED: Final = ("(14)", "(15)", "(21)", "(23)", "(24)", "(25)", "(29)")


def trace_of(lines: Sequence[Line], file: str) -> list[dict[str, Any]]:
    """One entry for each term, in the order of the lines.

    Args:
        lines: of the C file.
        file: its name.
    """
    return [
        {
            "number": source.number,
            "equation": source.equation,
            "term": str(source.term),
            "file": file,
            "line": place,
        }
        for place, line in enumerate(lines, start=1)
        for source in line.sources
    ]


def trace_text(entries: Iterable[Mapping[str, Any]]) -> str:
    """The file: one entry a line."""
    return "[\n" + ",\n".join(f" {json.dumps(entry)}" for entry in entries) + "\n]\n"


def trace_faults(
    program: Program, text: str, entries: Sequence[Mapping[str, Any]], hold: str = COMPUTED
) -> list[str]:
    """What is wrong with a trace or with the C that it describes; empty if nothing is.

    With the hold baked in, no line has the terms of its matrices. Then the literals are compared with the
    exact hold of the derivation's matrices.

    Args:
        program: for the derivation.
        text: of the C file, in double precision.
        entries: of the trace.
        hold: `COMPUTED` by init, or `BAKED` in.
    """
    baked = hold == BAKED
    held = {item for entry in program.matrices for item in entry.sources} if baked else set()
    faults = [*_misplaced(entries), *_missing(program, entries, held)]
    faults += _literal_faults(program, text) if baked else []
    reader = _Reader(program, text, held)
    by_equation: dict[str, list[int]] = defaultdict(list)
    for entry in entries:
        by_equation[entry["equation"]].append(int(entry["line"]))
        faults += reader.term_faults(entry["equation"], entry["term"], int(entry["line"]))
    for name, places in by_equation.items():
        faults += reader.faults(name, places)
    return faults


def _misplaced(entries: Iterable[Mapping[str, Any]]) -> list[str]:
    """Terms in more than one line, lines in more than one numbered equation."""
    lines: dict[tuple[str, str], set[int]] = defaultdict(set)
    numbers: dict[int, set[str]] = defaultdict(set)
    for entry in entries:
        lines[entry["equation"], entry["term"]].add(entry["line"])
        numbers[entry["line"]].add(entry["number"])
    faults = [
        f"{name}: {term} is in lines {sorted(at)}" for (name, term), at in lines.items() if len(at) != 1
    ]
    return faults + [f"line {at} has {sorted(found)}" for at, found in numbers.items() if len(found) != 1]


def _literal_faults(program: Program, text: str) -> list[str]:
    """Literals of the hold that are further from the exact one than the C's rounding errors could be."""
    exact, bounded = (
        twin_of(program, arithmetic, DOUBLE, matched=False).fixed
        for arithmetic in (exact_arithmetic(), bounded_arithmetic(DOUBLE))
    )
    faults = []
    for name in ("F0", "G0", "Fr", "Gr"):
        matrix = getattr(program.hold, name)
        for i in range(matrix.rows):
            for j in range(matrix.cols):
                found = re.findall(rf"^    c->{name}\[{i}\]\[{j}\] = (\S+);$", text, re.MULTILINE)
                wanted, bound = exact[matrix[i, j]], bounded[matrix[i, j]].error + DOUBLE.smallest
                if len(found) != 1 or not abs(float(found[0]) - wanted) <= bound:
                    faults.append(f"{name}[{i}][{j}]: the C has {found}, the exact hold {float(wanted)!r}")
    return faults


def _missing(
    program: Program, entries: Iterable[Mapping[str, Any]], held: Set[tuple[str, sp.Expr]]
) -> list[str]:
    """Terms of the controller's equations that no line has: (14), (15), (21), (23)-(25) and (29).

    Of a controller with estimates, whose law has numbers in part only, it is all equations. The estimates and
    their compensator have no rates in the C; there it is the terms of the update.
    """
    present = {(entry["equation"], entry["term"]) for entry in entries}
    s, equations = program.derivation.signals, program.derivation.equations
    moved = {*program.learnt, *(s.r if program.learnt else ())}
    left_out = moved | {*(s.r if s.braking else ())}
    rates = [derivative_name(state) for state in program.states if state not in left_out]
    terms = {name: sp.Add.make_args(equations[name].expression) for name in rates}
    fixed = {*program.parameters, *(item.symbol for item in program.constants)}
    for state in (item for item in program.states if item in moved):
        name = next_symbol(state).name
        terms[name] = gathered(scaled_sum(equations[name].expression)[1], fixed)
    for item in (*program.law, *program.constants):
        known = program.learnt or item.number in TRACED
        if item.symbol.name == item.equation and item.equation not in rates and known:
            terms[item.equation] = _terms(equations[item.equation], fixed - {item.symbol})
    return [
        f"{name}: no line has {term}"
        for name, parts in terms.items()
        for term in parts
        if (name, str(term)) not in present and (name, term) not in held
    ]


def _terms(equation: Equation, fixed: Set[sp.Symbol]) -> tuple[sp.Expr, ...]:
    """The terms that the lines of a statement have.

    Args:
        equation: of the law.
        fixed: parameters and constants, but not the equation's own symbol.
    """
    factor, parts = scaled_sum(equation.expression)
    moves = not equation.expression.free_symbols <= fixed
    if factor != 1 and (is_whole(parts, fixed) if moves else len(parts) == 1):
        return (equation.expression,)
    return gathered(parts, fixed) if moves and not equation.number else tuple(parts)


class _Reader:
    """Reads statements of the C back into SymPy."""

    def __init__(self, program: Program, text: str, held: Set[tuple[str, sp.Expr]]) -> None:
        self.program = program
        self.held = held
        self.lines = text.splitlines()
        s, d = program.derivation.signals, program.derivation
        symbols = {*program.parameters, *program.states, s.y, s.u, s.v, *s.y_r, *program.hold.symbols}
        symbols |= {item.symbol for group in self._groups() for item in group}
        symbols |= {real_symbol(name) for name in d.equations}
        self.names = {identifier(symbol.name): symbol for symbol in symbols}
        made = {item.symbol: item for item in program.constants}
        self.helpers = {
            symbol: self.expression(self._definition(f"c->{identifier(symbol.name)} ="))
            for symbol in made
            if symbol.name not in d.equations
        }
        self.helpers |= {
            item.symbol: self.expression(self._definition(f"const double {identifier(item.symbol.name)} ="))
            for item in program.law
            if item.symbol.name not in d.equations
        }

    def _groups(self) -> tuple[Any, ...]:
        return self.program.constants, self.program.law, self.program.update, self.program.start

    def _definition(self, opening: str) -> str:
        """The right-hand side of the first statement that begins so, however many lines it has."""
        for place, line in enumerate(self.lines):
            if line.strip().startswith(opening):
                return self._statement(place)
        raise LookupError(f"no statement begins with {opening}")

    def _statement(self, place: int) -> str:
        """The right-hand side of the statement that a line belongs to."""
        first = place
        while "=" not in self.lines[first] or self.lines[first].strip().startswith("/*"):
            first -= 1
        last = first
        while ";" not in self.lines[last]:
            last += 1
        text = re.sub(r"/\*.*?\*/", "", " ".join(self.lines[first : last + 1]))
        return text.partition("=")[2].partition(";")[0]

    def expression(self, text: str) -> sp.Expr:
        """C as SymPy."""
        text = re.sub(r"c->(F0|G0|Fr|Gr)\[(\d)\]\[(\d)\]", _entry, text)
        text = re.sub(r"\b[cps]->", "", text)
        functions: dict[str, Any] = {"between": lambda x, low, high: sp.Max(low, sp.Min(x, high))}
        functions |= {"fabs": sp.Abs, "fmin": sp.Min, "fmax": sp.Max, "sign_of": sp.sign, "pow": sp.Pow}
        exact = re.sub(r"(?<![\w.])(\d+)\.0(?![\w])", r"\1", text)
        # Names such as lambda and E1 must not be read as Python's or SymPy's own.
        words = {word: self.names[word] for word in re.findall(r"[A-Za-z_]\w*", exact) if word in self.names}
        plain = re.sub(
            r"[A-Za-z_]\w*", lambda found: f"_{found[0]}" if found[0] in words else found[0], exact
        )
        return sp.sympify(plain, locals={f"_{word}": symbol for word, symbol in words.items()} | functions)

    def term_faults(self, name: str, term: str, place: int) -> list[str]:
        """Whether a line that is not a whole statement is the term that the trace names there."""
        line = re.sub(r"/\*.*?\*/", "", self.lines[place - 1])
        if "=" in line and ";" in line:
            return []
        if "=" in line or not line.strip():
            return [f"{name}: line {place} has no term"]
        depth, end = 0, len(line)
        for index, character in enumerate(line):  # the last line of a bracket closes it
            depth += {"(": 1, ")": -1}.get(character, 0)
            if depth < 0:
                end = index
                break
        found = self.expression(line[:end].strip().rstrip(";"))
        return self._same(f"{name}, line {place}", found, self.expression(term))

    def faults(self, name: str, places: Sequence[int]) -> list[str]:
        """Whether the statements at some lines make up an equation."""
        equations = self.program.derivation.equations
        state = next((item for item in self.program.states if derivative_name(item) == name), None)
        if state is not None and state not in self.program.learnt:
            return self._of_rate(name, state, places)
        if name not in equations:
            return [f"{name}: no such equation"]
        statements = {self._statement(place - 1) for place in places}
        if len(statements) != 1:
            return [f"{name}: its lines are of {len(statements)} statements"]
        found = self.expression(statements.pop())
        if name.endswith("_next"):
            drives = {drive_symbol(item): item for item in self.program.states}
            held = {
                symbol: self.expression(self._definition(f"const double {symbol} ="))
                for symbol in found.free_symbols
                if symbol in drives
            }
            found = found.xreplace(held)
        return self._same(name, found, equations[name].expression)

    def _of_rate(self, name: str, state: sp.Symbol, places: Sequence[int]) -> list[str]:
        """A rate of (14) or (23): entries of the matrix times the block, plus what drives it."""
        s = self.program.derivation.signals
        blocks = [s.xi, s.lambda_, s.r, *zip(*s.Xi, strict=True)]
        block = next(item for item in blocks if state in item)
        total: sp.Expr = sp.Integer(0)
        for place in sorted({place - 1 for place in places}):
            line = self.lines[place]
            entry = re.match(r"\s*A[0r]\[(\d)\]\[(\d)\] = ", line)
            if entry is None:
                continue
            if block[int(entry[1])] != state:
                return [f"{name}: line {place + 1} is of another state"]
            total += self.expression(self._statement(place)) * block[int(entry[2])]
        driven = {
            self._statement(place - 1)
            for place in places
            if not re.match(r"\s*A[0r]\[", self.lines[place - 1])
        }
        total += sum((self.expression(text) for text in driven), sp.Integer(0))
        total += sum((term for equation, term in self.held if equation == name), sp.Integer(0))
        return self._same(name, total, self.program.derivation.equations[name].expression)

    def _same(self, name: str, found: sp.Expr, wanted: sp.Expr) -> list[str]:
        for _ in range(len(self.helpers) + 1):
            if not found.free_symbols & self.helpers.keys():
                break
            found = found.xreplace(self.helpers)
        rest = sp.simplify(sp.expand(found - wanted))
        same = rest == 0 or (found.has(sp.Float) and _is_rounding(rest, wanted))
        return [] if same else [f"{name}: the C and the derivation differ by {rest}"]


def _is_rounding(rest: sp.Expr, wanted: sp.Expr) -> bool:
    """Whether a difference is no more than literals of the C, as of 4/pi, are rounded.

    It is looked at where the symbols have drawn values; both are analytic there.
    """
    draw = random.Random(1)
    symbols = sorted(rest.free_symbols | wanted.free_symbols, key=str)
    for _ in range(3):
        point = {symbol: sp.Rational(draw.randint(500, 2000), 1000) for symbol in symbols}
        parts = [abs(term.evalf(_DIGITS, subs=point)) for term in sp.Add.make_args(sp.expand(wanted))]
        if not abs(rest.evalf(_DIGITS, subs=point)) <= _LITERAL * sum(parts):
            return False
    return True


def _entry(found: re.Match[str]) -> str:
    return f"{found[1]}_{int(found[2]) + 1}{int(found[3]) + 1}"
