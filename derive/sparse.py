"""Whether an expression of many symbols vanishes, decided in a sparse polynomial ring.

`sympy.expand` multiplies a law of order three out term by term as trees, and does not end. Here every
symbol, every function and every power that is no whole number is a generator of a polynomial ring, and so is
the inverse of every denominator. Inverses are multiplied away at the end, by denominators that are not zero
where the expression has a value. So a remainder of 0 is a proof; functions count as independent of each
other, so that a remainder may also mean a relation between functions, which is left to `expand_to_zero`.
"""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp
from sympy.polys.rings import PolyElement, PolyRing

from pmjoint_derive.vanishing import expand_to_zero

SHOWN = 20  # terms of a remainder that are turned back into an expression; a proof has none


def remainder(expression: sp.Expr, sigma: sp.Expr) -> sp.Expr:
    """0 exactly when the expression vanishes identically, else (some terms of) what is left.

    Args:
        expression: what should vanish.
        sigma: the input nonlinearity, as `expand_to_zero` takes it where functions are related.
    """
    left = _Algebra(expression).left()
    if left == 0:
        return sp.Integer(0)
    if _has_related_functions(expression):
        return expand_to_zero(expression, sigma)
    return _shown(left)


def _has_related_functions(expression: sp.Expr) -> bool:
    """Whether two of its functions may be related: exponentials, or one function of several arguments."""
    found = expression.atoms(sp.Function)
    return len(found) > len({item.func for item in found}) or bool(expression.atoms(sp.exp))


def _shown(left: PolyElement) -> sp.Expr:
    terms = sorted(left.terms(), reverse=True)[:SHOWN]
    return left.ring.from_dict(dict(terms)).as_expr()


class _Algebra:
    """One expression as a polynomial."""

    def __init__(self, expression: sp.Expr) -> None:
        self._atoms: dict[sp.Expr, sp.Symbol] = {}
        self._bases: dict[sp.Expr, sp.Symbol] = {}  # inner denominators first
        self._seen: set[sp.Expr] = set()
        self._collect(expression)
        generators = [*self._atoms.values(), *self._bases.values()]
        self._ring = PolyRing([*generators, sp.Dummy("unused")], sp.QQ)
        self._place = dict(zip(generators, self._ring.gens, strict=False))
        self._memo: dict[sp.Expr, PolyElement] = {}
        self._expression = expression

    def _collect(self, value: sp.Expr) -> None:
        if value in self._seen or value.is_Rational:
            return
        self._seen.add(value)
        if value.is_Add or value.is_Mul:
            self._collect_all(value.args)
        elif value.is_Pow and value.exp.is_Integer:
            self._collect(value.base)
            if value.exp < 0:
                self._bases.setdefault(value.base, sp.Dummy("inverse"))
        else:
            self._atoms[value] = value if value.is_Symbol else sp.Dummy("opaque", real=True)

    def _collect_all(self, values: Iterable[sp.Expr]) -> None:
        for item in values:
            self._collect(item)

    def _polynomial(self, value: sp.Expr) -> PolyElement:
        if value not in self._memo:
            self._memo[value] = self._computed(value)
        return self._memo[value]

    def _computed(self, value: sp.Expr) -> PolyElement:
        ring = self._ring
        if value.is_Rational:
            return ring(sp.QQ(int(value.p), int(value.q)))
        if value.is_Add:
            total = ring.zero
            for item in value.args:
                total = total + self._polynomial(item)
            return total
        if value.is_Mul:
            product = ring.one
            for item in sorted((self._polynomial(item) for item in value.args), key=len):
                product = product * item
            return product
        if value.is_Pow and value.exp.is_Integer:
            exponent = int(value.exp)
            if exponent < 0:
                return self._place[self._bases[value.base]] ** -exponent
            return self._polynomial(value.base) ** exponent
        return self._place[self._atoms[value]]

    def left(self) -> PolyElement:
        """The numerator over the product of all denominators."""
        found = self._polynomial(self._expression)
        for base, inverse in reversed(self._bases.items()):
            if found == 0:
                break
            found = self._cleared(found, self._place[inverse], self._polynomial(base))
        return found

    def _cleared(self, value: PolyElement, inverse: PolyElement, base: PolyElement) -> PolyElement:
        place = self._ring.gens.index(inverse)
        parts: dict[int, dict[tuple[int, ...], sp.Rational]] = {}
        for monomial, factor in value.terms():
            rest = (*monomial[:place], 0, *monomial[place + 1 :])
            parts.setdefault(monomial[place], {})[rest] = factor
        total = self._ring.zero
        for power in range(max(parts) + 1):  # Horner's rule, from the power 0 of the inverse up
            total = total * base + self._ring.from_dict(parts.get(power, {}))
        return total
