"""Taylor coefficients against closed-form solutions and against each other, to rounding."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import mpmath as mp
import numpy as np
import pytest

from pmjoint_codegen.emit.compact import compact_function
from pmjoint_codegen.emit.taylor import taylor_function
from pmjoint_codegen.errors import ModelError

ORDER = 14


def scalar_ode(rate: Callable[[ca.SX, ca.SX, ca.SX], ca.SX], *, compact: bool = False) -> ca.Function:
    """Coefficients of ``x' = rate(t, x, p)``."""
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x"), ca.SX.sym("p")
    f = ca.Function("f", [t, x, p], [rate(t, x, p)], ["t", "x", "p"], ["x_dot"])
    if compact:
        return compact_function("taylor", f, ORDER, state="x").unrolled()
    return taylor_function("taylor", f, ORDER, state="x")


CLOSED_FORMS: dict[str, tuple[Callable[[ca.SX, ca.SX, ca.SX], ca.SX], Callable[[mp.mpf], mp.mpf], float]] = {
    # name: (rate, solution x(t) with p = 3, starting time)
    "linear": (lambda t, x, p: -p * x, lambda t: mp.exp(-3 * t), 0.2),
    "logistic, square and sub": (lambda t, x, p: p * (x - x * x), lambda t: 1 / (1 + mp.exp(-3 * t)), 0.1),
    "sine of time": (lambda t, x, p: ca.cos(p * t), lambda t: mp.sin(3 * t) / 3, 0.4),
    "cosine of time": (lambda t, x, p: ca.sin(p * t), lambda t: -mp.cos(3 * t) / 3, 0.4),
    "tangent": (lambda t, x, p: ca.tan(t) + 0 * p, lambda t: -mp.log(mp.cos(t)), 0.3),
    "hyperbolic tangent": (lambda t, x, p: ca.tanh(p * t), lambda t: mp.log(mp.cosh(3 * t)) / 3, 0.3),
    "inverse tangent": (
        lambda t, x, p: ca.atan(p * t),
        lambda t: t * mp.atan(3 * t) - mp.log(1 + 9 * t**2) / 6,
        0.3,
    ),
    "inverse tangent of the state": (
        lambda t, x, p: (1 + x * x) * ca.atan(x) / ca.atan(x),
        lambda t: mp.tan(t),
        0.3,
    ),
    "hyperbolic sine": (lambda t, x, p: ca.sinh(p * t), lambda t: mp.cosh(3 * t) / 3, 0.3),
    "hyperbolic cosine": (lambda t, x, p: ca.cosh(p * t), lambda t: mp.sinh(3 * t) / 3, 0.3),
    "exponential": (lambda t, x, p: ca.exp(-p * t), lambda t: -mp.exp(-3 * t) / 3, 0.3),
    "logarithm": (lambda t, x, p: ca.log(p + t), lambda t: (3 + t) * mp.log(3 + t) - t, 0.3),
    "root": (lambda t, x, p: ca.sqrt(p + t), lambda t: mp.mpf(2) / 3 * (3 + t) ** mp.mpf("1.5"), 0.3),
    "quotient": (lambda t, x, p: x / (p + t), lambda t: 3 + t, 0.3),
    "inverse": (lambda t, x, p: 1 / (p + t), lambda t: mp.log(3 + t), 0.3),
    "constant denominator": (lambda t, x, p: t / p, lambda t: t**2 / 6, 0.3),
    "real power": (lambda t, x, p: (p + t) ** 2.5, lambda t: (3 + t) ** mp.mpf("3.5") / mp.mpf("3.5"), 0.3),
    "product of series": (lambda t, x, p: t * ca.exp(t) * p, lambda t: 3 * (t - 1) * mp.exp(t), 0.3),
    "magnitude, left of its kink": (lambda t, x, p: ca.fabs(t - p), lambda t: 3 * t - t**2 / 2, 0.3),
    "sign": (lambda t, x, p: ca.sign(p - t) * t, lambda t: t**2 / 2, 0.3),
    "factors that cancel": (lambda t, x, p: -1.0 * ((p * x - x) - p * x), lambda t: mp.exp(t), 0.3),
    "nested linear": (
        lambda t, x, p: p * ((x - ca.sin(t)) / p + (x + ca.sin(t)) / p) / 2 - 2 * (x + t),
        lambda t: 2 * mp.exp(-t) - 2 * t + 2,
        0.3,
    ),
    "products that differ by factors, and one that does not": (
        lambda t, x, p: (p * t) * t + 2 * (t * t) + (1 + t) * t,
        lambda t: 5 * t**3 / 3 + t**2 / 2 + t**3 / 3,
        0.3,
    ),
    "quotients that differ by factors": (
        lambda t, x, p: p / (1 + t) + 2 / (1 + t) + (p * t) / (1 + t) - t / (2 * (1 + t)),
        lambda t: 5 * mp.log(1 + t) + mp.mpf("2.5") * (t - mp.log(1 + t)),
        0.3,
    ),
    "sine and cosine of one argument": (
        lambda t, x, p: ca.sin(p * t) * ca.cos(p * t),
        lambda t: mp.sin(3 * t) ** 2 / 6,
        0.3,
    ),
    "twice and negation": (lambda t, x, p: -(x + x), lambda t: mp.exp(-2 * t), 0.3),
}


@pytest.mark.parametrize("compact", [False, True], ids=["straight", "compact"])
@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_coefficients_of_closed_form_solutions(name: str, compact: bool) -> None:
    rate, solution, start = CLOSED_FORMS[name]
    with mp.workdps(50):
        expected = [float(value) for value in mp.taylor(solution, start, ORDER)]
    found = np.array(scalar_ode(rate, compact=compact)(start, expected[0], 3.0)).ravel()
    # every coefficient is a sum of at most ORDER products: ORDER^2 roundings; condition 10 for these
    bound = 10 * ORDER**2 * np.finfo(float).eps * np.maximum(np.abs(expected), 1e-3)
    assert np.all(np.abs(found - expected) <= bound)


def test_a_wrong_recurrence_would_be_seen() -> None:
    _, solution, start = CLOSED_FORMS["sine of time"]
    expected = [float(value) for value in mp.taylor(solution, start, ORDER)]
    found = np.array(scalar_ode(lambda t, x, p: ca.cos(p * t) * (1 + 1e-12))(start, expected[0], 3.0)).ravel()
    assert not np.allclose(found, expected, rtol=1e-13, atol=0)


def test_carried_outputs_follow_the_state() -> None:
    """A further output's coefficients are those of the output along the solution: v = x^2, x = exp(-t)."""
    t, x = ca.SX.sym("t"), ca.SX.sym("x")
    f = ca.Function("f", [t, x], [-x, x * x], ["t", "x"], ["x_dot", "v"])
    rows = np.array(taylor_function("taylor", f, 6, state="x")(0.0, 1.0)).reshape(7, 2)
    k = np.arange(7)
    factorial = np.array([math.factorial(i) for i in k])
    np.testing.assert_allclose(rows[:, 0], (-1.0) ** k / factorial, rtol=1e-15)
    np.testing.assert_allclose(rows[:, 1], (-2.0) ** k / factorial, rtol=1e-15)


def test_what_is_not_analytic_is_refused() -> None:
    with pytest.raises(ModelError, match=r"fmin .* no Taylor recurrence"):
        scalar_ode(lambda t, x, p: ca.fmin(x, t))
