"""What a batch reports of a step's polynomial, against the roots that NumPy finds."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from pmjoint_codegen.compile.compiler import find_compiler
from pmjoint_codegen.compile.library import LIBRARY, build
from pmjoint_codegen.kernels.declarations import load_module, to_module
from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.loops import batch
from pmjoint_codegen.loops.metrics import Column

COMPILER = find_compiler(os.environ)
pytestmark = pytest.mark.skipif(COMPILER is None, reason="the batch loops are compiled")

EXTREMUM, NOISE = 1e-10, 1e-12  # of metrics.c: relative error of a peak; rounding relative to sum |a_k|
START, SIZE, SQUARE = 3.0, 0.5, 2.0  # of the steps: s, s, mean of e^2
DEFINED = {"START": START, "SIZE": SIZE, "SQUARE": SQUARE, "ISE": int(Column.ISE)}
DECLARED = """
void note_error(long long n, int degree, const double *a, double *most, const double *band, double *settling,
                double *ise);
void note_control(long long n, int degree, const double *a, double *most);
void may_leave(long long n, int degree, const double *a, const double *low, const double *high, double *may);
void mean_square(long long n, int degree, const double *a, double *square);
"""
# A row of arrays is a polynomial.
SOURCE = """
#include "metrics.h"
#include <string.h>
#define LOAD(to, from, n) \\
    for (int k = 0; k < (n); ++k) \\
        for (int w = 0; w < PMJ_WIDTH; ++w) (to)[k][w] = (from)[(i + w) * (n) + k];
#define STORE(to, from) for (int w = 0; w < PMJ_WIDTH; ++w) (to)[i + w] = (from)[w];

static pmj_mask only(int w)
{
    pmj_mask taken = {0};
    taken[w] = -1;
    return taken;
}

/* Lane w as it is, the others so that they would show in results that they must not touch. */
static void others_larger(const pmj_lanes *lanes, int degree, int w, pmj_lanes *a)
{
    for (int k = 0; k <= degree; ++k) {
        a[k] = pmj_select(only(w), lanes[k], 10.0 * lanes[k] + 1.0);
    }
}

void note_error(long long n, int degree, const double *a, double *most, const double *band, double *settling,
                double *ise)
{
    pmj_lanes lanes[PMJ_ORDER + 1], now[PMJ_ORDER + 1];
    for (long long i = 0; i < n; i += PMJ_WIDTH) {
        pmj_metrics metrics;
        memset(&metrics, 0, sizeof metrics);
        LOAD(lanes, a, degree + 1)
        LOAD(&metrics.max_e, most, 1)
        LOAD(&metrics.band, band, 1)
        LOAD(&metrics.settling, settling, 1)
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            others_larger(lanes, degree, w, now);
            const pmj_span step = {
                only(w), pmj_all(START), pmj_all(SIZE), now, degree, now, degree, pmj_all(SQUARE),
                pmj_all(0.0),
            };
            pmj_note_step(&metrics, &step);
        }
        STORE(most, metrics.max_e)
        STORE(settling, metrics.settling)
        STORE(ise, metrics.sums[ISE])
    }
}

void note_control(long long n, int degree, const double *a, double *most)
{
    pmj_lanes lanes[PMJ_ORDER + 1], now[PMJ_ORDER + 1];
    for (long long i = 0; i < n; i += PMJ_WIDTH) {
        pmj_metrics metrics;
        memset(&metrics, 0, sizeof metrics);
        LOAD(lanes, a, degree + 1)
        LOAD(&metrics.max_v, most, 1)
        for (int w = 0; w < PMJ_WIDTH; ++w) {
            others_larger(lanes, degree, w, now);
            pmj_note_control(&metrics, now, degree, only(w));
        }
        STORE(most, metrics.max_v)
    }
}

void may_leave(long long n, int degree, const double *a, const double *low, const double *high, double *may)
{
    pmj_lanes lanes[PMJ_ORDER + 1], ends[2];
    for (long long i = 0; i < n; i += PMJ_WIDTH) {
        LOAD(lanes, a, degree + 1)
        LOAD(&ends[0], low, 1)
        LOAD(&ends[1], high, 1)
        const pmj_mask all = pmj_all(0.0) == pmj_all(0.0);
        const pmj_mask found = pmj_may_leave(lanes, degree, ends[0], ends[1], all, ~all);
        STORE(may, pmj_select(found, pmj_all(1.0), pmj_all(0.0)))
    }
}

