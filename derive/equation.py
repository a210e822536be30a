"""Named equations: the one form in which a derivation is passed on.

C, LaTeX, text and checks are all made from these records, so an equation has one home. The right-hand side
contains signals, parameters and *earlier* names, which keeps the law readable: z1, alpha1, dalpha1_dy, z2,
v.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import sympy as sp

from pmjoint_derive.units import Unit


def real_symbol(name: str) -> sp.Symbol:
    """The one SymPy symbol that stands for a parameter, a signal or a state of that name (real-valued)."""
    return sp.Symbol(name, real=True)


@dataclass(frozen=True)
class Equation:
    """``symbol = expression``.

    Attributes:
        symbol: the left-hand side; its name is the equation's name.
        expression: the right-hand side.
        section: chapter of the derivation, such as ``Filters``.
        number: number in the paper, such as ``(29)``, or empty.
        meaning: one line for the reader.
        unit: physical unit of the left-hand side, or None where it has none.
    """

    symbol: sp.Symbol
    expression: sp.Expr
    section: str
    number: str
    meaning: str
    unit: Unit | None

    @property
    def name(self) -> str:
        """Name of the left-hand side."""
        return str(self.symbol.name)


@dataclass(frozen=True)
class Identity:
    """A statement that an expression is zero.

    Attributes:
        name: which statement.
        claim: the statement, for people.
        remainder: the expression after expansion; the integer 0 when the statement is proved.
    """

    name: str
    claim: str
    remainder: sp.Expr

    @property
    def holds(self) -> bool:
        """Whether the expression expanded to exactly zero."""
        return bool(self.remainder == 0)


class Equations(Mapping[str, Equation]):
    """Equations in the order of their derivation, looked up by name."""

    def __init__(self, items: Iterable[Equation]) -> None:
        """Collect equations.

        Raises:
            ValueError: when two equations have one name.
        """
        table: dict[str, Equation] = {}
        for item in items:
            if item.name in table:
                raise ValueError(f"two equations are named {item.name}")
            table[item.name] = item
        self._table = MappingProxyType(table)

    def __getitem__(self, name: str) -> Equation:
        """The equation of that name."""
        return self._table[name]

    def __iter__(self) -> Iterator[str]:
        """Names in order."""
        return iter(self._table)

    def __len__(self) -> int:
        """Number of equations."""
        return len(self._table)

    def expand(self, expression: sp.Expr, keep: frozenset[sp.Symbol] = frozenset()) -> sp.Expr:
        """Replace names by their definitions until only signals and parameters remain.

        Args:
            expression: what to expand.
            keep: symbols to leave as they are, such as the measured y that the plant defines as x1.
        """
        memo: dict[sp.Symbol, sp.Expr] = {}

        def resolve(symbol: sp.Symbol) -> sp.Expr:
            if symbol not in memo:
                known = None if symbol in keep else self._table.get(symbol.name)
                memo[symbol] = symbol if known is None else unfold(known.expression)
            return memo[symbol]

        def unfold(value: sp.Expr) -> sp.Expr:
            names = sorted(value.free_symbols, key=lambda symbol: str(symbol))
            return value.xreplace({symbol: resolve(symbol) for symbol in names})

        return unfold(sp.sympify(expression))
