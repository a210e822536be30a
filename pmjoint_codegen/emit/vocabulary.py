"""The words of the table: a derivation's symbols in the blocks that kernels take and give.

Blocks (dense vectors): ``p`` parameters, then gains and the compensator's switch; ``X`` plant states, then
``s`` the controller's states (xi, Xi row by row, lambda, r, estimates); ``y_r`` the reference and its
derivatives; ``w`` what the actuator delivers; ``g`` the actuator inside one saturation mode, ``w_j = g[2j] +
g[2j+1] v``; ``h`` the matrices of the exact zero-order hold. Where the plant has kinks, ``g`` of the closed
loop and ``w`` of the plant end with the side of each, +1 or -1: ``abs(a)`` is then ``side a`` and ``sign(a)``
is ``side``. ``p`` continues with the plant's own values of parameters that it shares with the controller:
rates of x, the actuator and what is reported of the plant follow those. Where the reference is data, ``p``
ends with the parameters of its present segment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import sympy as sp

from pmjoint_codegen.emit.affine import Entry
from pmjoint_codegen.emit.kinks import kink_arguments
from pmjoint_derive import Derivation, Equation, real_symbol
from pmjoint_derive.closed_loop import disturbance_symbols, tracking_error
from pmjoint_derive.hold import Hold
from pmjoint_derive.signals import derivative_name, named, partial_name
from pmjoint_derive.true_plant import own_symbol
from pmjoint_derive.valve import COMMAND, VALVE

Block = tuple[str, tuple[sp.Expr, ...]]


@dataclass(frozen=True)
class Vocabulary:
    """The blocks of one derivation, as symbols.

    Attributes:
        p: parameters, gains, switch, the plant's own parameters, the reference's segment.
        x: plant states.
        s: controller states.
        blocks: both by block: x, xi, Xi row by row, lambda, r.
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
    blocks: Mapping[str, tuple[sp.Symbol, ...]]
    w: tuple[sp.Symbol, ...]
    g: tuple[sp.Symbol, ...]
    h: tuple[sp.Symbol, ...]
    kinks: tuple[sp.Expr, ...]
    sides: tuple[sp.Symbol, ...]
    signals: tuple[sp.Symbol, ...]
    partials: tuple[sp.Symbol, ...]


def neutral_entry(derivation: Derivation) -> Entry:
    """Label and index of the parameter that is 1 unless it is set: the input scale."""
    return "p", vocabulary(derivation).p.index(derivation.signals.input_scale)


def vocabulary(derivation: Derivation) -> Vocabulary:
    """The blocks of a derivation."""
    s, n = derivation.signals, derivation.plant.order
    model = derivation.model
    w = tuple(channel.symbol for channel in model.actuator)
    g = tuple(real_symbol(f"g_{kind}{j}") for j in range(1, len(w) + 1) for kind in ("offset", "slope"))
    x = (*s.x, *(state.symbol for state in model.extras))
    rates = rate_block("x", x)[1]
    own = twins(derivation, rates, own_symbol)
    delivered = (*w, *map(own_symbol, w))
    kinks = kink_arguments((own.get(rate, rate) for rate in rates), derivation.equations, delivered)
    return Vocabulary(
        p=(
            *(item.symbol for item in derivation.model.parameters),
            *s.gains,
            *derivation.own_parameters.values(),
            *model.segment,
        ),
        x=x,
        s=s.controller_state,
        blocks={"x": x, **s.controller_blocks},
        w=w,
        g=g,
        h=Hold.of(s).symbols,
        kinks=kinks,
        sides=tuple(real_symbol(f"side{i}") for i in range(1, len(kinks) + 1)),
        signals=(
            *(s.y, s.y_r[0], tracking_error(model), *s.z, *s.alpha, s.v, s.u, *named("x_hat", n)),
            *disturbance_symbols(derivation.plant),
            *(item.symbol for item in reported(derivation)),
        ),
        partials=tuple(
            real_symbol(name)
            for alpha in s.alpha
            for by in s.measurable
            if (name := partial_name(alpha, by)) in derivation.equations
        ),
    )


def reported(derivation: Derivation) -> tuple[Equation, ...]:
    """Further signals that a run reports: the physics', estimates, V, a valve's, a sensor's."""
    equations, model, s = derivation.equations, derivation.model, derivation.signals
    moved = (hat.name for hat, state in zip(s.estimates, s.learnt, strict=True) if hat != state)
    names = (*moved, "V", "y_m", "y_f", *((COMMAND.name, VALVE.name) if model.dead_zone is not None else ()))
    return (*model.reported, *(equations[name] for name in names if name in equations))


def twins(
    derivation: Derivation, symbols: Iterable[sp.Symbol], twin: Callable[[sp.Symbol], sp.Symbol]
) -> dict[sp.Symbol, sp.Expr]:
    """Names of the plant that its own parameters change -> their twins.

    Args:
        derivation: the named equations.
        symbols: the names.
        twin: of a name, if it has one: `own_symbol` or `effective_symbol`.
    """
    return {symbol: twin(symbol) for symbol in symbols if twin(symbol).name in derivation.equations}


def rate_block(label: str, states: tuple[sp.Symbol, ...]) -> Block:
    """The rates of some states, by name."""
    return f"{label}_dot", tuple(real_symbol(derivative_name(state)) for state in states)
