"""The certificate (19)-(35): V decreases up to the disturbance, as identities that expand to exactly zero.

Nothing here depends on how the law was found. The errors z_i are expressions of what the controller
measures. They are differentiated along the *true* dynamics (y' of the plant (11), filters (14), compensator
(23), any input u), and checked against (27), (28). With ``s_1 = -1`` and ``s_i = d alpha_{i-1} / dy``, and
with ``eta = epsilon_2 + D_1``, the unknown part of y':

    z_i'  =  -(c_i + e_i s_i^2) z_i - s_i eta + couplings that cancel in the sum                    (27), (28)
    d/dt sum z_i^2/2  =  -sum c_i z_i^2 - sum e_i s_i^2 z_i^2 - (sum s_i z_i) eta                   (31)
    V'  =  -sum c_i z_i^2 - sum |epsilon|^2/(4 e_i) + sum |P D|^2/(2 e_i) - {squares},              (32)
    V   =  sum z_i^2/2 + sum epsilon' P epsilon/(2 e_i),      P A0 + A0' P = -2 I                   (19), (30)

These are for the paper's input. With an input scale kappa, V weighs the squares of z_2 ... z_rho by ``w_i =
kappa^2`` (`pmjoint_derive.signals.Signals.weights`): w_i z_i^2 stands for z_i^2, w_i e_i s_i^2 for e_i s_i^2
in (28), and w_i s_i z_i for s_i z_i.

The braces hold ``sum e_i (s_i z_i + eta/(2 e_i))^2 + sum |epsilon - P D|^2/(2 e_i) + sum_i sum_{j != 2}
epsilon_j^2/(4 e_i)``: squares only, so (32) is an inequality for every model whose identities hold. They hold
for any saturation, with the compensator (23) at work.

That is for the paper's ``D_1 = 0`` (13). A model that disturbs y' itself has ``sum (2 |P D|^2 + D_1^2)/(2
e_i)`` in place of ``sum |P D|^2/(2 e_i)``, and other squares (`squares`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import chain

import sympy as sp

from pmjoint_derive.closed_loop import (
    disturbance_symbols,
    output_disturbance,
    plant_rates,
    unknown_output_rate,
)
from pmjoint_derive.design import Derivation
from pmjoint_derive.equation import Identity, real_symbol
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.lyapunov_matrix import lyapunov_matrix, lyapunov_residual, symmetric_matrix
from pmjoint_derive.signals import Signals, derivative_name, partial_name
from pmjoint_derive.vanishing import expand_to_zero

Vanishing = Callable[[sp.Expr, sp.Expr], sp.Expr]  # an expression and sigma -> 0, or a remainder
NOTHING: frozenset[sp.Symbol] = frozenset()


def unfold(derivation: Derivation, name: str, keep: frozenset[sp.Symbol] = NOTHING) -> sp.Expr:
    """An equation's right-hand side in signals, parameters and the plant's named constants.

    Args:
        derivation: the design.
        name: of the equation.
        keep: further names to leave as they are.
    """
    return derivation.equations.expand(derivation.equations[name].expression, primitive(derivation) | keep)


def primitive(derivation: Derivation) -> frozenset[sp.Symbol]:
    """Symbols that stay: what is measured or applied, and the constants that the plant is written in."""
    s, plant, certified = derivation.signals, derivation.plant, derivation.design.certified
    entries = (
        *plant.phi,
        *(entry for row in plant.Phi for entry in row),
        *(*plant.theta, *certified.theta),
        *(*plant.b, *certified.b),
        plant.sigma,
    )
    return frozenset({s.y, s.u, *s.y_r, *s.estimates}).union(*(entry.free_symbols for entry in entries))


def sensitivities(derivation: Derivation) -> tuple[sp.Expr, ...]:
    """``s_1 = -1`` and ``s_i = d alpha_{i-1} / dy`` by name; `partial_identities` proves the names."""
    s = derivation.signals
    return (sp.Integer(-1), *(_partial(derivation, alpha, s.y) for alpha in s.alpha))


def _partial(derivation: Derivation, alpha: sp.Symbol, by: sp.Symbol) -> sp.Expr:
    """The name of a partial derivative, or 0 where none is named."""
    name = partial_name(alpha, by)
    return real_symbol(name) if name in derivation.equations else sp.Integer(0)


def true_rates(derivation: Derivation, keep: frozenset[sp.Symbol] = NOTHING) -> dict[sp.Symbol, sp.Expr]:
    """Rates of all that a virtual control may depend on, along the plant (11) with any u and ``du = u - v``.

    The plant is restated from its class; filters, compensator and estimates are the derivation's own
    equations, which the kernels are made from. The unmeasured x_2 is written as the estimate by the true
    values and epsilon_2; a disturbance of y' stays a symbol.

    Args:
        derivation: the design.
        keep: names of the design to leave as they are.
    """
    s, plant = derivation.signals, derivation.design.certified
    y_dot = plant.drift[0]
    if plant.order > 1:
        y_dot += s.x[1] - unfold(derivation, s.epsilon[1].name)
    y_dot += unknown_output_rate(derivation.design)
    if plant.rho == 1:
        y_dot += plant.b[0] * plant.sigma * s.u
    rates = {s.y: y_dot}
    for state in s.had:
        name = real_symbol(derivative_name(state))
        rate = name if name in keep else unfold(derivation, name.name, keep | {s.v})
        rates[state] = rate.xreplace({s.compensator: sp.Integer(1)})
    return rates | dict(zip(s.y_r, s.y_r[1:], strict=False))


def rate_along(expression: sp.Expr, rates: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    """Total time derivative of an expression, given the rates of what it depends on."""
    terms = (
        sp.diff(expression, symbol) * rate
        for symbol, rate in rates.items()
        if symbol in expression.free_symbols
    )
    return sum(terms, sp.Integer(0))


def virtual_control_rates(
    derivation: Derivation, rates: Mapping[sp.Symbol, sp.Expr]
) -> dict[sp.Symbol, sp.Expr]:
    """``alpha_i'`` by the chain rule, with the partial derivatives by name."""
    return {
        alpha: sum((_partial(derivation, alpha, by) * rate for by, rate in rates.items()), sp.Integer(0))
        for alpha in derivation.signals.alpha
    }


