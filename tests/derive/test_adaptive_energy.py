"""V' in numbers of many digits: V as it is reported, moved along the loop, against what theory says of it.

Nothing of the symbolic proof is used. The right side is written out once more, with P solved for in numbers.
A step of 1e-45 at 140 digits leaves an error of about 1e-90 in a difference quotient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mpmath
import pytest

from pmjoint_derive import Derivation, Model, Parameter, derive
from tests.derive.adaptive_models import adaptive, undisturbed_output
from tests.derive.adaptive_numbers import Numbers, Values, drawn

ORDERS = [(1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 3)]
CASES = [(*order, sign, inverse) for order in ORDERS for sign in (1, -1) for inverse in (False, True)]
CASES += [(4, 4, 1, False), (4, 4, -1, True)]
DIGITS, STEP, CLOSE = 140, "1e-45", "1e-40"


def with_gain(model: Model, sign: int) -> Model:
    """Return the model with b_m of that sign."""
    own = tuple(
        Parameter("b0", 2.0 * sign, "", "") if item.name == "b0" else item for item in model.parameters
    )
    return replace(model, parameters=own)


def lyapunov_solution(k: list[Any]) -> mpmath.matrix:
    """Return P of P A0 + A0' P = -2 I, from the linear equations for its entries."""
    n = len(k)
    A = mpmath.matrix(n, n)
    for i in range(n):
        A[i, 0] -= k[i]
        if i + 1 < n:
            A[i, i + 1] += 1
    system, right = mpmath.matrix(n * n, n * n), mpmath.matrix(n * n, 1)
    for i in range(n):
        right[i * n + i] = -2
        for j in range(n):
            for m in range(n):
                system[i * n + j, i * n + m] += A[m, j]
                system[i * n + j, m * n + j] += A[m, i]
    solution = mpmath.lu_solve(system, right)
    return mpmath.matrix([[solution[i * n + j] for j in range(n)] for i in range(n)])


def true_entries(derivation: Derivation, at: Values) -> list[tuple[Any, Any, Any]]:
    """Return truth, estimate and prior of what is estimated."""
    adaptation, truth = derivation.model.adaptation, derivation.design.truth
    assert adaptation is not None
    found = []
    for entry in adaptation.unknown:
        value = (*truth.b, *truth.theta)[entry.place]
        exact = at[value.name] if value.is_Symbol else mpmath.mpf(int(value.p)) / int(value.q)
        found.append((exact, at[entry.estimate.name], at.get(entry.prior_symbol.name)))
    return found


def leaked(derivation: Derivation, at: Values) -> Any:
    """Return L of leakage."""
    total = mpmath.mpf(0)
    for true, hat, prior in true_entries(derivation, at):
        total += at["leakage"] / 2 * ((true - prior) ** 2 - (true - hat) ** 2 - (hat - prior) ** 2)
    if "rho_hat" in at:
        b_m, hat, prior = at["b0"], at["rho_hat"], at["rho_prior"]
        squares = (1 / b_m - prior) ** 2 - (1 / b_m - hat) ** 2 - (hat - prior) ** 2
        total += abs(b_m) * at["rho_leakage"] / 2 * squares
    return total


def errors(derivation: Derivation, at: Values) -> tuple[list[Any], list[Any]]:
    """Return ``w_i z_i^2`` and ``w_i s_i z_i``."""
    s = derivation.signals
    w = [mpmath.mpf(1)] + [at[s.input_scale.name] ** 2] * (len(s.z) - 1)
    s_ = [mpmath.mpf(-1)] + [at[f"d{alpha}_dy"] for alpha in s.alpha]
    z = [at[item.name] for item in s.z]
    return (
        [weight * value**2 for weight, value in zip(w, z, strict=True)],
        [weight * slope * value for weight, slope, value in zip(w, s_, z, strict=True)],
    )


