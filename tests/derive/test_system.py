"""A system's transformation to output-feedback form is what it claims to be, and is found where it exists."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np
import pytest
import sympy as sp
from scipy.signal import ss2tf

from pmjoint_derive import OutsideClassError, real_symbol
from pmjoint_derive.elimination import Elimination, eliminate
from pmjoint_derive.observer_form import coordinates, observer_form
from pmjoint_derive.peeling import peeled_form
from pmjoint_derive.physics import U, Y, split
from pmjoint_derive.system import reduce_system, transfer_plant

S = real_symbol
theta, omega, p, q, w = (S(name) for name in ("theta", "omega", "p", "q", "w"))
J, B, g, K, tau, a = (S(name) for name in ("J", "B", "g", "K", "tau", "a"))

Written = tuple[tuple[sp.Symbol, ...], tuple[sp.Expr, ...], sp.Expr]
SYSTEMS: dict[str, Written] = {
    "pendulum with a lag": (
        (theta, omega, p),
        (omega, (p - B * omega - g * sp.sin(theta)) / J, (U - p) / tau),
        theta,
    ),
    "flexible joint": (
        (theta, omega, q, w),
        (omega, (-K * (theta - q) - g * sp.sin(theta)) / J, w, K * (theta - q) - B * w + U),
        theta,
    ),
    "magnet": ((q, w), (w, g - K * U / (2 * q**2)), q),
    "a zero, measured sum": ((omega, p), (p - B * omega, (U - p) / tau), p + a * omega),
    "damping of the angle": (
        (theta, omega, p),
        (omega, (p - B * sp.cos(theta) ** 2 * omega - g * sp.sin(theta)) / J, (U - p) / tau),
        theta,
    ),
    "damping and sigma": (
        (theta, omega),
        (omega, -B * sp.tanh(a * theta) ** 2 * omega + (2 + sp.cos(theta)) * U),
        theta,
    ),
    "back electromotive force of the angle": (
        (theta, omega, p),
        (omega, p / J, (U - p - K * theta * omega) / tau),
        theta,
    ),
}


def rates_in_form(found: Elimination) -> list[sp.Expr]:
    """``x_{i+1} + phi_i(y) + b_i sigma(y) u``."""
    order = len(found.form.phi)
    x = (*coordinates(order), sp.Integer(0))
    b = (sp.Integer(0),) * (order - len(found.b)) + found.b
    return [x[i + 1] + found.form.phi[i] + b[i] * found.sigma * U for i in range(order)]


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_transformed_field_is_that_of_the_physics(name: str) -> None:
    """``dX/ds (f + g u)`` equals the form's rates at ``x = X(s)``, and back undoes forward: exactly."""
    states, rates, output = SYSTEMS[name]
    found = eliminate(states, rates, output)
    form = found.form
    there = dict(zip(coordinates(len(states)), form.forward, strict=True)) | {Y: output}
    for value, expected in zip(form.forward, rates_in_form(found), strict=True):
        moved = sum(sp.diff(value, state) * rate for state, rate in zip(states, rates, strict=True))
        assert sp.simplify(moved - expected.xreplace(there)) == 0
    for state in states:
        assert sp.simplify(form.back[state].xreplace(there) - state) == 0
    assert form.forward[0] == output


@pytest.mark.parametrize("name", [name for name in SYSTEMS if "damping" not in name and "back" not in name])
def test_both_ways_agree_where_both_go(name: str) -> None:
    physics = split(*SYSTEMS[name])
    linear, peeled = observer_form(physics), peeled_form(physics)
    assert linear is not None
    for one, other in (
        (linear.phi, peeled.phi),
        (linear.gain, peeled.gain),
        (linear.forward, peeled.forward),
    ):
        assert [sp.simplify(x - y) for x, y in zip(one, other, strict=True)] == [0] * len(one)


