"""A reference that is data: between two break points ``P(tau) + exp(-a tau) Q(tau)``, tau = t - t_k.

Polynomials are splines, steps and ramps; with the exponential they are what a chain of first-order filters
makes of steps and ramps. The coefficients are run-time parameters, so one law serves every such reference.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.model import real_symbol


def segment_symbols(p: int, q: int) -> tuple[sp.Symbol, ...]:
    """The parameters: t_k, a, the coefficients of P and of Q, constant terms first.

    Args:
        p: degree of P.
        q: degree of Q.
    """
    ends = ("t", "a", *(f"p{i}" for i in range(p + 1)), *(f"q{i}" for i in range(q + 1)))
    return tuple(real_symbol(f"ref_{end}") for end in ends)


def segment_reference(p: int, q: int) -> sp.Expr:
    """The reference as a function of t and of `segment_symbols`."""
    start, a, *coefficients = segment_symbols(p, q)
    tau = real_symbol("t") - start
    polynomial = sum(c * tau**i for i, c in enumerate(coefficients[: p + 1]))
    fading = sum(c * tau**i for i, c in enumerate(coefficients[p + 1 :]))
    return polynomial + sp.exp(-a * tau) * fading
