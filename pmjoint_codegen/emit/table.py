"""The flat table of what is emitted: name, inputs, outputs, equation. It predicts ``generated/``.

Blocks (dense vectors): ``p`` parameters, then gains and the compensator's switch; ``X`` plant states, then
``s`` the controller's states (xi, Xi row by row, lambda, r); ``y_r`` the reference and its derivatives; ``w``
what the actuator delivers; ``g`` the actuator inside one saturation mode, ``w_j = g[2j] + g[2j+1] v``; ``h``
the matrices of the exact zero-order hold. Where the plant has kinks, ``g`` of the closed loop and ``w`` of
the plant end with the side of each, +1 or -1: ``abs(a)`` is then ``side a`` and ``sign(a)`` is ``side``.
``p`` ends with the plant's own values of parameters that it shares with the controller: rates of x, the
actuator and what is reported of the plant follow those.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import sympy as sp

from pmjoint_codegen.emit.kinks import kink_arguments
from pmjoint_derive import Derivation, parameter_symbol
from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.compensator import compensator_matrix
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.sampling import Hold
from pmjoint_derive.signals import derivative_name, named
from pmjoint_derive.true_plant import own_symbol, seen_symbol

Block = tuple[str, tuple[sp.Expr, ...]]


@dataclass(frozen=True)
class Kernel:
    """One emitted function.

    Attributes:
        name: name in C.
        inputs: label and symbols of each argument, in order.
        outputs: label and expressions of each result, in order.
        equation: paper numbers.
        about: one line for the reader.
        given: definitions that hold in this kernel alone.
        sides: argument of a kink -> the symbol of the side on which it is.
    """

    name: str
    inputs: tuple[Block, ...]
    outputs: tuple[Block, ...]
    equation: str
    about: str
    given: Mapping[sp.Symbol, sp.Expr] = field(default_factory=dict)
    sides: Mapping[sp.Expr, sp.Symbol] = field(default_factory=dict)


@dataclass(frozen=True)
class Vocabulary:
    """The blocks of one derivation, as symbols.

    Attributes:
        p: parameters, gains, switch, the plant's own parameters.
        x: plant states.
        s: controller states.
        w: what the actuator delivers; entry 0 is u.
        g: offset and slope of each entry of w.
        h: matrices of the zero-order hold.
        kinks: arguments of abs and sign in the plant's rates, inner ones first.
        sides: the side of each.
        signals: what the ``signals`` kernel returns.
        partials: every partial derivative of every virtual control.
    """

    p: tuple[sp.Symbol, ...]
    x: tuple[sp.Symbol, ...]
    s: tuple[sp.Symbol, ...]
    w: tuple[sp.Symbol, ...]
    g: tuple[sp.Symbol, ...]
    h: tuple[sp.Symbol, ...]
    kinks: tuple[sp.Expr, ...]
    sides: tuple[sp.Symbol, ...]
    signals: tuple[sp.Symbol, ...]
    partials: tuple[sp.Symbol, ...]


def vocabulary(derivation: Derivation) -> Vocabulary:
    """The blocks of a derivation."""
    s, n = derivation.signals, derivation.plant.order
    model = derivation.model
    w = tuple(channel.symbol for channel in model.actuator)
    g = tuple(parameter_symbol(f"g_{kind}{j}") for j in range(1, len(w) + 1) for kind in ("offset", "slope"))
    x = (*s.x, *(state.symbol for state in model.extras))
    kinks = kink_arguments(_true_rates(derivation, x), derivation.equations)
    return Vocabulary(
        p=(
            *(item.symbol for item in derivation.model.parameters),
            *s.gains,
            *derivation.own_parameters.values(),
        ),
        x=x,
        s=s.controller_state,
        w=w,
        g=g,
        h=Hold.of(s).symbols,
        kinks=kinks,
        sides=tuple(parameter_symbol(f"side{i}") for i in range(1, len(kinks) + 1)),
        signals=(
            *(s.y, s.y_r[0], parameter_symbol("e"), *s.z, *s.alpha, s.v, s.u, *named("x_hat", n)),
            *disturbance_symbols(derivation.plant),
            *(item.symbol for item in model.reported),
        ),
        partials=tuple(
            item.symbol
            for item in derivation.equations.values()
            if item.meaning.startswith("partial derivative")
        ),
    )


def kernel_table(derivation: Derivation) -> tuple[Kernel, ...]:
    """Every function of ``kernels.c`` but those that are made from these rows, see `functions`."""
    s, words = derivation.signals, vocabulary(derivation)
    t, p, x, state = ("t", (s.t,)), ("p", words.p), ("x", words.x), ("s", words.s)
    y, y_r, u, v, du = ("y", (s.y,)), ("y_r", s.y_r), ("u", (s.u,)), ("v", (s.v,)), ("du", (s.du,))
    X, w, h = ("X", (*words.x, *words.s)), ("w", words.w), ("h", words.h)
    limits = tuple(entry for four in actuator_limits(derivation).values() for entry in four)
    delivered = {own_symbol(symbol): symbol for symbol in words.w}
    own = _own(
        derivation, (*_rate_block("x", words.x)[1], *(item.symbol for item in derivation.model.reported))
    )
    faced = _faced(derivation)
    in_mode = {symbol: words.g[2 * j] + words.g[2 * j + 1] * s.v for j, symbol in enumerate(words.w)}
    # One factor of v, so that nothing is left of what saturation clips where it clips nothing.
    in_mode[s.du] = words.g[0] + (words.g[1] - 1) * s.v
    sides = dict(zip(words.kinks, words.sides, strict=True))
    e, kinks = ("e", (parameter_symbol("e"),)), [("kinks", words.kinks)] if words.kinks else []
    return (
        Kernel("reference", (t, p), (y_r,), "", "the reference and its derivatives"),
        Kernel(
            "law",
            (y, state, y_r, p),
            (("z", s.z), ("alpha", s.alpha), v),
            "(24), (25), (29)",
            "errors, virtual controls and the control law",
        ),
        Kernel(
            "partials",
            (y, state, y_r, p),
            (("dalpha", words.partials),),
            "(29)",
            "partial derivatives of alpha",
        ),
        Kernel("filters", (y, state, u, p), _rates(s.xi, s.Xi, s.lambda_), "(14)", "rates of the K-filters"),
        Kernel(
            "compensator",
            (y, state, du, p),
            (_rate_block("r", s.r),),
            "(23)",
            "rates of the compensator",
        ),
        Kernel("estimate", (state, p), (("x_hat", named("x_hat", len(s.xi))),), "(15)", "state estimate"),
        Kernel(
            "disturbance",
            (t, x, w, p),
            (("D", disturbance_symbols(derivation.plant)),),
            "(12)",
            "disturbance that the controller faces",
            {**faced, **delivered},
        ),
        Kernel(
            "plant",
            (t, x, ("w", (*words.w, *words.sides)), p),
            (_rate_block("x", words.x), e, *kinks),
            "(11)",
            "rates of the plant, the tracking error",
            {**own, **delivered},
            sides,
        ),
        Kernel(
            "actuation",
            (p,),
            (("limits", limits),),
            "(10)",
            "offset, slope, lower and upper limit of each w",
        ),
        Kernel(
            "closed_loop",
            (t, X, ("g", (*words.g, *words.sides)), p),
            (_rate_block("X", (*words.x, *words.s)), v, e, *kinks),
            "(11), (14), (23), (29)",
            "rates of the closed loop inside one saturation mode, v, the tracking error",
            {**own, **delivered, **in_mode},
            sides,
        ),
        Kernel(
            "signals",
            (t, X, p),
            (("signals", words.signals),),
            "",
            "everything a run reports beside its states",
            {**own, **faced},
        ),
        Kernel(
            "filter_matrix", (p,), (("A0", tuple(filter_matrix(s))),), "(14)", "A0 = A - k e1', row by row"
        ),
        Kernel("compensator_matrix", (p,), (("Ar", tuple(compensator_matrix(s))),), "(23)", "row by row"),
        Kernel(
            "sampled_update",
            (y, state, u, v, h, p),
            (("s_next", tuple(parameter_symbol(f"{item.name}_next") for item in words.s)),),
            "(14), (23)",
            "the controller's state one sample later",
        ),
    )


def _true_rates(derivation: Derivation, x: tuple[sp.Symbol, ...]) -> tuple[sp.Symbol, ...]:
    """Symbols of the simulated plant's rates, in its own values where these may differ."""
    rates = _rate_block("x", x)[1]
    own = _own(derivation, rates)
    return tuple(own.get(rate, rate) for rate in rates)


