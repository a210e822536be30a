"""Limits on the powers of an expression, checked before SymPy computes them.

SymPy computes powers of exact numbers exactly and treats ``y**(p/q)`` and ``exp(p/q*y)`` as polynomials of
degree p, so a few characters can cost unbounded time. Each function gives the reason for a refusal, or None.
"""

from __future__ import annotations

import math

import sympy as sp

LARGEST_EXPONENT = 64
_MOST_BITS = 4096  # of an exact number after it is raised
_LONGEST_EXPONENT = 10**4  # numerator and denominator of a constant exponent: four decimals
_LONGEST_FACTOR = 10**6  # the same of a factor inside exp or of a symbolic exponent
_LARGEST_EXPANDED = 10**4  # what an exponent may come to when SymPy multiplies it out


def power_too_large(base: sp.Expr, exponent: sp.Expr, value: float | None) -> str | None:
    """Check ``base**exponent`` before it is computed; `value` is the exponent's, if it is constant."""
    found = None if value is None else _growth_too_large(base, abs(value))
    return found or _exponent_too_long(exponent) or exponential_too_large(exponent)


def exponential_too_large(exponent: sp.Expr) -> str | None:
    """Check ``exp(exponent)`` before it is computed: SymPy turns ``exp(1e8*log(y))`` into y**1e8."""
    for product in exponent.atoms(sp.Mul):
        factor, rest = product.as_coeff_Mul()
        of_log = any(isinstance(part, sp.log) for part in sp.Mul.make_args(rest))
        if of_log and (found := _growth_too_large(rest, abs(factor))):
            return found
    return None


def expansion_too_large(name: str, argument: sp.Expr) -> str | None:
    """Check ``tanh(argument)`` or the like, which SymPy would expand into real and imaginary parts."""
    exponents = [part.as_base_exp()[1] for part in argument.atoms(sp.Pow, sp.exp)]
    if any(_expanded(exponent) > _LARGEST_EXPANDED for exponent in exponents if not exponent.is_Integer):
        return f"an exponent inside {name} has too many digits"
    return None


def _expanded(expression: sp.Expr) -> float:
    """Bound the numbers that an expression holds when its products and powers are multiplied out."""
    if expression.is_Rational:
        return float(min(_length(expression), _LARGEST_EXPANDED + 1))
    parts = [_expanded(part) for part in expression.args]
    if expression.is_Add:
        return sum(parts)
    if expression.is_Mul:
        return math.prod(parts)
    if expression.is_Pow and expression.exp.is_Rational:
        return parts[0] ** min(abs(float(expression.exp)), LARGEST_EXPONENT) if parts[0] < 1e4 else math.inf
    return max(parts, default=1.0)


def exponents_too_long(expression: sp.Expr) -> str | None:
    """Check the result of a product or power, whose exponents SymPy adds up."""
    for base, exponent in (factor.as_base_exp() for factor in sp.Mul.make_args(expression)):
        found = _exponent_too_long(exponent)
        if exponent.is_Rational and base is not sp.E and abs(exponent) > LARGEST_EXPONENT:
            found = f"the exponent {float(exponent):g} is too large"
        if found:
            return found
    return None


def _exponent_too_long(exponent: sp.Expr) -> str | None:
    """Check the numbers that SymPy would take as degrees of polynomials."""
    if exponent.is_Rational and _length(exponent) > _LONGEST_EXPONENT:
        return "a constant exponent has too many digits"
    if any(_length(term.as_coeff_Mul()[0]) > _LONGEST_FACTOR for term in sp.Add.make_args(exponent)):
        return "a factor in an exponent has too many digits"
    return None


def _growth_too_large(base: sp.Expr, exponent: float | sp.Number) -> str | None:
    if exponent > LARGEST_EXPONENT:
        return f"the exponent {float(exponent):g} is too large"
    bits = max((abs(n.p).bit_length() + n.q.bit_length() for n in base.atoms(sp.Rational)), default=0)
    return "a power of a number has too many digits" if bits * exponent > _MOST_BITS else None


def _length(number: sp.Rational) -> int:
    return int(max(abs(number.p), number.q))
