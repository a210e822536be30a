"""What a step is made of: the C routines through cffi, their Python twins beside them, to the bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial as reference

from pmjoint_codegen.kernels.compiled import CompiledEvaluator
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops import steps
from pmjoint_codegen.loops.constants import PADDING

EPSILON = np.finfo(float).eps


class Routines:
    """The C routines, with arrays for pointers."""

    def __init__(self, evaluator: CompiledEvaluator) -> None:
        self._ffi, self._lib = evaluator.ffi, evaluator.lib

    def pointer(self, array: Array) -> Any:
        return self._ffi.from_buffer("double[]", array)

    def arrive(self, c: Array, tau: float) -> tuple[Array, Array]:
        order, width = len(c) - 1, c.shape[1]
        values, slopes = np.empty(width + PADDING), np.empty(width + PADDING)
        self._lib.pmj_arrive(
            self.pointer(padded(c)), width, order, tau, self.pointer(values), self.pointer(slopes)
        )
        return values[:width], slopes[:width]

    def bounds(self, c: Array, tau: float, first: int) -> Array:
        order, width = len(c) - 1, c.shape[1]
        result = np.full(width + PADDING, np.nan)
        self._lib.pmj_bounds(self.pointer(padded(c)), width, order, tau, first, self.pointer(result))
        return result[first:width]

    def values(self, c: Array, tau: float, n: int) -> Array:
        result = np.empty(n)
        self._lib.pmj_values(self.pointer(padded(c)), c.shape[1], len(c) - 1, tau, self.pointer(result), n)
        return result

    def channel(self, c: Array, tau: Array) -> Array:
        result = np.empty(len(tau))
        self._lib.pmj_channel(
            self.pointer(padded(c)),
            c.shape[1],
            len(c) - 1,
            self.pointer(tau),
            self.pointer(result),
            len(tau),
        )
        return result

    def scales(self, c: Array) -> Array:
        result = np.full(c.shape[1] + PADDING, np.nan)
        self._lib.pmj_scales(self.pointer(padded(c)), c.shape[1], self.pointer(result))
        return result[: c.shape[1]]

    def allowed_step(self, c: Array, tolerance: float, safety: float) -> float:
        scales = np.zeros(c.shape[1] + PADDING)
        scales[: c.shape[1]] = self.scales(c)
        arguments = (self.pointer(padded(c)), self.pointer(scales), c.shape[1], len(c) - 1)
        return float(self._lib.pmj_allowed_step(*arguments, tolerance, safety))


def padded(c: Array) -> Array:
    """Coefficients with what a block may read behind them: nothing must depend on it."""
    return np.append(c.ravel(), [np.nan] * PADDING)


@pytest.fixture(scope="module")
def routines(compiled_paper: CompiledEvaluator) -> Routines:
    return Routines(compiled_paper)


@pytest.mark.parametrize("order", [2, 7, 8, 16])
@pytest.mark.parametrize("channels", range(1, 10))
def test_a_step_arrives_where_its_polynomial_does(routines: Routines, order: int, channels: int) -> None:
    c = np.random.default_rng(order).normal(size=(order + 1, channels))
    for tau in (0.0, 0.3, 1.2):
        values, slopes = steps.arrive(c, tau)
        allowed = 4 * order**2 * EPSILON * reference.polyval(tau, np.abs(c))
        assert np.all(np.abs(values - reference.polyval(tau, c)) <= allowed)
        allowed = 4 * order**2 * EPSILON * reference.polyval(tau, reference.polyder(np.abs(c)))
        assert np.all(np.abs(slopes - reference.polyval(tau, reference.polyder(c))) <= allowed)
        for mine, theirs in zip(routines.arrive(c, tau), (values, slopes), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        np.testing.assert_array_equal(steps.values(c, tau), values)
        np.testing.assert_array_equal(routines.values(c, tau, channels), values)
        np.testing.assert_array_equal(routines.bounds(c, tau, 0), steps.bounds(c, tau))
        np.testing.assert_array_equal(
            routines.bounds(c, tau, channels - 1), steps.bounds(c, tau)[channels - 1 :]
        )


@pytest.mark.parametrize("count", [1, 3, 4, 10])
def test_one_channel_at_many_instants_is_the_same_as_at_each(routines: Routines, count: int) -> None:
    draw = np.random.default_rng(3)
    c, tau = draw.normal(size=(17, 5)), draw.uniform(0.0, 1.0, count)
    found = routines.channel(c, tau)
    np.testing.assert_array_equal(found, steps.values(c[:, :1], tau[:, np.newaxis])[:, 0])
    np.testing.assert_array_equal(found, [steps.arrive(c, float(t))[0][0] for t in tau])


def test_nothing_on_the_way_exceeds_the_bounds() -> None:
    c = np.random.default_rng(5).normal(size=(17, 4))
    bounds = steps.bounds(c, 0.9) * (1 + 1e-12)
    for tau in np.linspace(0.0, 0.9, 50):
        assert np.all(np.abs(steps.values(c, float(tau))) <= bounds)


@settings(max_examples=300, deadline=None)
@given(exponents=st.lists(st.floats(-300.0, 300.0), min_size=1, max_size=9))
def test_scales_are_powers_of_two_within_a_factor_of_two(
    compiled_paper: CompiledEvaluator, exponents: list[float]
) -> None:
    c = np.tile(-(10.0 ** np.array(exponents)), (3, 1))
    found = steps.scales(c)
    np.testing.assert_array_equal(Routines(compiled_paper).scales(c), found)
    assert np.all(np.frexp(found)[0] == 0.5)
    product = found * np.maximum(np.abs(c[0]), 1.0)
    assert np.all((product >= 1.0) & (product < 2.0))


@settings(max_examples=300, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    tolerance=st.floats(-14.0, -3.0).map(lambda exponent: 10.0**exponent),
    size=st.floats(-30.0, 30.0).map(lambda exponent: 10.0**exponent),
    order=st.sampled_from([8, 15, 16]),
)
def test_the_step_keeps_the_last_terms_small(
    compiled_paper: CompiledEvaluator, seed: int, tolerance: float, size: float, order: int
) -> None:
    c = size * np.random.default_rng(seed).normal(size=(order + 1, 5))
    relative = steps.scales(c)
    h = steps.allowed_step(c, relative, tolerance, 1.0)
    assert Routines(compiled_paper).allowed_step(c, tolerance, 1.0) == h
    terms = [float(np.max(np.abs(c[k]) * relative)) * h**k for k in (order - 1, order)]
    # log2 of norm and tolerance to 0.01 each, 2^x to 0.1 %: within 2^0.02 1.001^k of the tolerance
    slack = 2**0.02 * 1.001**order
    assert tolerance / slack <= max(terms) <= tolerance * slack


@pytest.mark.parametrize(("value", "least", "most"), [(0.0, 1e10, math.inf), (math.inf, 0.0, 1e-10)])
def test_the_step_without_last_terms_is_long_and_with_infinite_ones_short(
    routines: Routines, value: float, least: float, most: float
) -> None:
    c = np.ones((17, 3))
    c[15:] = value
    h = steps.allowed_step(c, steps.scales(c), 1e-10, 1.0)
    assert least < h < most
    assert routines.allowed_step(c, 1e-10, 1.0) == h
