"""Derived equations that must agree with each other, as identities that expand to exactly zero.

The certificate does not see them: the reference's derivatives, the disturbance, the sampled controller and
the matched start.
"""

from __future__ import annotations

import sympy as sp

from pmjoint_derive.braking import braking_identities
from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.design import Derivation
from pmjoint_derive.equation import Equation, Equations, Identity
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.hold import Hold
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.start import start_symbol
from pmjoint_derive.vanishing import expand_to_zero


def reference_identities(derivation: Derivation) -> list[Identity]:
    """Each derivative of the reference is that of the one before it; the first is the model's."""
    s, model = derivation.signals, derivation.model
    values = [derivation.equations[symbol.name].expression for symbol in s.y_r]
    wanted = [model.reference, *(sp.diff(value, s.t) for value in values[:-1])]
    return [
        Identity(str(symbol), f"{symbol} follows from the reference", sp.expand(value - expected))
        for symbol, value, expected in zip(s.y_r, values, wanted, strict=True)
    ]


def disturbance_identities(derivation: Derivation) -> list[Identity]:
    """Each named disturbance is the model's."""
    symbols = disturbance_symbols(derivation.plant)
    return [
        Identity(
            str(symbol),
            f"{symbol} is the model's disturbance",
            sp.expand(derivation.equations[symbol.name].expression - expected),
        )
        for symbol, expected in zip(symbols, derivation.plant.disturbance, strict=True)
    ]


def sampling_identities(derivation: Derivation) -> list[Identity]:
    """``s(t + T) = F s + G (s' - A s)``: the exact solution of ``s' = A s + drive`` with the drive held."""
    s, hold = derivation.signals, Hold.of(derivation.signals)
    columns = zip(*s.Xi, strict=True)
    A0 = filter_matrix(s)
    filters = (s.xi, *columns, s.lambda_) if derivation.design.exact_hold else ()
    systems = [(sp.Matrix(states), A0, hold.F0, hold.G0) for states in filters]
    if s.r and not s.braking and not s.estimates:
        systems.append((sp.Matrix(s.r), compensator_matrix(s), hold.Fr, hold.Gr))
    held = [identity for system in systems for identity in _held(derivation, *system)]
    return [*held, *(braking_identities(derivation, hold.Fr, hold.Gr) if s.braking else [])]


def _held(
    derivation: Derivation, states: sp.Matrix, A: sp.MatrixBase, F: sp.MatrixBase, G: sp.MatrixBase
) -> list[Identity]:
    s, equations = derivation.signals, derivation.equations
    keep = frozenset({s.y, s.u, s.v})
    rates = sp.Matrix([equations.expand(equations[derivative_name(x)].expression, keep) for x in states])
    updates = sp.Matrix([equations.expand(equations[f"{x.name}_next"].expression, keep) for x in states])
    rest = updates - F * states - G * (rates - A * states)
    return [
        Identity(f"{x}_next", f"{x} one sample later is exact for held inputs", sp.expand(entry))
        for x, entry in zip(states, rest, strict=True)
    ]


def start_identities(derivation: Derivation) -> list[Identity]:
    """At the matched start a compensator makes z = 0; epsilon is what a plant at rest has.

    That is 0, then ``x_{i+1} + drift_i(y)``.
    """
    s, plant = derivation.signals, derivation.plant
    known = derivation.equations
    adaptation = derivation.design.adaptation
    ranged = () if adaptation is None else adaptation.ranged
    # states as names of their start values: every name then has its value there
    states = [
        Equation(state, known[start_symbol(state).name].expression, "", "", "", None)
        for state in s.controller_state
    ]
    states += [Equation(entry.estimate, entry.guess_symbol, "", "", "", None) for entry in ranged]
    given = {s.y.name, *(item.name for item in states)}
    there = Equations([*(item for name, item in known.items() if name not in given), *states])
    keep = frozenset(s.y_r)

    def vanishes(value: sp.Expr) -> sp.Expr:
        return expand_to_zero(there.expand(value, keep), plant.sigma)

    errors = [
        Identity(f"{z}(0)", f"{z} = 0 at the matched start", vanishes(known[z.name].expression))
        for z, _ in zip(s.z, s.r, strict=False)  # r makes it so
    ]
    rest = (
        sp.Integer(0),
        *(x + drift for x, drift in zip(s.x[1:], derivation.design.certified.drift, strict=False)),
    )
    matched = [
        Identity(
            f"{epsilon}(0)",
            f"{epsilon} is {expected} at the matched start",
            vanishes((known[epsilon.name].expression - expected).xreplace({s.x[0]: s.y})),
        )
        for epsilon, expected in zip(s.epsilon, rest, strict=True)
    ]
    guessed = [
        Identity(
            f"{entry.estimate}(0)",
            f"{entry.estimate} starts from {entry.guess_symbol}",
            known.expand(known[entry.estimate.name].expression).xreplace(
                {entry.state: known[start_symbol(entry.state).name].expression}
            )
            - entry.guess_symbol,
        )
        for entry in ranged
    ]
    return [*errors, *matched, *guessed]


def consistency_identities(derivation: Derivation) -> tuple[Identity, ...]:
    """Every identity of this module."""
    return (
        *reference_identities(derivation),
        *disturbance_identities(derivation),
        *sampling_identities(derivation),
        *start_identities(derivation),
    )