def claimed_rates(derivation: Derivation, s_: tuple[sp.Expr, ...]) -> tuple[sp.Expr, ...]:
    """``z_i'`` as the derivation claims it (27), (28), in symbols z_i.

    Args:
        derivation: the design.
        s_: the sensitivities, as expressions or symbols.
    """
    s, equations = derivation.signals, derivation.equations
    names = (real_symbol(partial_name(alpha, s.y)) for alpha in s.alpha)
    given = dict(zip(names, s_[1:], strict=True))
    return tuple(equations[derivative_name(z)].expression.xreplace(given) for z in s.z)


def estimation_identities(derivation: Derivation) -> list[Identity]:
    """``epsilon' = A0 epsilon + D`` for ``epsilon = x - x_hat`` along plant and filters, for any u (17)."""
    s, plant = derivation.signals, derivation.design.certified
    D = sp.Matrix(disturbance_symbols(plant))
    errors = sp.Matrix([unfold(derivation, epsilon.name) for epsilon in s.epsilon])
    rates = plant_rates(plant, s) | {
        state: unfold(derivation, derivative_name(state)) for state in (*s.xi, *chain(*s.Xi), *s.lambda_)
    }
    rates = {symbol: rate.xreplace({s.y: s.x[0]}) for symbol, rate in rates.items()}
    rest = sp.Matrix([rate_along(entry, rates) for entry in errors]) - filter_matrix(s) * errors - D
    sigma = plant.sigma.xreplace({s.y: s.x[0]})
    return [
        Identity(f"epsilon_{i}", f"epsilon_{i}' = (A0 epsilon + D)_{i}", expand_to_zero(entry, sigma))
        for i, entry in enumerate(rest, start=1)
    ]


