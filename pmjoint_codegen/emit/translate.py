"""SymPy to CasADi, one expression graph: equal subexpressions become one node.

A symbol in an expression is an input of the kernel, a name that another equation defines, or an error at
specification time. Integer powers become products and quotients stay quotients, so the kernel computes what
the page shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import casadi as ca
import sympy as sp

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.operations import by_sympy, remedy
from pmjoint_derive import Equations


class Translator:
    """Translates expressions of one kernel, following names to their equations.

    Args:
        kernel: the kernel's name, for messages.
        inputs: CasADi symbol of each input.
        given: definitions for this kernel only, with priority over the equations.
        equations: the derivation's named equations.
        sides: argument of a kink -> the symbol of its side; the kinks of others stay as they are.
    """

    def __init__(
        self,
        kernel: str,
        inputs: Mapping[sp.Symbol, ca.SX],
        given: Mapping[sp.Symbol, sp.Expr],
        equations: Equations,
        sides: Mapping[sp.Expr, sp.Symbol] | None = None,
    ) -> None:
        """Start with the inputs as the only known nodes."""
        self._kernel = kernel
        self._given = given
        self._equations = equations
        self._sides = sides or {}
        self._functions = by_sympy()
        self._nodes: dict[sp.Basic, ca.SX] = dict(inputs)

    def __call__(self, expression: sp.Expr) -> ca.SX:
        """The CasADi node of an expression.

        Raises:
            ModelError: for a symbol that is neither input nor defined, or a function that no kernel can hold.
        """
        if expression not in self._nodes:
            self._nodes[expression] = self._translate(expression)
        return self._nodes[expression]

    def _translate(self, value: sp.Expr) -> ca.SX:
        if value.is_Symbol:
            return self(self._definition(value))
        if value.is_Rational:
            return ca.SX(self._nearest(value))
        if value.is_number and (value.is_Float or value.is_NumberSymbol):
            return ca.SX(float(value))
        if value.is_Add:
            return self._sum(value)
        if value.is_Mul:
            return self._product(value)
        if value.is_Pow:
            return self._power(value.base, value.exp)
        if isinstance(value, sp.Abs | sp.sign) and value.args[0] in self._sides:
            side = self(self._sides[value.args[0]])
            return side * self(value.args[0]) if isinstance(value, sp.Abs) else side
        operation = self._functions.get(value.func.__name__)
        if operation is None:
            raise ModelError(
                what=f"no kernel can evaluate {value.func.__name__}(...)",
                where=f"kernel {self._kernel}",
                remedy=remedy(),
            )
        arguments = [self(argument) for argument in value.args]
        function = operation.of(ca)
        return function(*arguments) if operation.arity == 1 else reduce(function, arguments)

    def _nearest(self, value: sp.Rational) -> float:
        """The nearest double: Python divides integers with correct rounding."""
        try:
            return float(value.p / value.q)
        except OverflowError:
            raise ModelError(
                what="a number, or its inverse, overflows floating point",
                where=f"kernel {self._kernel}",
                remedy="allowed: magnitudes from 1e-300 to 1e300",
            ) from None

    def _definition(self, symbol: sp.Symbol) -> sp.Expr:
        if symbol in self._given:
            return self._given[symbol]
        if symbol.name in self._equations:
            return self._equations[symbol.name].expression
        raise ModelError(
            what=f"{symbol.name} is neither an input of the kernel nor defined by an equation",
            where=f"kernel {self._kernel}",
            remedy="add it to the kernel's inputs or define it",
        )

    def _sum(self, value: sp.Expr) -> ca.SX:
        terms = sorted(value.as_ordered_terms(), key=lambda term: term.could_extract_minus_sign())
        result = self(terms[0])
        for term in terms[1:]:
            negative = term.could_extract_minus_sign()
            result = result - self(-term) if negative else result + self(term)
        return result

    def _product(self, value: sp.Expr) -> ca.SX:
        """Numerator factors over denominator factors, as written; no common denominator is formed."""
        if value.could_extract_minus_sign():
            return -self(-value)
        above: list[sp.Expr] = []
        below: list[sp.Expr] = []
        for factor in value.as_ordered_factors():
            if factor.is_Rational:
                above += [sp.Integer(factor.p)] if factor.p != 1 else []
                below += [sp.Integer(factor.q)] if factor.q != 1 else []
            elif factor.is_Pow and factor.base != sp.E and factor.exp.is_Rational and factor.exp < 0:
                below.append(factor.base**-factor.exp)
            else:
                above.append(factor)
        numerator = self._chain(above)
        return numerator / self._chain(below) if below else numerator

    def _chain(self, factors: list[sp.Expr]) -> ca.SX:
        result = self(factors[0]) if factors else ca.SX(1)
        for factor in factors[1:]:
            result = result * self(factor)
        return result

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> ca.SX:
        if exponent.is_Integer:
            magnitude = self._integer_power(self(base), abs(int(exponent)))
            return magnitude if exponent > 0 else 1 / magnitude
        if exponent.is_Rational and exponent.q in (2, 4):
            root = ca.sqrt(self(base)) if exponent.q == 2 else ca.sqrt(self(sp.sqrt(base)))
            magnitude = self._integer_power(root, abs(int(exponent.p)))
            return magnitude if exponent > 0 else 1 / magnitude
        if base == sp.E:
            return ca.exp(self(exponent))
        if exponent.is_number:
            return self(base) ** float(exponent)
        return ca.exp(self(exponent) * ca.log(self(base)))

    def _integer_power(self, base: ca.SX, exponent: int) -> ca.SX:
        """Power by repeated squaring: products only, exact derivatives, no pow() in the C."""
        if exponent == 1:
            return base
        half = self._integer_power(base, exponent // 2)
        return half * half if exponent % 2 == 0 else half * half * base
