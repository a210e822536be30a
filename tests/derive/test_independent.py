"""The law of (24) to (29) in numbers alone: each alpha_i a function, differentiated by central differences.

Nothing of the symbolic derivation is used on this side: filters, compensator, errors and virtual controls are
typed once more, and the total derivative of alpha_{i-1} along the loop is the difference quotient of its
values at two points of the flow. The steps of 1e-30 at 200 digits leave an error of about 1e-60 in each.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import mpmath
import pytest
import sympy as sp

from pmjoint_derive import Derivation, Model, derive, real_symbol

S = real_symbol
DIGITS, STEP = 200, "1e-30"
Vector = list[mpmath.mpf]


@dataclass(frozen=True)
class Point:
    """Where the loop stands: y, filters, compensator, the reference and its derivatives."""

    y: Vector
    xi: Vector
    Xi1: Vector  # first column
    Xi2: Vector
    lam: Vector
    r: Vector
    y_r: Vector

    def moved(self, along: Point, h: mpmath.mpf) -> Point:
        """Return the point a step further along a direction."""
        names = [item.name for item in fields(self)]
        pairs = {name: zip(getattr(self, name), getattr(along, name), strict=True) for name in names}
        return Point(**{name: [a + h * b for a, b in entries] for name, entries in pairs.items()})


@dataclass(frozen=True)
class Numbers:
    """A design of the test's model (builder of conftest.py) with n = rho, in numbers."""

    n: int
    c: Vector
    e: Vector
    ck: Vector
    k: Vector
    d1: mpmath.mpf
    b: mpmath.mpf
    scale: mpmath.mpf

    def phi(self, y: mpmath.mpf) -> Vector:
        return [-(y**3) / 5, mpmath.sin(y), y**2 / 7, mpmath.cos(y)][: self.n]

    def sigma(self, y: mpmath.mpf) -> mpmath.mpf:
        return 1 + y**2 / 10

    def filter(self, s: Vector, drive: Vector) -> Vector:
        """A0 s + drive."""
        return [(s[i + 1] if i + 1 < self.n else 0) - self.k[i] * s[0] + drive[i] for i in range(self.n)]

    def omega(self, at: Point) -> mpmath.mpf:
        """What is known of y' besides b v_{0,2}."""
        y = at.y[0]
        second = at.xi[1] + at.Xi1[1] * self.d1 + at.Xi2[1] / 3
        return self.phi(y)[0] + y**2 / 3 + second + (0 if self.n > 1 else self.d1 * y)

    def flow(self, at: Point) -> Point:
        """Rates with epsilon = 0, u = 0 and du = 0: neither enters alpha_i for i < rho."""
        y, n, zero = at.y[0], self.n, mpmath.mpf(0)
        k_y = [k * y + f for k, f in zip(self.k, self.phi(y), strict=True)]
        r = [(at.r[i + 1] if i + 1 < n else zero) - self.ck[i] * at.r[i] for i in range(n)]
        return Point(
            y=[self.b * at.lam[1] + self.omega(at)],
            xi=self.filter(at.xi, k_y),
            Xi1=self.filter(at.Xi1, [zero] * (n - 1) + [y]),
            Xi2=self.filter(at.Xi2, [y**2] + [zero] * (n - 1)),
            lam=self.filter(at.lam, [zero] * n),
            r=r,
            y_r=[*at.y_r[1:], zero],
        )

    def z(self, i: int, at: Point) -> mpmath.mpf:
        """Return the error z_i (24)."""
        if i == 1:
            return at.y[0] - at.y_r[0] - at.r[0]
        return at.lam[i - 1] - self.alpha(i - 1, at) - at.y_r[i - 1] / self.b - at.r[i - 1] / self.b

    def alpha(self, i: int, at: Point) -> mpmath.mpf:
        """Return alpha_i; for i = rho, ``sigma v - y_r^(rho)/b``, which the same formula gives."""
        z_i = self.z(i, at)
        damping = -self.c[i - 1] * z_i
        if i == 1:
            return (damping - self.e[0] * z_i - self.omega(at) - self.ck[0] * at.r[0]) / self.b
        h, flow = mpmath.mpf(STEP), self.flow(at)
        along = self.slope(i - 1, at, flow, h)
        still = Point(**{item.name: [mpmath.mpf(0)] * len(getattr(at, item.name)) for item in fields(at)})
        by_y = self.slope(i - 1, at, replace(still, y=[mpmath.mpf(1)]), h)
        g = self.b / self.scale**2 * self.z(1, at) if i == 2 else self.z(i - 1, at)
        nonlinear = -self.e[i - 1] * (self.scale * by_y) ** 2 * z_i
        return (
            damping
            + nonlinear
            - g
            + self.k[i - 1] * at.lam[0]
            - self.ck[i - 1] * at.r[i - 1] / self.b
            + along
        )

    def slope(self, i: int, at: Point, direction: Point, h: mpmath.mpf) -> mpmath.mpf:
        """Derivative of alpha_i in a direction."""
        ahead, behind = at.moved(direction, h), at.moved(direction, -h)
        return (self.alpha(i, ahead) - self.alpha(i, behind)) / (2 * h)

    def v(self, at: Point) -> mpmath.mpf:
        """Return the law (29)."""
        return (self.alpha(self.n, at) + at.y_r[self.n] / self.b) / self.sigma(at.y[0])


def derived(derivation: Derivation, name: str, values: dict[sp.Symbol, mpmath.mpf]) -> mpmath.mpf:
    """Evaluate a named equation of the derivation, and what it speaks of, at a point."""
    symbol = S(name)
    if symbol not in values:
        expression = derivation.equations[name].expression
        needed = sorted(expression.free_symbols, key=str)
        arguments = [derived(derivation, item.name, values) for item in needed]
        values[symbol] = sp.lambdify(needed, expression, "mpmath")(*arguments)
    return values[symbol]


@pytest.mark.parametrize("n", [2, 3, 4])
def test_numeric_differentiation_gives_the_same_law(n: int, builder: Callable[..., Model]) -> None:
    derivation = derive(builder(n, n))
    generator = random.Random(n)

    def some(count: int) -> Vector:
        return [mpmath.mpf(generator.randint(20, 150)) / 100 for _ in range(count)]

    with mpmath.workdps(DIGITS):
        design = Numbers(n, some(n), some(n), some(n), some(n), some(1)[0], some(1)[0], some(1)[0])
        at = Point(some(1), some(n), some(n), some(n), some(n), some(n), some(n + 1))
        s = derivation.signals
        columns = [[row[j] for row in s.Xi] for j in range(2)]
        symbols = [s.y, *s.xi, *columns[0], *columns[1], *s.lambda_, *s.r, *s.y_r]
        numbers = [*at.y, *at.xi, *at.Xi1, *at.Xi2, *at.lam, *at.r, *at.y_r]
        gains = [*s.c, *s.e, *s.ck, *s.k, S("d1"), S("b0"), S("input_scale")]
        chosen = [*design.c, *design.e, *design.ck, *design.k, design.d1, design.b, design.scale]
        values = dict(zip((*symbols, *gains), (*numbers, *chosen), strict=True))
        for i in range(1, n):
            expected = design.alpha(i, at)
            assert abs(derived(derivation, f"alpha{i}", values) - expected) < mpmath.mpf("1e-45") * (
                1 + abs(expected)
            )
        expected = design.v(at)
        assert abs(derived(derivation, "v", values) - expected) < mpmath.mpf("1e-45") * (1 + abs(expected))