def partial_identities(
    derivation: Derivation, keep: frozenset[sp.Symbol] = NOTHING, vanishing: Vanishing = expand_to_zero
) -> list[Identity]:
    """Every named partial derivative is its virtual control's; every one that is not named is zero.

    By induction over the names: a virtual control is written in errors, in earlier virtual controls and in
    their partial derivatives, and the whole is differentiated through all of them. What helps the
    derivation, such as second derivatives, is unfolded first. Written in signals alone, an identity of order
    four would take minutes.

    Args:
        derivation: the design.
        keep: further names that a virtual control is written in.
        vanishing: decides whether an expression is zero.
    """
    s = derivation.signals
    slopes = _Slopes(derivation, keep)
    identities = []
    for alpha in s.alpha:
        for by in s.measurable:
            name = partial_name(alpha, by)
            named = slopes.unfolded(name) if name in derivation.equations else sp.Integer(0)
            rest = vanishing(named - slopes.through(alpha, by), sp.Integer(1))
            identities.append(Identity(name, f"{name} is the derivative of {alpha} by {by}", rest))
    return identities


class _Slopes:
    """Derivatives of named equations by signals, through every name that an equation uses."""

    def __init__(self, derivation: Derivation, keep: frozenset[sp.Symbol]) -> None:
        s = derivation.signals
        firsts = (real_symbol(partial_name(alpha, by)) for alpha in s.alpha for by in s.measurable)
        self._derivation = derivation
        self._fixed = primitive(derivation)
        self._kept = self._fixed | {*s.z, *s.alpha, *firsts} | keep
        self._known: dict[tuple[sp.Symbol, sp.Symbol], sp.Expr] = {}

    def unfolded(self, name: str) -> sp.Expr:
        """An equation in errors, virtual controls, their partial derivatives and signals."""
        equations = self._derivation.equations
        return equations.expand(equations[name].expression, self._kept)

    def through(self, of: sp.Symbol, by: sp.Symbol) -> sp.Expr:
        """``d of / d by``, with the partial derivatives of earlier virtual controls by name."""
        if (of, by) not in self._known:
            self._known[of, by] = self._through(self.unfolded(str(of.name)), by)
        return self._known[of, by]

    def _through(self, expression: sp.Expr, by: sp.Symbol) -> sp.Expr:
        total = sp.diff(expression, by)
        for symbol in sorted(expression.free_symbols, key=str):
            if symbol != by and symbol.name in self._derivation.equations:
                total += sp.diff(expression, symbol) * self._slope(symbol, by)
        return total

    def _slope(self, of: sp.Symbol, by: sp.Symbol) -> sp.Expr:
        if of in self._fixed:
            return sp.Integer(0)
        return (
            _partial(self._derivation, of, by)
            if of in self._derivation.signals.alpha
            else self.through(of, by)
        )


def error_identities(
    derivation: Derivation, keep: frozenset[sp.Symbol] = NOTHING, vanishing: Vanishing = expand_to_zero
) -> list[Identity]:
    """``z_i'`` along the true dynamics equals what (27), (28) claim, for any u.

    Errors and partial derivatives stay names as long as they may: their definitions are unfolded where they
    are differentiated, and the partial derivatives are proved apart. So the expressions stay small for any
    order.

    Args:
        derivation: the design.
        keep: further names that stay: of what moves the estimates.
        vanishing: decides whether an expression is zero.
    """
    s = derivation.signals
    names = frozenset(real_symbol(partial_name(alpha, by)) for alpha in s.alpha for by in s.measurable)
    keep = primitive(derivation) | names | keep
    rates = true_rates(derivation, keep | {*s.z, *s.alpha})
    rates |= virtual_control_rates(derivation, rates)
    claims = claimed_rates(derivation, sensitivities(derivation))
    identities = []
    for i, (z, claim) in enumerate(zip(s.z, claims, strict=True), start=1):
        along = rate_along(unfold(derivation, z.name, keep | {*s.alpha}), rates)
        rest = derivation.equations.expand(along - claim, keep | {*s.z[:i], *s.alpha[: i - 1]})
        claimed = f"z{i}' along the true dynamics is what {'(27)' if i == 1 else '(28)'} claims, for any u"
        identities.append(Identity(f"z{i}'", claimed, vanishing(rest, derivation.plant.sigma)))
    return identities


