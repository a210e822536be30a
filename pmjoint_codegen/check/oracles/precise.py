"""Sixty-digit arithmetic for the reference: numbers, and truncated power series of them.

The series do not use the recurrences of the Taylor kernels: a function of a series is its Taylor expansion
about the leading coefficient, evaluated at the rest, which is nilpotent.
"""

from __future__ import annotations

import sys
from typing import Any

import mpmath
import sympy as sp

from pmjoint_codegen.operations import by_sympy

DIGITS = 60
ANGULAR = frozenset(("sin", "cos", "tan"))
LARGEST = sys.float_info.max

Number = Any  # mpmath.mpf; mpmath carries no types
Series = list[Any]


class Numbers:
    """Real numbers of :data:`DIGITS` digits."""

    def __init__(self) -> None:
        """Make a separate context, independent of any other precision setting."""
        self.context = mpmath.MPContext()
        self.context.dps = DIGITS

    def exactly(self, value: float) -> Number:
        """A double, without any rounding."""
        return self.context.mpf(value)

    def constant(self, value: sp.Expr) -> Number:
        """An exact number, rounded to 60 digits."""
        if value.is_Rational:
            return self.context.mpf(int(value.p)) / int(value.q)
        return self.context.mpf(str(sp.N(value, DIGITS + 5)))

    def add(self, a: Number, b: Number) -> Number:
        """Sum."""
        return a + b

    def multiply(self, a: Number, b: Number) -> Number:
        """Product."""
        return a * b

    def power(self, a: Number, exponent: sp.Rational) -> Number:
        """Power with a rational exponent."""
        if exponent.is_Integer:
            return a ** int(exponent)
        return self.context.power(a, self.constant(exponent))

    def apply(self, function: str, *arguments: Number) -> Number:
        """A named function."""
        if function in ("Min", "Max"):
            return min(arguments) if function == "Min" else max(arguments)
        if function in ANGULAR:
            arguments = (self.angle(arguments[0]),)
        return by_sympy()[function].of(self.context)(*arguments)

    def angle(self, a: Number) -> Number:
        """An angle; NaN beyond all doubles, where kernels have none: pi to as many digits takes hours."""
        return a if abs(a) <= LARGEST else self.context.nan


class PowerSeries:
    """Power series in time, truncated after ``order``; a list of coefficients, shorter if the rest is zero.

    Attributes:
        numbers: the coefficients' arithmetic.
        order: highest power kept.
    """

    def __init__(self, numbers: Numbers, order: int) -> None:
        self.numbers = numbers
        self.order = order

    def constant(self, value: sp.Expr) -> Series:
        """A number as a series."""
        return [self.numbers.constant(value)]

    def add(self, a: Series, b: Series) -> Series:
        """Sum."""
        longer, shorter = (a, b) if len(a) >= len(b) else (b, a)
        return [entry + shorter[i] if i < len(shorter) else entry for i, entry in enumerate(longer)]

    def multiply(self, a: Series, b: Series) -> Series:
        """Product, truncated."""
        size = min(len(a) + len(b) - 1, self.order + 1)
        product = [self.numbers.context.zero] * size
        for i, left in enumerate(a):
            for j, right in enumerate(b[: size - i]):
                product[i + j] += left * right
        return product

    def power(self, a: Series, exponent: sp.Rational) -> Series:
        """Power: the binomial series about the leading coefficient, or repeated products."""
        if exponent.is_Integer and exponent >= 0:
            result = [self.numbers.context.one]
            for _ in range(int(exponent)):
                result = self.multiply(result, a)
            return result
        value, coefficients = self.numbers.power(a[0], exponent), []
        for k in range(self._terms(a)):
            coefficients.append(value)
            value = value * self.numbers.constant(exponent - k) / (k + 1) / a[0]
        return self._compose(coefficients, a)

    def apply(self, function: str, *arguments: Series) -> Series:
        """A named function: its Taylor expansion about the leading coefficient.

        On a kink, which has none, ``abs`` is flat, as in the kernels.
        """
        if function in ("Min", "Max") and all(len(argument) == 1 for argument in arguments):
            return [self.numbers.apply(function, *(argument[0] for argument in arguments))]
        (a,) = arguments
        if function in ("Abs", "sign"):
            slope = self.numbers.apply("sign", a[0])
            return [slope] if function == "sign" else [abs(a[0]), *(slope * entry for entry in a[1:])]
        if function in ("tan", "tanh"):
            above, below = ("sin", "cos") if function == "tan" else ("sinh", "cosh")
            return self.multiply(self.apply(above, a), self.power(self.apply(below, a), sp.Integer(-1)))
        return self._compose(self._expansion(function, a[0], self._terms(a)), a)

    def _terms(self, a: Series) -> int:
        return self.order + 1 if len(a) > 1 else 1

    def _expansion(self, function: str, at: Number, terms: int) -> list[Number]:
        """Taylor coefficients of an elementary function about ``at``.

        They come from its derivatives in closed form, or else from mpmath's differences of its values.
        """
        m = self.numbers.context
        at = self.numbers.angle(at) if function in ANGULAR else at
        if function == "log":
            return [m.ln(at), *(-((-1) ** k) / (k * at**k) for k in range(1, terms))]
        sine, cosine = (m.sinh, m.cosh) if function in ("sinh", "cosh") else (m.sin, m.cos)
        cycles = {
            "exp": (m.exp(at),),
            "sin": (m.sin(at), m.cos(at), -m.sin(at), -m.cos(at)),
            "cos": (m.cos(at), -m.sin(at), -m.cos(at), m.sin(at)),
            "sinh": (sine(at), cosine(at)),
            "cosh": (cosine(at), sine(at)),
        }
        if function not in cycles:
            return list(m.taylor(by_sympy()[function].of(m), at, terms - 1))
        cycle = cycles[function]
        return [cycle[k % len(cycle)] / m.factorial(k) for k in range(terms)]

    def _compose(self, coefficients: list[Number], a: Series) -> Series:
        """``sum_k coefficients[k] (a - a[0])^k`` by Horner's rule."""
        rest = [self.numbers.context.zero, *a[1:]]
        result = [coefficients[-1]]
        for coefficient in reversed(coefficients[:-1]):
            result = self.add(self.multiply(result, rest), [coefficient])
        return result
