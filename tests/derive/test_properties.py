"""Random members of the class: identities behind the certificate hold at random points."""

from __future__ import annotations

import random

import hypothesis.strategies as st
import sympy as sp
from hypothesis import Phase, given, settings

from pmjoint_derive import Derivation, Gains, Model, Parameter, Plant, Simulation, derive, real_symbol
from pmjoint_derive.filters import filter_matrix

S = real_symbol
Y = S("y")
SHAPES = (sp.Integer(0), Y, Y**2, Y**3, sp.sin(Y), sp.cos(Y), sp.tanh(Y), sp.exp(-(Y**2)), Y / (1 + Y**2))
SIGMAS = (sp.Integer(1), 1 + Y**2 / 7, 2 + sp.sin(Y), sp.exp(Y / 3), 1 / (1 + Y**2))
POSITIVE = st.fractions(min_value="1/10", max_value=5, max_denominator=10).map(sp.Rational)


@st.composite
def functions(draw: st.DrawFn) -> sp.Expr:
    """Draw a function of y: a rational multiple of a shape, plus another shape now and then."""
    factor = sp.Rational(draw(st.integers(-9, 9)), draw(st.integers(1, 5)))
    return factor * draw(st.sampled_from(SHAPES)) + draw(st.sampled_from((sp.Integer(0), *SHAPES[:5])))


@st.composite
def models(draw: st.DrawFn) -> Model:
    """Draw a member of the class with n <= 4."""
    n = draw(st.integers(1, 4))
    m = draw(st.integers(0, n - 1))
    p = draw(st.integers(0, 2))
    plant = Plant(
        order=n,
        phi=tuple(draw(functions()) for _ in range(n)),
        Phi=tuple(tuple(draw(functions()) for _ in range(p)) for _ in range(n)),
        theta=(S("d1"), sp.Rational(1, 3))[:p],
        b=(S("b0"), *(draw(POSITIVE) for _ in range(m))),
        sigma=draw(st.sampled_from(SIGMAS)),
        disturbance=tuple(sp.sin(S("t")) / i for i in range(1, n + 1)),
    )
    rho = n - m
    parameters = tuple(Parameter(name, 2.0, "1", "") for name in ("d1", "b0", "u_max"))
    gains = Gains((1.0,) * rho, (1.0,) * rho, (1.0,) * rho, (1.0,) * n)
    run = Simulation((0.0,) * n, 1.0, 0.1, 0.01)
    return Model("random", "", "", parameters, plant, S("u_max"), sp.sin(S("t")), gains, run)


class Loop:
    """A derivation at one exact random point, where u is anything and D too."""

    def __init__(self, derivation: Derivation, seed: int) -> None:
        """Choose the point; every equation is then a number of 60 digits."""
        self.derivation, s = derivation, derivation.signals
        generator = random.Random(seed)

        def some() -> sp.Rational:
            return sp.Rational(generator.randint(-99, 99) or 1, generator.randint(20, 60))

        free = [
            *s.x,
            *s.controller_state,
            *s.y_r,
            *s.c,
            *s.e,
            *s.ck,
            *s.k,
            s.u,
            S("d1"),
            S("b0"),
            s.input_scale,
        ]
        self.values: dict[sp.Symbol, sp.Expr] = {symbol: some() for symbol in free}
        self.values |= {S(f"D{i}"): some() for i in range(1, len(s.x) + 1)}
        self.values |= {symbol: abs(self.values[symbol]) for symbol in (*s.e, S("b0"), s.input_scale)}
        self.values[s.y], self.values[s.compensator] = self.values[s.x[0]], sp.Integer(1)

    def __call__(self, name: str) -> sp.Expr:
        """Evaluate a named equation or a signal."""
        symbol = S(name)
        if symbol not in self.values:
            expression = self.derivation.equations[name].expression
            point = {item: self(item.name) for item in sorted(expression.free_symbols, key=str)}
            self.values[symbol] = sp.N(expression.xreplace(point), 60)
        return self.values[symbol]