def energy_identity(derivation: Derivation) -> Identity:
    """(31): the couplings cancel in ``d/dt sum z_i^2 / 2``, with z_i' as established above."""
    s = derivation.signals
    s_ = (sp.Integer(-1), *(real_symbol(f"s({i})") for i in range(2, derivation.plant.rho + 1)))
    rate = error_energy_rate(derivation, s_)
    claim = sum(
        (
            -w * (c + w * e * s_i**2) * z**2 - w * s_i * z * unknown_output_rate(derivation.design)
            for w, c, e, z, s_i in zip(s.weights, s.c, s.e, s.z, s_, strict=True)
        ),
        sp.Integer(0),
    )
    return Identity(
        "energy",
        "d/dt sum w z^2/2 = -sum c w z^2 - sum e (w s z)^2 - (sum w s z) eta, w = 1, kappa^2, kappa^2, ...",
        sp.expand(rate - claim),
    )


def error_energy_rate(derivation: Derivation, s_: tuple[sp.Expr, ...]) -> sp.Expr:
    """``d/dt sum w_i z_i^2/2`` with the claimed z_i'.

    Args:
        derivation: the design.
        s_: the sensitivities.
    """
    s = derivation.signals
    terms = zip(s.weights, s.z, claimed_rates(derivation, s_), strict=True)
    return sum((weight * z * rate for weight, z, rate in terms), sp.Integer(0))


def squares(derivation: Derivation, PD: sp.MatrixBase, s_: tuple[sp.Expr, ...]) -> tuple[sp.Expr, ...]:
    """What the certificate gives away: terms that are squares with positive factors, the braces of (32).

    With a disturbance of y', Young's inequality takes ``eta^2 <= 2 epsilon_2^2 + 2 D_1^2``, and what it gives
    away, ``(epsilon_2 - D_1)^2``, is one of the squares.

    Args:
        derivation: the design.
        PD: ``P D``, n x 1.
        s_: the sensitivities.
    """
    s, eta = derivation.signals, unknown_output_rate(derivation.design)
    D_1 = output_disturbance(derivation.design)
    weight, share = (1, sp.Rational(1, 2)) if D_1 == 0 else (2, sp.Rational(1, 4))
    terms = zip(s.weights, s.e, s_, s.z, strict=True)
    young = [e * (w * s_i * z + eta / (2 * e)) ** 2 for w, e, s_i, z in terms]
    inputs = [share * entry**2 / e for e in s.e for entry in sp.Matrix(s.epsilon) - weight * PD]
    others = [weight * x**2 / (4 * e) for e in s.e for i, x in enumerate(s.epsilon, start=1) if i != 2]
    apart = [] if D_1 == 0 else [(eta - 2 * D_1) ** 2 / (4 * e) for e in s.e]
    return (*young, *inputs, *others, *apart)


def given_away(derivation: Derivation) -> tuple[sp.Expr, ...]:
    """`squares` in the names of the derivation and in ``PD1``, ``PD2``, ... for the entries of P D."""
    return squares(derivation, projected_symbols(derivation.plant.order), sensitivities(derivation))


def projected_symbols(n: int) -> sp.ImmutableMatrix:
    """``P D`` as symbols ``PD1``, ``PD2``, ..., n x 1."""
    return sp.ImmutableMatrix([real_symbol(f"PD{i}") for i in range(1, n + 1)])