void mean_square(long long n, int degree, const double *a, double *square)
{
    pmj_lanes lanes[PMJ_ORDER + 1];
    for (long long i = 0; i < n; i += PMJ_WIDTH) {
        LOAD(lanes, a, degree + 1)
        STORE(square, pmj_mean_square(lanes, degree))
    }
}
"""


class Metrics:
    """The functions of metrics.c on rows of polynomials."""

    def __init__(self, ffi: Any, lib: Any) -> None:
        self.ffi, self.lib = ffi, lib

    def __call__(self, name: str, a: Array, *columns: Array) -> None:
        pointers = [self.ffi.from_buffer("double[]", np.ascontiguousarray(a))]
        pointers += [self.ffi.from_buffer("double[]", column) for column in columns]
        getattr(self.lib, name)(len(a), a.shape[1] - 1, *pointers)


@pytest.fixture(scope="module", params=[5, 12], ids=["any degree", "the kernels' degree"])
def degree(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def metrics(root: Path, cache: Path) -> Metrics:
    assert COMPILER is not None
    sources = batch.batch_sources(root / "generated" / "paper")
    wanted = (
        "metrics.c",
        "metrics.h",
        "metric_rows.h",
        "polynomial.c",
        "pmjoint_constants.h",
        "pmjoint_runtime.h",
        "lanes.c",
        "lanes.h",
        "pmjoint_lanes.h",
    )
    source = "\n".join([*(f"#define {name} {value}" for name, value in DEFINED.items()), SOURCE])
    files = {name: sources[name] for name in wanted} | {"each.c": source.encode()}
    folder = build(files, COMPILER, cache)
    ffi = load_module(to_module(DECLARED))
    return Metrics(ffi, ffi.dlopen(str(folder / LIBRARY)))


@pytest.fixture(scope="module")
def polynomials(degree: int) -> Array:
    """Coefficients of 4000 polynomials, from nearly straight ones to ones that turn as often as they can."""
    generator = np.random.default_rng(degree)
    rows = []
    for turns in generator.integers(1, 6, 4000):
        weights = generator.normal(size=turns + 1) * 10.0 ** generator.uniform(-2, 0, turns + 1)
        row = np.zeros(degree + 1)
        row[: turns + 1] = Chebyshev(weights, [0, 1]).convert(kind=Polynomial).coef
        row += generator.normal(size=degree + 1) * generator.uniform(0.05, 0.3) ** np.arange(degree + 1)
        rows.append(row)
    return np.array(rows)


def inside(p: Polynomial) -> Array:
    """Real roots in (0, 1), ascending."""
    roots = p.roots()
    real: Array = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
    within: Array = real[(real > 0.0) & (real < 1.0)]
    return np.sort(within)


def largest(a: Array) -> float:
    where = np.array([0.0, *inside(Polynomial(a).deriv()), 1.0])
    return float(np.max(np.abs(Polynomial(a)(where))))


def last_outside(a: Array, band: float) -> float:
    """The last s at which the magnitude exceeds the band; -1 if none does."""
    borders = [inside(Polynomial(a) - band), inside(Polynomial(a) + band)]
    ends = np.array([0.0, *np.sort(np.concatenate(borders)), 1.0])
    out = np.abs(Polynomial(a)(0.5 * (ends[:-1] + ends[1:]))) > band
    return float(ends[1:][out].max(initial=-1.0))


def bounds(polynomials: Array) -> Array:
    bound: Array = NOISE * np.sum(np.abs(polynomials), axis=1)
    return bound


def test_the_largest_error_and_control_are_found_inside_the_step(
    metrics: Metrics, polynomials: Array
) -> None:
    wanted = np.array([largest(a) for a in polynomials])
    before = np.random.default_rng(0).uniform(0, 1.5, len(wanted)) * wanted
    for name, more in (
        ("note_error", [np.full(len(wanted), np.inf), before * 0, before * 0]),
        ("note_control", []),
    ):
        found = before.copy()
        metrics(name, polynomials, found, *more)
        error = np.abs(found - np.maximum(before, wanted))
        assert np.all(error <= bounds(polynomials) + EXTREMUM * wanted)


def test_the_last_instant_outside_the_band_is_found(metrics: Metrics, polynomials: Array) -> None:
    band = np.random.default_rng(1).uniform(0, 1.1, len(polynomials)) * np.array(
        [largest(a) for a in polynomials]
    )
    settling, ise = np.full(len(band), -7.0), np.empty(len(band))
    metrics("note_error", polynomials, np.full(len(band), np.inf), band, settling, ise)
    assert np.all(ise == SIZE * SQUARE)
    seen = set()
    for a, limit, found, bound in zip(polynomials, band, settling, bounds(polynomials), strict=True):
        s = last_outside(a, limit)
        seen.add("never" if s < 0.0 else "at the end" if s == 1.0 else "inside")
        if s < 0.0:
            assert found == -7.0
        else:
            steepness = abs(Polynomial(a).deriv()(s))
            assert found == pytest.approx(START + s * SIZE, abs=SIZE * bound / steepness + NOISE)
    assert seen == {"never", "at the end", "inside"}


def excursions(polynomials: Array) -> Iterator[tuple[float, float]]:
    """The smallest and the largest value on the step."""
    for a in polynomials:
        values = Polynomial(a)(np.array([0.0, *inside(Polynomial(a).deriv()), 1.0]))
        yield float(np.min(values)), float(np.max(values))


def test_no_excursion_is_missed_and_few_are_imagined(metrics: Metrics, polynomials: Array) -> None:
    least, most = np.array(list(excursions(polynomials))).T
    generator, size = np.random.default_rng(2), most - least
    low = least + size * generator.uniform(-2.0, 0.2, len(size))
    high = most - size * generator.uniform(-2.0, 0.2, len(size))
    leaves = np.empty(len(size))
    metrics("may_leave", polynomials, low, high, leaves)
    bound = bounds(polynomials)
    must = (least < low - bound) | (most > high + bound)
    assert np.any(must) and not np.all(must)
    assert np.all(leaves[must] == 1.0)
    far = (least > low + 0.2 * size) & (most < high - 0.2 * size)
    assert np.mean(leaves[far]) < 0.5


def test_the_mean_square_is_exact_up_to_its_degree(metrics: Metrics, degree: int) -> None:
    generator = np.random.default_rng(3)
    rows = np.zeros((64, degree + 1))
    rows[:, :3] = generator.normal(size=(64, 3))  # their squares have degree 4, three nodes are exact up to 5
    found = np.empty(64)
    metrics("mean_square", rows, found)
    wanted = [float((Polynomial(a) ** 2).integ()(1.0)) for a in rows]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)
