"""Partial derivatives by the chain rule over named equations.

Virtual control i is written in terms of the errors, of what is known of y' and of the partial derivatives
of virtual control i - 1. Written in signals alone, its own partial derivatives would repeat all of that,
hundreds of times from the third step on. So each derivative keeps the names: it is the sum, over the names
that the equation uses, of the derivative by the name times the name's own derivative. That is an equation
too where it is more than one symbol or a constant.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import sympy as sp

from pmjoint_derive.equation import Equation, real_symbol
from pmjoint_derive.shield import multiplied_out, shielded
from pmjoint_derive.signals import Signals, Units, partial_name


class ChainRule:
    """Derivatives of named equations by measurable signals, each computed once.

    Args:
        signals: symbols of the design.
        units: their physical units.
        section: chapter of the derivation that the new equations belong to.
    """

    def __init__(self, signals: Signals, units: Units, section: str) -> None:
        """Start with no equation."""
        self._signals = signals
        self._units = units
        self._section = section
        self._rank = {by: place for place, by in enumerate(signals.measurable)}
        self._table: dict[sp.Symbol, Equation] = {}
        self._values: dict[tuple[sp.Symbol, tuple[sp.Symbol, ...]], sp.Expr] = {}
        self._origin: dict[sp.Symbol, tuple[sp.Symbol, tuple[sp.Symbol, ...]]] = {}
        self._moving: set[sp.Symbol] = set(signals.measurable)

    def add(self, equations: Iterable[Equation]) -> None:
        """Make equations known; what they use must be known before, or be a signal or a parameter."""
        for item in equations:
            self._table[item.symbol] = item
            if item.expression.free_symbols & self._moving:
                self._moving.add(item.symbol)

    def add_partial(self, of: sp.Symbol, by: sp.Symbol, equation: Equation) -> None:
        """Make a first partial derivative known that was found otherwise."""
        self.add([equation])
        self._values[of, (by,)] = equation.symbol
        self._origin[equation.symbol] = of, (by,)

    def partials(self, of: sp.Symbol) -> tuple[dict[sp.Symbol, sp.Expr], list[Equation]]:
        """The partial derivatives of a named equation that do not vanish, by signal.

        Returns:
            value of each derivative in terms of names, and the equations of names that are new, in order.
        """
        new: list[Equation] = []
        values = {by: self._expression(of, by, new) for by in self._signals.measurable}
        return {by: value for by, value in values.items() if value != 0}, new

    def _derivative(self, of: sp.Symbol, by: sp.Symbol, new: list[Equation]) -> sp.Expr:
        """``d of / d by``: a number, a constant, a symbol, or the name of an equation that is appended."""
        if of == by:
            return sp.Integer(1)
        if of not in self._table or of not in self._moving:
            return sp.Integer(0)
        base, path = self._origin.get(of, (of, ()))
        return self._along(base, tuple(sorted((*path, by), key=self._rank.__getitem__)), new)

    def _along(self, base: sp.Symbol, path: tuple[sp.Symbol, ...], new: list[Equation]) -> sp.Expr:
        """A derivative by several signals in their fixed order: two orders would be two equations."""
        if (base, path) not in self._values:
            inner = self._along(base, path[:-1], new) if len(path) > 1 else base
            value = self._derivative_of_sum(inner, path[-1], new)
            self._values[base, path] = self._named(base, path, value, new)
        return self._values[base, path]

    def _derivative_of_sum(self, value: sp.Expr, by: sp.Symbol, new: list[Equation]) -> sp.Expr:
        """Of what `_named` gives: a constant, a symbol of either sign."""
        sign = -1 if (-value).is_Symbol else 1
        name = sign * value
        return sign * self._expression(name, by, new) if name in self._table else sp.diff(value, by)

    def _expression(self, of: sp.Symbol, by: sp.Symbol, new: list[Equation]) -> sp.Expr:
        """The chain rule's sum."""
        right = self._table[of].expression
        value = sp.diff(right, by)
        for name in sorted(right.free_symbols & self._table.keys(), key=lambda symbol: str(symbol.name)):
            inner = self._derivative(name, by, new)
            if inner != 0:
                value += sp.diff(right, name) * inner
        expanded = multiplied_out(value, (self._signals.y,))
        if expanded == 0:
            return sp.Integer(0)
        shared = value.free_symbols & self._origin.keys()  # multiplied out, their products would be many
        return shielded(sp.factor_terms, value if shared else expanded, (self._signals.y,))

    def _named(
        self, base: sp.Symbol, path: Sequence[sp.Symbol], value: sp.Expr, new: list[Equation]
    ) -> sp.Expr:
        """A value that is more than one symbol or a constant, as an equation."""
        if not value.free_symbols & self._moving or value.is_Symbol or (-value).is_Symbol:
            return value
        name = real_symbol(higher_name(base, path))
        unit = self._table[base].unit
        for by in path:
            unit = None if unit is None else unit / self._units.of(by)
        signals = ", ".join(by.name for by in path)
        equation = Equation(name, value, self._section, "", f"derivative of {base} by {signals}", unit)
        self.add([equation])
        self._origin[name] = base, tuple(path)
        new.append(equation)
        return name


def higher_name(of: sp.Symbol, path: Sequence[sp.Symbol]) -> str:
    """Name of a derivative: ``dOmega_dy``, or ``d2alpha1_dy_dxi2`` by two signals."""
    if len(path) == 1:
        return partial_name(of, path[0])
    return f"d{len(path)}{of.name}" + "".join(f"_d{by.name}" for by in path)