def error_function(s: Signals, P: sp.MatrixBase) -> sp.Expr:
    """``V_epsilon = epsilon' P epsilon`` (19), expanded."""
    epsilon = sp.Matrix(s.epsilon)
    return sp.expand((epsilon.T * P * epsilon)[0])


def lyapunov_function(s: Signals, V_epsilon: sp.Expr, steps: int | None = None) -> sp.Expr:
    """``V = sum w_i z_i^2/2 + sum V_epsilon/(2 e_i)`` (30), over the first steps or over all."""
    of_errors = (w * z**2 / 2 for w, z in zip(s.weights[:steps], s.z[:steps], strict=True))
    return sum(of_errors, sp.Integer(0)) + error_weight(s, steps) * V_epsilon


def error_weight(s: Signals, steps: int | None = None) -> sp.Expr:
    """``sum 1/(2 e_i)``, the weight of ``epsilon' P epsilon`` in V (30), over the first steps or over all."""
    return sum((1 / (2 * e) for e in s.e[:steps]), sp.Integer(0))


def certified_rate(derivation: Derivation, PD: sp.MatrixBase) -> sp.Expr:
    """The right-hand side of (32): what V' is at most, and is but for the squares.

    Args:
        derivation: the design.
        PD: ``P D``, n x 1.
    """
    s, D_1, epsilon = (
        derivation.signals,
        output_disturbance(derivation.design),
        sp.Matrix(derivation.signals.epsilon),
    )
    residual = PD.dot(PD) if D_1 == 0 else 2 * PD.dot(PD) + D_1**2
    damping = sum((w * c * z**2 for w, c, z in zip(s.weights, s.c, s.z, strict=True)), sp.Integer(0))
    return -damping + error_weight(s) * (-epsilon.dot(epsilon) / 2 + residual)


def certificate_identity(derivation: Derivation) -> Identity:
    """(32) as an identity, modulo the Lyapunov equation: its residual multiplies the only term left."""
    s, n = derivation.signals, derivation.plant.order
    s_ = (sp.Integer(-1), *(real_symbol(f"s({i})") for i in range(2, derivation.plant.rho + 1)))
    P, epsilon = symmetric_matrix(n), sp.Matrix(s.epsilon)
    D = sp.Matrix(disturbance_symbols(derivation.plant))
    weight = error_weight(s)
    epsilon_dot = filter_matrix(s) * epsilon + D
    V_dot = error_energy_rate(derivation, s_) + weight * (2 * epsilon.T * P * epsilon_dot)[0]
    D_1 = output_disturbance(derivation.design)
    claim = certified_rate(derivation, P * D) - sum(squares(derivation, P * D, s_), sp.Integer(0))
    left = weight * (epsilon.T * lyapunov_residual(P, s) * epsilon)[0]
    constant = "|P D|^2" if D_1 == 0 else "(2 |P D|^2 + D_1^2)"
    statement = f"V' = -sum c w z^2 - sum |epsilon|^2/(4e) + sum {constant}/(2e) - squares"
    return Identity("certificate", statement, sp.expand(V_dot - claim - left))


def lyapunov_identities(s: Signals, P: sp.ImmutableMatrix) -> list[Identity]:
    """``P A0 + A0' P = -2 I`` entry by entry, for the P that is used."""
    residual = lyapunov_residual(P, s)
    return [
        Identity(
            f"P_{i + 1}{j + 1}",
            f"(P A0 + A0' P + 2 I)_{i + 1}{j + 1} = 0",
            sp.cancel(sp.together(residual[i, j])),
        )
        for i in range(len(s.k))
        for j in range(i, len(s.k))
    ]


def prove(derivation: Derivation) -> tuple[Identity, ...]:
    """Every identity that the certificate rests on, recomputed; all hold, or there is no certificate."""
    return (
        *estimation_identities(derivation),
        *partial_identities(derivation),
        *error_identities(derivation),
        energy_identity(derivation),
        certificate_identity(derivation),
        *lyapunov_identities(derivation.signals, lyapunov_matrix(derivation.signals)),
    )
