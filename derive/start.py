"""The matched start: the controller's state in which no transient of its own begins.

From the measured y(0): ``xi_1 = y``, ``xi_{i+1} = -phi_i(y)``, ``Xi_1j = 0``, ``Xi_{i+1,j} = -Phi_ij(y)``
and ``lambda = 0``. So ``x_hat_1 = y``, and x_hat is that of a joint at rest. Then r_1, r_2, ... follow from
``z_i = 0`` in order: z_i holds r_i with the factor -1 or ``-1/b_m`` and no later r. With ``z(0) = 0`` there
is no kick, and the error decays along the compensator (23). Without compensator r = 0, and only the filters
are matched.
"""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

from pmjoint_derive.adaptation import LS_P0, RHO_GUESS, RHO_HAT
from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.shield import multiplied_out

SECTION = "Start"


def start_symbol(symbol: sp.Symbol) -> sp.Symbol:
    """Name of a quantity's value at the matched start."""
    return real_symbol(f"{symbol.name}_start")


def estimate_starts(design: Design) -> dict[sp.Symbol, sp.Expr]:
    """Where their states start, whatever the rest of the controller does: estimates at their guesses."""
    adaptation = design.adaptation
    if adaptation is None:
        return {}
    found: dict[sp.Symbol, sp.Expr] = {
        entry.state: entry.guess_symbol if entry.range is None else sp.Integer(0)
        for entry in adaptation.unknown
    }
    if adaptation.inverse is not None:
        found[RHO_HAT] = RHO_GUESS
    for i, row in enumerate(adaptation.covariance):
        found |= {symbol: LS_P0 if i == j else sp.Integer(0) for j, symbol in enumerate(row) if j >= i}
    return found


def start_equations(design: Design, law: Iterable[Equation]) -> list[Equation]:
    """The matched start as named equations ``xi1_start`` and so on.

    A step of the law that has another value there, such as alpha_1, gets an equation of its own,
    ``alpha1_start``; one that does not depend on the controller's state keeps its name.

    Args:
        design: the design.
        law: its errors, virtual controls and what they are made of.
    """
    return _Start(design, Equations(law)).equations()


class _Start:
    """The values of named equations at the matched start, each found once."""

    def __init__(self, design: Design, law: Equations) -> None:
        self._design = design
        self._law = law
        self._named: list[Equation] = []
        self._values: dict[sp.Symbol, sp.Expr] = {}

    def equations(self) -> list[Equation]:
        s = self._design.signals
        for state, value in self._design.matched_filters().items():
            self._values[state] = self._name(state, value, f"matched start of {state}")
        for state, value in estimate_starts(self._design).items():
            self._values[state] = self._name(state, value, f"start of {state}")
        adaptation = self._design.adaptation
        for entry in () if adaptation is None else adaptation.unknown:
            self._values.setdefault(entry.estimate, entry.guess_symbol)
        for z, r in zip(s.z, s.r, strict=False):
            meaning = f"matched start of {r}: {z} = 0 there; 0 without compensator"
            self._values[r] = self._name(r, self._solved(z, r), meaning)
            self._values[z] = sp.Integer(0)
        for r in s.r[len(s.z) :]:  # of a design with fewer errors
            self._values[r] = self._name(r, sp.Integer(0), f"matched start of {r}")
        return self._named

    def _solved(self, z: sp.Symbol, r: sp.Symbol) -> sp.Expr:
        """The value of r at which an error vanishes; the error is linear in it."""
        error = self._law[z.name].expression
        slope = sp.diff(error, r)
        if slope == 0:  # of a design whose error does not hold it
            return sp.Integer(0)
        rest = self._at_start(error.xreplace({r: sp.Integer(0)}))
        return multiplied_out(-rest / slope, (self._design.signals.y,))

    def _at_start(self, expression: sp.Expr) -> sp.Expr:
        symbols = sorted(expression.free_symbols, key=lambda symbol: str(symbol.name))
        return expression.xreplace({symbol: self._value(symbol) for symbol in symbols})

    def _value(self, symbol: sp.Symbol) -> sp.Expr:
        """What a state or a name stands for at the start."""
        if symbol not in self._values:
            item = self._law.get(symbol.name)
            self._values[symbol] = symbol if item is None else self._step(item)
        return self._values[symbol]

    def _step(self, item: Equation) -> sp.Expr:
        value = self._at_start(item.expression)
        if value == item.expression:
            return item.symbol
        if value.is_Atom or (-value).is_Symbol:
            return value
        return self._name(item.symbol, value, f"{item.symbol} at the matched start")

    def _name(self, symbol: sp.Symbol, value: sp.Expr, meaning: str) -> sp.Expr:
        """Give a value a name; a zero passes through names as a zero."""
        unit = self._law[symbol.name].unit if symbol.name in self._law else self._design.units.of(symbol)
        self._named.append(Equation(start_symbol(symbol), value, SECTION, "", meaning, unit))
        return value if value.is_Number else start_symbol(symbol)
