"""The polynomials of a step; the C routines through cffi, their Python twins beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial import Chebyshev, Polynomial

from pmjoint_codegen.kernels.compiled import CompiledEvaluator
from pmjoint_codegen.loops import constants, polynomial, quadrature

Find = Callable[[Sequence[float], float], float | None]
EPSILON = np.finfo(float).eps


def c_first_crossing(evaluator: CompiledEvaluator) -> Find:
    def find(q: Sequence[float], h: float) -> float | None:
        root = evaluator.ffi.new("double *")
        q_c = evaluator.ffi.new("double[]", list(q))
        return float(root[0]) if evaluator.lib.pmj_crossings(q_c, len(q) - 1, h, root, 1) else None

    return find


@pytest.fixture(scope="module", params=["C", "Python"])
def first_crossing(request: pytest.FixtureRequest) -> Find:
    if request.param == "Python":
        return polynomial.first_crossing
    return c_first_crossing(request.getfixturevalue("compiled_paper"))


def with_roots(*roots: float, scale: float = 1.0) -> list[float]:
    return [scale * float(c) for c in np.polynomial.polynomial.polyfromroots(roots)]


@pytest.mark.parametrize(
    ("roots", "first"),
    [
        ((0.25,), 0.25),
        ((0.75, 0.5), 0.5),
        ((0.5, 0.5), None),  # a touch
        ((0.5, 0.5, 0.5), 0.5),  # three at once do change the sign
        ((0.25, 0.25, 0.75), 0.75),
        ((-0.5, 1.5), None),
        ((1.0,), None),  # left to the next step
        ((1.0, 1.0), None),
        ((-1.0, -2.0, -3.0), None),
        (tuple(k / 16 for k in range(3, 13)), 3 / 16),
        ((0.5, 0.5, 0.5, 0.5, 0.875), 0.875),
    ],
)
def test_known_roots(first_crossing: Find, roots: tuple[float, ...], first: float | None) -> None:
    for h in (1.0, 2.0, 0.25):  # powers of two scale exactly
        found = first_crossing(with_roots(*(root * h for root in roots)), h)
        if first is None:
            assert found is None
        else:
            q = with_roots(*roots)
            slope = abs(math.prod(first - other for other in roots if other != first))
            noise = 8 * len(q) * EPSILON * sum(map(abs, q)) / slope  # what rounding of q moves the root by
            assert found == pytest.approx(first * h, abs=(1e-4 if roots.count(first) > 1 else noise) * h)


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_two_crossings_close_together_inside_one_step_are_not_missed(
    first_crossing: Find, gap: float
) -> None:
    roots = (0.3, 0.3 + gap)
    found = first_crossing(with_roots(*roots), 1.0)
    # A root of a quadratic moves by the coefficients' rounding over the slope there, which is the gap.
    assert found == pytest.approx(roots[0], abs=8 * EPSILON / gap)


def test_near_touches_are_none(first_crossing: Find) -> None:
    for height in (1e-3, 1e-6, 1e-9, 1e-12):
        q = with_roots(0.3, 0.3)
        q[0] += height
        assert first_crossing(q, 1.0) is None


@pytest.mark.parametrize("power", [1, 2, 5])
def test_vanishing_polynomials_and_constants_have_none(first_crossing: Find, power: int) -> None:
    assert first_crossing([0.0] * power, 1.0) is None
    assert first_crossing([3.0], 1.0) is None
    assert first_crossing([1.0, *[math.inf] * power], 1.0) is None
    assert first_crossing([1.0, *[math.nan] * power], 1.0) is None


@settings(max_examples=300, deadline=None)
@given(
    q=st.lists(st.floats(-10.0, 10.0, allow_subnormal=False), min_size=2, max_size=17),
    h=st.floats(0.01, 1.5),
)
def test_agrees_with_the_eigenvalues_of_the_companion_matrix(
    compiled_paper: CompiledEvaluator, q: list[float], h: float
) -> None:
    q = [coefficient if abs(coefficient) > 1e-6 else 0.0 for coefficient in q]
    assume(q[0] != 0.0)
    found = polynomial.first_crossing(q, h)
    assert c_first_crossing(compiled_paper)(q, h) == found  # the twins agree to the bit
    size = sum(abs(c) * h**k for k, c in enumerate(q))
    noise = 100.0 * len(q) * EPSILON * size

    def value(t: float) -> float:
        return float(np.polynomial.polynomial.polyval(t, q))

    sign = math.copysign(1.0, q[0])
    until = h if found is None else found
    # Up to the crossing, the sign is that of q[0], wherever it can be told from rounding at all.
    for t in np.linspace(0.0, until, 200)[:-1]:
        assert sign * value(float(t)) > -noise
    if found is not None:
        assert 0.0 <= found <= h
        assert abs(value(found)) < noise
        return
    roots = np.roots(q[::-1])
    real = [
        float(root.real) for root in roots if abs(root.imag) < 1e-9 and 1e-6 * h < root.real < (1 - 1e-6) * h
    ]
    for (
        root
    ) in real:  # a root that was passed over is a touch: both sides have one sign, or rounding hides it
        assert sign * value(root * (1 + 1e-5)) > -noise or sign * value(root * (1 - 1e-5)) > -noise


@settings(max_examples=100, deadline=None)
@given(
    roots=st.lists(st.floats(0.02, 0.98), min_size=1, max_size=5),
    outside=st.lists(st.floats(1.2, 5.0), max_size=4),
)
def test_finds_all_of_well_separated_roots_in_order(
    compiled_paper: CompiledEvaluator, roots: list[float], outside: list[float]
) -> None:
    roots.sort()
    assume(all(b - a > 0.02 for a, b in pairwise(roots)))
    q = with_roots(*roots, *outside)
    found = list(polynomial.crossings(q, 1.0))
    ffi, room = compiled_paper.ffi, np.full(len(q), np.nan)
    given, taken = ffi.new("double[]", q), ffi.from_buffer("double[]", room)
    assert compiled_paper.lib.pmj_crossings(given, len(q) - 1, 1.0, taken, len(q)) == len(roots)
    assert room[: len(roots)].tolist() == found
    assert c_first_crossing(compiled_paper)(q, 1.0) == polynomial.first_crossing(q, 1.0) == found[0]
    noise = 8 * len(q) * EPSILON * sum(abs(c) for c in q)
    for root, place in zip(roots, found, strict=True):
        slope = abs(math.prod(root - other for other in [*roots, *outside] if other != root))
        assert abs(place - root) <= 2 * noise / slope + 4 * EPSILON


@pytest.mark.parametrize("turns", range(1, 7))
def test_the_largest_magnitude_inside_a_step_is_found(compiled_paper: CompiledEvaluator, turns: int) -> None:
    """Whatever the slopes at the ends: one that turns twice has the same sign at both."""
    ffi, draw, tau = compiled_paper.ffi, np.random.default_rng(turns), 0.5
    for _ in range(200):
        p = Chebyshev(draw.normal(size=turns + 2), [0.0, tau]).convert(kind=Polynomial)
        ends = np.abs(p(np.array([0.0, tau])))
        roots = p.deriv().roots()
        inside = np.real(
            roots[(np.abs(np.imag(roots)) < 1e-9) & (np.real(roots) > 0) & (np.real(roots) < tau)]
        )
        wanted = max(*ends, *np.abs(p(inside)))
        peaks, times = np.array([[max(ends)] * 2, [0.0] * 2])
        polynomial.note_extremum(p.coef.tolist(), 3.0, tau, 0, peaks, times)
        compiled_paper.lib.pmj_note_extremum(
            ffi.new("double[]", p.coef.tolist()),
            1,
            turns + 1,
            3.0,
            tau,
            ffi.from_buffer("double[]", peaks[1:]),
            ffi.from_buffer("double[]", times[1:]),
        )
        assert (peaks[0], times[0]) == (peaks[1], times[1])
        assert peaks[0] == pytest.approx(wanted, rel=1e-12)
        if wanted > max(ends):
            assert abs(p(times[0] - 3.0)) == pytest.approx(wanted, rel=1e-12)


def test_evaluation_follows_numpy(compiled_paper: CompiledEvaluator) -> None:
    draw = np.random.default_rng(7)
    ffi, lib = compiled_paper.ffi, compiled_paper.lib
    for channels in range(1, 10):
        c = draw.normal(size=(12, channels))
        padded = np.append(c.ravel(), [np.nan] * 3)
        for tau in (0.0, 0.3, -1.2):
            expected = np.polynomial.polynomial.polyval(tau, c)
            np.testing.assert_allclose(polynomial.evaluate(c, tau), expected, rtol=1e-12, atol=1e-12)
            out = np.empty(channels)
            given, taken = ffi.from_buffer("double[]", padded), ffi.from_buffer("double[]", out)
            lib.pmj_evaluate(given, channels, 11, tau, taken, channels)
            np.testing.assert_array_equal(out, polynomial.evaluate(c, tau))
    rows = polynomial.evaluate(c, np.array([[0.1], [0.2]]))
    np.testing.assert_array_equal(rows[1], polynomial.evaluate(c, 0.2))


def test_step_size_is_the_largest_that_keeps_the_last_terms_small(compiled_paper: CompiledEvaluator) -> None:
    ffi, lib = compiled_paper.ffi, compiled_paper.lib
    draw = np.random.default_rng(8)
    c = draw.normal(size=(9, 3)) * 10.0 ** -np.arange(9)[:, np.newaxis]
    h = polynomial.step_size(c, 1e-10, 1.0)
    scale = np.maximum(np.abs(c[0]), 1.0)
    terms = [np.max(np.abs(c[k]) * h**k / scale) for k in (7, 8)]
    assert max(terms) == pytest.approx(1e-10, rel=1e-9)
    assert lib.pmj_step_size(ffi.from_buffer("double[]", c), 3, 8, 1e-10, 0.9) == polynomial.step_size(
        c, 1e-10, 0.9
    )
    assert polynomial.step_size(np.ones((9, 3)) * (np.arange(9) < 7)[:, np.newaxis], 1e-10, 1.0) == math.inf


@pytest.mark.parametrize("rule", [quadrature.long_steps(), quadrature.lane_steps(), quadrature.short_steps()])
def test_quadrature_rules_are_gauss_legendre(rule: quadrature.Rule) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(len(rule.nodes))
    np.testing.assert_allclose(rule.nodes, (1 + nodes) / 2, rtol=0, atol=4 * EPSILON)
    np.testing.assert_allclose(rule.weights, weights / 2, rtol=0, atol=4 * EPSILON)


def test_a_wrong_rule_is_refused() -> None:
    with pytest.raises(ValueError, match="integrates"):
        quadrature.Rule((0.3, 0.7), (0.5, 0.5))


@pytest.mark.parametrize(
    ("q", "zeros"),
    [
        ([1.0, 1.0], 0),
        ([EPSILON, 1.0], 1),
        ([1e-12, 1.0], 0),
        ([0.0, EPSILON, -1.0], 2),
        ([EPSILON, 1e-6, 1.0], 1),
        ([0.0, 0.0], 1),  # the highest counts as none
        ([1.0, math.inf], 0),
        ([math.nan, 1.0], 0),
    ],
)
def test_leading_zeros_are_those_to_rounding(
    compiled_paper: CompiledEvaluator, q: list[float], zeros: int
) -> None:
    given = compiled_paper.ffi.new("double[]", q)
    assert compiled_paper.lib.pmj_leading_zeros(given, len(q) - 1, 1.0) == zeros
    assert polynomial.leading_zeros(q, 1.0) == zeros


def test_the_first_instant_beyond_a_limit_is_found_alike(compiled_paper: CompiledEvaluator) -> None:
    generator, grid = np.random.default_rng(5), np.linspace(0.0, 0.75, 3001)
    ends = []
    for _ in range(300):
        c = generator.normal(size=9) * generator.uniform(0.3, 1.5) ** np.arange(9)
        c[0] *= 0.1
        values = np.abs(Polynomial(c)(grid))
        limit = abs(c[0]) + 0.3 + generator.uniform(0.0, 1.0)
        wanted = polynomial.exceeds(c.tolist(), limit, 0.75)
        tau = compiled_paper.ffi.new("double *", 0.75)
        found = compiled_paper.lib.pmj_exceeds(
            compiled_paper.ffi.from_buffer("double[]", c), 1, 8, limit, tau
        )
        assert (float(tau[0]) if found else None) == wanted
        before = grid if wanted is None else grid[grid < wanted]
        assert np.all(values[: len(before)] <= limit * (1.0 + 1e-9))
        if wanted is not None:
            assert abs(Polynomial(c)(wanted)) == pytest.approx(limit, rel=1e-9)
        ends.append(wanted is not None)
    assert 0.2 < np.mean(ends) < 0.8


@pytest.mark.parametrize("outward", [-1, 1])
def test_a_kink_that_has_let_go_is_left_whatever_rounding_says_of_the_rate(outward: int) -> None:
    """The rate is 0 there, but for rounding; what grows next decides. On a kink that is met, it does."""
    q = [0.0, 1e-13 * outward, -1.0 * outward, 0.0]
    assert polynomial.passes(list(q), 0.0, constants.LET_GO, outward, 0.1) is None
    assert polynomial.passes(list(q), 0.0, constants.ON_KINK, outward, 0.1) == 0.0
    back = [0.0, 1e-13 * outward, -1.0 * outward, 20.0 * outward]  # and returns at 0.05
    assert polynomial.passes(back, 0.0, constants.LET_GO, outward, 0.1) == pytest.approx(0.05)