def _own(derivation: Derivation, symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, sp.Expr]:
    """Names of the plant that its own parameters change -> their twins."""
    return {
        symbol: own_symbol(symbol) for symbol in symbols if own_symbol(symbol).name in derivation.equations
    }


def _faced(derivation: Derivation) -> dict[sp.Symbol, sp.Expr]:
    """Each disturbance -> what the controller faces of it."""
    return {
        symbol: seen_symbol(symbol)
        for symbol in disturbance_symbols(derivation.plant)
        if seen_symbol(symbol).name in derivation.equations
    }


def actuator_limits(derivation: Derivation) -> dict[sp.Symbol, tuple[sp.Expr, ...]]:
    """Offset, slope, lower and upper limit of each w: the controller clips u itself, the plant the others."""
    own = dict(derivation.own_parameters)
    limits = {
        channel.symbol: (channel.offset, channel.slope, channel.lower, channel.upper)
        for channel in derivation.model.actuator
    }
    u, *others = limits
    return {u: limits[u]} | {w: tuple(entry.xreplace(own) for entry in limits[w]) for w in others}


def _rate_block(label: str, states: tuple[sp.Symbol, ...]) -> Block:
    return f"{label}_dot", tuple(parameter_symbol(derivative_name(state)) for state in states)


def _rates(
    xi: tuple[sp.Symbol, ...], Xi: tuple[tuple[sp.Symbol, ...], ...], lambda_: tuple[sp.Symbol, ...]
) -> tuple[Block, ...]:
    rows = tuple(entry for row in Xi for entry in row)
    return _rate_block("xi", xi), _rate_block("Xi", rows), _rate_block("lambda", lambda_)