@pytest.mark.parametrize("seed", range(12))
def test_a_drawn_linear_system_has_the_transfer_function_that_scipy_finds(seed: int) -> None:
    draw = random.Random(seed)
    n = 1 + seed % 5
    A = np.array([[draw.randint(-3, 3) for _ in range(n)] for _ in range(n)], dtype=float)
    b = np.array([[draw.randint(-3, 3)] for _ in range(n)], dtype=float)
    c = np.array([[draw.randint(-2, 2) for _ in range(n)]], dtype=float)
    c[0, draw.randrange(n)] = 1.0
    numerator, denominator = ss2tf(A, b, c, np.zeros((1, 1)))
    states = tuple(S(f"s_{i}") for i in range(n))
    exact = [sp.Matrix(M.astype(int).tolist()) for M in (A, b, c)]
    rates = exact[0] * sp.Matrix(states) + exact[1] * U
    observable = sp.Matrix.vstack(*(exact[2] * exact[0] ** i for i in range(n))).rank() == n
    reached = any((exact[2] * exact[0] ** i * exact[1])[0] != 0 for i in range(n))
    if not observable or not reached:
        with pytest.raises(OutsideClassError):
            eliminate(states, tuple(rates), (exact[2] * sp.Matrix(states))[0])
        return
    found = eliminate(states, tuple(rates), (exact[2] * sp.Matrix(states))[0])
    slopes = [float(-sp.diff(entry, Y)) for entry in found.form.phi]
    gains = [0.0] * (n - len(found.b)) + [float(value * found.sigma) for value in found.b]
    np.testing.assert_allclose(slopes, denominator[1:], atol=1e-9 * np.abs(denominator).max())
    np.testing.assert_allclose(gains, numerator[0, 1:], atol=1e-9 * np.abs(numerator).max())


def drawn_form(draw: random.Random, n: int) -> tuple[list[sp.Expr], list[sp.Expr], sp.Expr]:
    """Phi with ``phi_i(0) = 0``, b and sigma of a member of the class."""
    odd = (Y, Y**3, sp.sin(Y), sp.tanh(2 * Y), Y**2)
    phi = [sum(draw.randint(-2, 2) * f for f in odd) for _ in range(n)]
    rho = draw.randint(1, n)
    b = [sp.Integer(0)] * (rho - 1) + [sp.Integer(draw.choice((-2, 1, 3))) for _ in range(n - rho + 1)]
    return phi, b, draw.choice((sp.Integer(1), 1 + Y**2, 2 + sp.cos(Y)))


