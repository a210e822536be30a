"""A reference that is data: between two break points ``P(tau) + exp(-a tau) Q(tau)``, tau = t - t_k.

Polynomials are splines, steps and ramps; with the exponential they are what a chain of first-order filters
makes of steps and ramps. The coefficients are run-time parameters, so one law serves every such reference.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.equation import real_symbol


def segment_symbols(p: int, q: int) -> tuple[sp.Symbol, ...]:
    """The parameters: t_k, a, the coefficients of P and of Q, constant terms first.

    Args:
        p: degree of P.
        q: degree of Q.
    """
    ends = ("t", "a", *(f"p{i}" for i in range(p + 1)), *(f"q{i}" for i in range(q + 1)))
    return tuple(real_symbol(f"ref_{end}") for end in ends)


def segment_sizes(symbols: tuple[sp.Symbol, ...], rho: int) -> tuple[int, int]:
    """Degrees of P and of Q, from the parameters of a segment; Q's is rho."""
    return len(symbols) - rho - 4, rho


def segment_reference(p: int, q: int, order: int = 0) -> sp.Expr:
    """The reference as a function of t and of `segment_symbols`, or a derivative of it.

    By Leibniz's rule, so that the page keeps one exponential and the derivatives of Q.
    """
    start, a, *coefficients = segment_symbols(p, q)
    tau = sp.Dummy("tau", real=True)
    polynomial = sum(c * tau**i for i, c in enumerate(coefficients[: p + 1]))
    fading = sum(c * tau**i for i, c in enumerate(coefficients[p + 1 :]))
    rest = sum(
        sp.binomial(order, k) * (-a) ** (order - k) * sp.diff(fading, tau, k) for k in range(order + 1)
    )
    whole = sp.diff(polynomial, tau, order) + sp.exp(-a * tau) * rest
    return whole.xreplace({tau: real_symbol("t") - start})
