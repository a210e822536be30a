"""heyoka's expressions, for programs of named equations."""

from __future__ import annotations

from typing import Any

import sympy as sp


class Expressions:
    """heyoka's expressions as an algebra for a program of named equations."""

    def __init__(self, heyoka: Any) -> None:
        self._heyoka = heyoka

    def constant(self, value: sp.Expr) -> Any:
        """The nearest double."""
        return self._heyoka.expression(
            float(sp.Rational(value).p / sp.Rational(value).q if value.is_Rational else value)
        )

    def add(self, a: Any, b: Any) -> Any:
        """Sum."""
        return a + b

    def multiply(self, a: Any, b: Any) -> Any:
        """Product."""
        return a * b

    def power(self, a: Any, exponent: sp.Rational) -> Any:
        """Power; a whole one as a product: heyoka's recurrence of others divides by the base."""
        if exponent.is_Integer and exponent > 0:
            product = a
            for _ in range(int(exponent) - 1):
                product = product * a
            return product
        return a ** float(exponent)

    def apply(self, function: str, *arguments: Any) -> Any:
        """A named function; of two constants, the lesser or the greater by their distance."""
        if function in ("Min", "Max"):
            a, b = arguments
            distance = self._heyoka.sqrt((a - b) * (a - b))
            return 0.5 * (a + b - distance if function == "Min" else a + b + distance)
        return getattr(self._heyoka, function)(*arguments)