def claimed(derivation: Derivation, at: Values, *, disturbed: bool) -> Any:
    """Return V' as theory has it, with its squares."""
    s, n = derivation.signals, derivation.plant.order
    c, e, k = ([at[item.name] for item in symbols] for symbols in (s.c, s.e, s.k))
    epsilon, D = ([at[f"{stem}{i + 1}"] for i in range(n)] for stem in ("epsilon", "D"))
    E = sum(1 / (2 * gain) for gain in e)
    P = lyapunov_solution(k)
    PD = [sum(P[i, j] * D[j] for j in range(n)) for i in range(n)]
    eta = (epsilon[1] if n > 1 else 0) + D[0]
    energies, slopes = errors(derivation, at)
    total = leaked(derivation, at) - sum(gain * value for gain, value in zip(c, energies, strict=True))
    total -= sum(gain * (value + eta / (2 * gain)) ** 2 for gain, value in zip(e, slopes, strict=True))
    others = sum(value**2 for j, value in enumerate(epsilon) if j != 1)
    total -= E / 2 * sum(value**2 for value in epsilon)
    if not disturbed:
        total += E * sum(value**2 for value in PD)
        total -= E * sum((value - entry) ** 2 for value, entry in zip(epsilon, PD, strict=True))
        return total - E / 2 * others
    total += 2 * E * sum(value**2 for value in PD) + E * D[0] ** 2
    total -= 2 * E * sum((value / 2 - entry) ** 2 for value, entry in zip(epsilon, PD, strict=True))
    return total - E * others - E / 2 * (eta - 2 * D[0]) ** 2


@pytest.mark.parametrize(("n", "rho", "sign", "inverse"), CASES)
def test_the_rate_of_the_reported_v(
    builder: Callable[..., Model], n: int, rho: int, sign: int, inverse: bool
) -> None:
    model = with_gain(builder(n, rho), sign)
    derivation = derive(adaptive(model, ranged=not inverse, inverse=inverse, sign=sign))
    check(derivation, "V", lambda at: claimed(derivation, at, disturbed=True))


def test_the_rate_where_nothing_disturbs_the_output(builder: Callable[..., Model]) -> None:
    derivation = derive(adaptive(undisturbed_output(builder(3, 2)), inverse=True))
    check(derivation, "V", lambda at: claimed(derivation, at, disturbed=False))


@pytest.mark.parametrize("order", [(2, 1), (3, 2)], ids=lambda order: f"n{order[0]}rho{order[1]}")
def test_the_rate_of_the_errors_under_least_squares(
    builder: Callable[..., Model], order: tuple[int, int]
) -> None:
    derivation = derive(adaptive(builder(*order), squares=True))
    s, adaptation = derivation.signals, derivation.model.adaptation
    assert adaptation is not None
    assert "V" not in derivation.equations

    def rate(at: Values) -> Any:
        energies, slopes = errors(derivation, at)
        eta = at["epsilon2"] + at["D1"]
        pairs = zip(true_entries(derivation, at), adaptation.unknown, strict=True)
        eta += sum((true - hat) * at[f"omega_{entry.name}"] for (true, hat, _), entry in pairs)
        gains = zip(s.c, s.e, energies, slopes, strict=True)
        return sum(-at[c.name] * value - at[e.name] * slope**2 - slope * eta for c, e, value, slope in gains)

    numbers = Numbers.of(derivation)
    with mpmath.workdps(DIGITS):
        for seed in range(2):
            point = drawn(derivation, seed)
            at = numbers.at(point)
            weights = [mpmath.mpf(1)] + [at["input_scale"] ** 2] * (len(s.z) - 1)
            found = sum(
                weight * at[z.name] * numbers.along(z.name, point, mpmath.mpf(STEP))
                for weight, z in zip(weights, s.z, strict=True)
            )
            assert abs(found - rate(at)) < mpmath.mpf(CLOSE) * (1 + abs(found))


def check(derivation: Derivation, name: str, expected: Callable[[Values], Any]) -> None:
    """Compare the rate of a quantity with a formula at random points, to 40 digits."""
    numbers = Numbers.of(derivation)
    with mpmath.workdps(DIGITS):
        for seed in range(2):
            point = drawn(derivation, seed)
            found = numbers.along(name, point, mpmath.mpf(STEP))
            right = expected(numbers.at(point))
            assert abs(found) > 1e-3
            assert abs(found - right) < mpmath.mpf(CLOSE) * (1 + abs(found))