def drawn_map(draw: random.Random, x: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """States of a triangular map: s_i is x_i times a number, and a function of the coordinates before."""
    forms = [x[0]]
    for i in range(1, len(x)):
        before = draw.choice((x[0] ** 2, sp.sin(x[0]), x[0] ** 3, x[i - 1] ** (2 if i > 1 else 1)))
        forms.append(draw.choice((1, 2, -1)) * x[i] + draw.randint(-1, 1) * before)
    return forms


@pytest.mark.parametrize("seed", range(12))
def test_a_form_behind_a_drawn_triangular_map_is_recovered(seed: int) -> None:
    draw = random.Random(100 + seed)
    n = 2 + seed % 2
    x, s = coordinates(n), tuple(S(f"s_{i}") for i in range(n))
    phi, b, sigma = drawn_form(draw, n)
    forms = drawn_map(draw, x)
    back: dict[sp.Symbol, sp.Expr] = {}
    for i, form in enumerate(forms):  # s_i = k x_i + earlier
        slope = sp.diff(form, x[i])
        back[x[i]] = ((s[i] - form.xreplace({x[i]: sp.Integer(0)})) / slope).xreplace(back)
    field = [(x[i + 1] if i + 1 < n else 0) + phi[i] + b[i] * sigma * U for i in range(n)]
    field = [sp.sympify(rate).xreplace({Y: x[0]}) for rate in field]
    rates = [
        sp.expand(
            sum(sp.diff(form, state) * rate for state, rate in zip(x, field, strict=True)).xreplace(back)
        )
        for form in forms
    ]
    found = eliminate(s, tuple(rates), s[0])
    gains = [sp.Integer(0)] * (n - len(found.b)) + [value * found.sigma for value in found.b]
    for i in range(n):
        assert sp.simplify(found.form.phi[i] - phi[i]) == 0
        assert sp.simplify(gains[i] - b[i] * sigma) == 0


def test_sigma_is_one_at_zero_where_it_can_be() -> None:
    found = eliminate((theta, omega), (omega, (2 + sp.cos(theta)) * U / J), theta)
    assert found.b == (3 / J,)
    assert sp.simplify(found.sigma - (2 + sp.cos(Y)) / 3) == 0
    magnet = eliminate((q, w), (w, g - K * U / (2 * q**2)), q)
    assert (magnet.b, magnet.sigma) == ((-K / 2,), Y**-2)


def test_functions_are_left_as_they_are_written() -> None:
    """Multiplied out, ``exp(-(theta - 30)**2)`` is 0 in doubles, and ``(theta - 1000)**8`` loses digits."""
    bump = sp.exp(-((theta - 30) ** 2)) + (theta - 1000) ** 8
    found = eliminate((theta, omega), (omega, -B * omega + bump + U), theta)
    assert found.form.phi[1] == bump.xreplace({theta: Y})


def test_the_disturbance_of_the_rates_reaches_the_coordinates_by_the_transformation() -> None:
    states, rates, output = SYSTEMS["pendulum with a lag"]
    d = (S("t"), sp.sign(omega), p * S("t"))
    system = reduce_system(states, rates, output, d, (None,) * 3, "rad")
    forward = [system.start.states[x] for x in coordinates(3)]
    for found, form in zip(system.plant.disturbance, forward, strict=True):
        expected = sum(sp.diff(form, state) * entry for state, entry in zip(states, d, strict=True))
        assert sp.simplify(found - expected) == 0
    assert [str(item.unit) for item in system.reported] == ["rad", "rad/s", "None"]


def test_a_transfer_function_is_the_one_of_its_observer_form() -> None:
    a0, a1, a2, c1, c0, s = (S(name) for name in ("a0", "a1", "a2", "c1", "c0", "s"))
    plant = transfer_plant((c1, c0), (a0, a1, a2), (sp.Integer(0),) * 2)
    A = sp.Matrix([[sp.diff(plant.phi[0], Y), 1], [sp.diff(plant.phi[1], Y), 0]])
    transfer = (sp.Matrix([[1, 0]]) * (s * sp.eye(2) - A).inv() * sp.Matrix(plant.b_vector))[0]
    assert sp.simplify(transfer - (c1 * s + c0) / (a0 * s**2 + a1 * s + a2)) == 0


LAGGED = (U - p) / tau
REFUSED = [
    (
        (omega, -B * omega * p + p, LAGGED),
        theta,
        "system.rates, entry 2",
        "the term -B*omega*p is a product of omega and p",
    ),
    (
        (omega, p - B * omega**2, LAGGED),
        theta,
        "system.rates, entry 2",
        "the term -B*omega**2 is not linear in omega",
    ),
    ((omega, p * theta**2 + p, LAGGED), theta, "system.rates, entry 2", "the term p*theta**2 multiplies p"),
    ((omega, sp.tanh(p), LAGGED), theta, "system.rates, entry 2", "the term tanh(p) is not linear in p"),
    ((omega, p, (U - p * U) / tau), theta, "system.rates, entry 3", "the term -p*u/tau multiplies u by p"),
    ((omega, p, (U**2 - p) / tau), theta, "system.rates, entry 3", "u**2/tau is not linear in the input"),
    ((omega, p, LAGGED), theta + U, "system.output", "u acts on the output at once"),
    ((omega, U, LAGGED), theta, "system.output", "p cannot be told from the output theta"),
    ((omega, p, -p / tau), theta, "system.rates", "u does not reach the output"),
    (
        (omega, p + U * sp.cos(theta), LAGGED),
        theta,
        "system.rates",
        "u acts by way of two functions of the output",
    ),
    (
        (omega, p - omega * sp.exp(-(theta**2)), LAGGED),
        theta,
        "system.rates, entry 2",
        "the term -omega*exp(-theta**2) has no place in the form",
    ),
]


@pytest.mark.parametrize(("rates", "output", "key", "what"), REFUSED, ids=[row[3] for row in REFUSED])
def test_what_has_no_form_is_refused_by_the_term(
    rates: tuple[sp.Expr, ...], output: sp.Expr, key: str, what: str
) -> None:
    with pytest.raises(OutsideClassError) as caught:
        eliminate((theta, omega, p), rates, output)
    assert (caught.value.key, caught.value.what[: len(what)]) == (key, what)
    assert caught.value.remedy
    assert "\n" not in str(caught.value)


def test_the_term_named_is_the_one_that_blocks() -> None:
    """Damping that depends on the angle is no obstacle, though it too is a product with omega."""
    late = LAGGED + omega * p  # a second one, so that leaving one term out is not enough
    rates = (omega, p - B * theta**2 * omega - K * omega * p, late)
    with pytest.raises(OutsideClassError, match=r"the term -K\*omega\*p"):
        eliminate((theta, omega, p), rates, theta)
    assert eliminate((theta, omega, p), (omega, p - B * theta**2 * omega, LAGGED), theta)


@pytest.mark.parametrize(
    ("num", "den", "key"),
    [((1, 2, 3), (1, 1, 1), "num"), ((0, 1), (1, 2, 3), "num"), ((1,), (0, 1), "den")],
)
def test_an_improper_transfer_function_is_refused(
    num: tuple[int, ...], den: tuple[int, ...], key: str
) -> None:
    of = tuple(map(sp.Integer, num)), tuple(map(sp.Integer, den))
    with pytest.raises(OutsideClassError) as caught:
        transfer_plant(*of, (sp.Integer(0),) * (len(den) - 1))
    assert caught.value.key == f"system.transfer_function.{key}"