def close(actual: sp.Expr, wanted: sp.Expr, scale: sp.Expr) -> bool:
    return bool(abs(sp.N(actual - wanted, 60)) < sp.Float("1e-40", 60) * (1 + abs(scale)))


def direction(loop: Loop, name: str) -> sp.Expr:
    """Differentiate a signal along the true loop: its expansion by states, times their rates."""
    derivation, s = loop.derivation, loop.derivation.signals
    expanded = derivation.expanded(name)
    rates = {state: loop(f"{state.name}_dot") for state in (*s.controller_state,)}
    rates |= {s.y: loop("x1_dot")} | dict(zip(s.y_r, (loop(item.name) for item in s.y_r[1:]), strict=False))
    total = sp.Integer(0)
    for symbol, rate in rates.items():
        partial = sp.diff(expanded, symbol)
        point = {item: loop(item.name) for item in partial.free_symbols}
        total += sp.N(partial.xreplace(point), 60) * rate
    return total


@settings(
    max_examples=8, phases=(Phase.explicit, Phase.reuse, Phase.generate)
)  # shrinking derives for minutes
@given(models(), st.integers(0, 10**6))
def test_certificate_of_random_members(model: Model, seed: int) -> None:
    """Check x = x_hat + eps; eps' = A0 eps + D; half the sum of z squared falls as (31) and (32) say."""
    derivation = derive(model)
    loop, s, plant = Loop(derivation, seed), derivation.signals, derivation.plant
    n, rho = plant.order, plant.rho
    eps = sp.Matrix([loop(item.name) for item in s.epsilon])
    D = sp.Matrix([loop(f"D{i}") for i in range(1, n + 1)])
    for i in range(n):
        assert close(loop(f"x{i + 1}"), loop(f"x_hat{i + 1}") + eps[i], eps[i])
    A0 = filter_matrix(s).xreplace({item: loop(item.name) for item in s.k})
    eps_dot = sp.Matrix([loop(f"x{i}_dot") - direction(loop, f"x_hat{i}") for i in range(1, n + 1)])
    for found, wanted in zip(eps_dot, A0 * eps + D, strict=True):
        assert close(found, wanted, max(abs(entry) for entry in (*eps_dot, *D)))

    z = [loop(item.name) for item in s.z]
    sensitivity = [sp.Integer(-1)]
    for alpha in s.alpha:
        name = f"d{alpha.name}_dy"
        sensitivity.append(loop(name) if name in derivation.equations else sp.Integer(0))
    # of the input kappa u: from step 2 on, z and s are kappa times the law's, which the squares are of
    kappa = [sp.Integer(1), *(loop(s.input_scale.name),) * (rho - 1)]
    z, sensitivity = ([w * item for w, item in zip(kappa, row, strict=True)] for row in (z, sensitivity))
    c, e = ([loop(item.name) for item in group] for group in (s.c, s.e))
    eps_2 = eps[1] if n > 1 else sp.Integer(0)
    # D1 enters y' beside eps_2 where it is not zero: the certificate's plant has none there
    entering = eps_2 + D[0]
    found = sum(kappa[i] * z[i] * direction(loop, s.z[i].name) for i in range(rho))
    wanted = sum(
        -c[i] * z[i] ** 2 - e[i] * sensitivity[i] ** 2 * z[i] ** 2 - sensitivity[i] * z[i] * entering
        for i in range(rho)
    )
    terms = [z[i] ** 2 * (abs(c[i]) + e[i] * sensitivity[i] ** 2) for i in range(rho)]
    assert close(found, wanted, sum(terms))

    # the squares of (32), with the cross term as above: an identity in z, eps and D
    weights = [1 / (2 * item) for item in e]
    squares = sum(
        e[i] * (sensitivity[i] * z[i] + weights[i] * entering) ** 2 - weights[i] / 2 * entering**2
        for i in range(rho)
    )
    rest = -sum(c[i] * z[i] ** 2 for i in range(rho)) - squares
    assert close(found, rest, sum(terms) + sum(weights) * entering**2)
