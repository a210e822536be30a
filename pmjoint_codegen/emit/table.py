"""The flat table of what is emitted: name, inputs, outputs, equation. It predicts ``generated/``.

A row is a `Kernel`, made of named equations, or it is made from earlier rows: `Taylor` coefficients of
another's results, a `Guard` of these, or `Composed`. `kernel_table` has the rows that depend on the
derivation; `loop_table` has those that are made from these. `vocabulary` explains the blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import sympy as sp

from pmjoint_codegen.emit.stick import Stick, stick
from pmjoint_codegen.emit.vocabulary import Block, Vocabulary, rate_block, reported, twins, vocabulary
from pmjoint_derive import Derivation, real_symbol
from pmjoint_derive.closed_loop import disturbance_symbols, tracking_error
from pmjoint_derive.compensator_matrix import compensator_matrix
from pmjoint_derive.filters import filter_matrix
from pmjoint_derive.signals import named
from pmjoint_derive.start import start_symbol
from pmjoint_derive.true_plant import effective_symbol, own_symbol


@dataclass(frozen=True)
class Kernel:
    """A function of named equations.

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
class Taylor:
    """Taylor coefficients of another function's results, along its solution.

    Attributes:
        name: name in C.
        of: the other function.
        state: label of its input that moves.
        order: highest coefficient; None where it is chosen for each model.
        equation: paper numbers.
        about: one line for the reader.
    """

    name: str
    of: str
    state: str
    order: int | None
    equation: str = ""
    about: str = ""


@dataclass(frozen=True)
class Guard:
    """A bound on the error of such coefficients.

    Attributes:
        name: name in C.
        of: the function whose coefficients they are.
        state: label of its input that moves.
        equation: empty: it is no equation of the paper.
        about: one line for the reader.
    """

    name: str
    of: str
    state: str
    equation: str = ""
    about: str = ""


@dataclass(frozen=True)
class Composed:
    """A function put together from others.

    Attributes:
        name: name in C.
        of: what it is made from.
        build: takes the name and the functions of `of`.
        equation: paper numbers.
        about: one line for the reader.
    """

    name: str
    of: tuple[str, ...]
    build: Callable[..., ca.Function]
    equation: str = ""
    about: str = ""


Made = Taylor | Guard | Composed


def kernel_table(derivation: Derivation) -> tuple[Kernel, ...]:
    """The rows that are made of a derivation's equations."""
    s, words = derivation.signals, vocabulary(derivation)
    t, p, x, state = ("t", (s.t,)), ("p", words.p), ("x", words.x), ("s", words.s)
    y, y_r, u, v, du = ("y", (s.y,)), ("y_r", s.y_r), ("u", (s.u,)), ("v", (s.v,)), ("du", (s.du,))
    X, w, h = ("X", (*words.x, *words.s)), ("w", words.w), ("h", words.h)
    limits = tuple(entry for four in actuator_limits(derivation).values() for entry in four)
    delivered = {own_symbol(symbol): symbol for symbol in words.w}
    physical = (*rate_block("x", words.x)[1], *(item.symbol for item in reported(derivation)))
    own = twins(derivation, physical, own_symbol)
    effective = twins(derivation, disturbance_symbols(derivation.plant), effective_symbol)
    in_mode = {symbol: words.g[2 * j] + words.g[2 * j + 1] * s.v for j, symbol in enumerate(words.w)}
    # One factor of v, so that nothing is left of what saturation clips where it clips nothing.
    in_mode[s.du] = words.g[0] + (words.g[1] - 1) * s.v
    sides = dict(zip(words.kinks, words.sides, strict=True))
    e, kinks = ("e", (tracking_error(derivation.model),)), [("kinks", words.kinks)] if words.kinks else []
    filters = tuple(rate_block(block, words.blocks[block]) for block in ("xi", "Xi", "lambda"))
    matched = tuple(
        start_symbol(state) * (s.compensator if state in s.r else 1) for state in s.controller_state
    )
    held = stick(
        words,
        s.t,
        rate_block("x", words.x)[1],
        {**own, **delivered},
        derivation.equations,
        _named(derivation, disturbance_symbols(derivation.plant)),
        _named(derivation, (item.symbol for item in derivation.model.reported)),
    )
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
        Kernel("filters", (y, state, u, p), filters, "(14)", "rates of the K-filters"),
        Kernel(
            "compensator",
            (y, state, du, p),
            (rate_block("r", s.r),),
            "(23)",
            "rates of the compensator",
        ),
        *_estimation(derivation, (y, state, y_r, u, v, p)),
        Kernel("estimate", (state, p), (("x_hat", named("x_hat", len(s.x))),), "(15)", "state estimate"),
        Kernel(
            "disturbance",
            (t, x, w, p),
            _acting(derivation),
            "(12)",
            "effective disturbance: what the controller faces; what else the plant reports",
            {**own, **effective, **delivered},
        ),
        Kernel(
            "plant",
            (t, x, ("w", (*words.w, *words.sides)), p),
            (rate_block("x", words.x), e, *kinks),
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
            (rate_block("X", (*words.x, *words.s)), v, e, *kinks),
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
            {**own, **effective},
        ),
        Kernel(
            "filter_matrix", (p,), (("A0", tuple(filter_matrix(s))),), "(14)", "A0 = A - k e1', row by row"
        ),
        Kernel("compensator_matrix", (p,), (("Ar", tuple(compensator_matrix(s))),), "(23)", "row by row"),
        Kernel(
            "sampled_update",
            (y, state, y_r, u, v, h, p),
            (("s_next", tuple(real_symbol(f"{item.name}_next") for item in words.s)),),
            "(14), (23)",
            "the controller's state one sample later",
        ),
        Kernel(
            "start",
            (y, y_r, p),
            (("s", matched),),
            "(24)",
            "the controller's state matched to y(0)",
        ),
        *([] if held is None else _held_kernels(derivation, words, held, {**own, **delivered}, in_mode)),
    )


def _estimation(derivation: Derivation, inputs: tuple[Block, ...]) -> tuple[Kernel, ...]:
    """The rates of what a controller estimates of its plant, if it does."""
    s = derivation.signals
    learnt = (*s.learnt, *s.inverse, *s.covariance)
    if not learnt:
        return ()
    return (Kernel("estimation", inputs, (rate_block("Theta", learnt),), "", "rates of what it learns"),)


def _named(derivation: Derivation, symbols: Iterable[sp.Symbol]) -> list[sp.Symbol]:
    """Some names of the plant and their twins, such as D_i and D_i_plant."""
    names = list(symbols)
    return [*names, *twins(derivation, names, own_symbol).values()]


def _acting(derivation: Derivation) -> tuple[Block, ...]:
    """D and, where there are any, the physical quantities that a run reports."""
    physical = tuple(item.symbol for item in derivation.model.reported)
    found = ("D", disturbance_symbols(derivation.plant))
    return (found, ("reported", physical)) if physical else (found,)


def _held_kernels(
    derivation: Derivation,
    words: Vocabulary,
    held: Stick,
    given: Mapping[sp.Symbol, sp.Expr],
    in_mode: Mapping[sp.Symbol, sp.Expr],
) -> list[Kernel]:
    """The rows of a plant that a kink can hold: ``plant`` and ``closed_loop`` there, and whether it does."""
    t, x, p = ("t", (derivation.signals.t,)), ("x", words.x), ("p", words.p)
    X, sided = ("X", (*words.x, *words.s)), (*words.sides, *held.flags)
    e, v = ("e", (tracking_error(derivation.model),)), ("v", (derivation.signals.v,))
    effective = twins(derivation, disturbance_symbols(derivation.plant), effective_symbol)
    kinks = ("kinks", held.channels)
    controller = rate_block("X", words.s)[1]
    return [
        Kernel(
            "plant_held",
            (t, x, ("w", (*words.w, *sided)), p),
            (("x_dot", held.rates), e, kinks),
            "(11)",
            "plant, held on the kinks whose flags are 1",
            {**given, **held.given},
            held.sides,
        ),
        Kernel(
            "closed_loop_held",
            (t, X, ("g", (*words.g, *sided)), p),
            (("X_dot", (*held.rates, *controller)), v, e, kinks),
            "(11), (14), (23), (29)",
            "closed_loop, held on the kinks whose flags are 1",
            {**given, **in_mode, **held.given},
            held.sides,
        ),
        Kernel(
            "holds",
            (t, x, ("w", (*words.w, *words.sides)), p),
            (("value", held.values), ("pull", held.pulls), ("place", held.places)),
            "",
            "side that holds on each kink, its slope in the argument's rate, the state there",
            {**given},
            held.sides,
        ),
        Kernel(
            "signals_held",
            (t, X, ("held", held.flags), p),
            (("signals", words.signals),),
            "",
            "signals, held on the kinks whose flags are 1",
            {
                **twins(derivation, rate_block("x", words.x)[1], own_symbol),
                **twins(derivation, (item.symbol for item in derivation.model.reported), own_symbol),
                **twins(derivation, words.w, own_symbol),
                **held.reported,
                **effective,
            },
        ),
        Kernel(
            "disturbance_held",
            (t, x, ("w", words.w), ("held", held.flags), p),
            _acting(derivation),
            "(12)",
            "disturbance, held on the kinks whose flags are 1",
            {**given, **held.reported, **effective},
        ),
    ]


def actuator_limits(derivation: Derivation) -> dict[sp.Symbol, tuple[sp.Expr, ...]]:
    """Offset, slope, lower and upper limit of each w: the controller clips u itself, the plant the others."""
    own = dict(derivation.own_parameters)
    limits = {
        channel.symbol: (channel.offset, channel.slope, channel.lower, channel.upper)
        for channel in derivation.model.actuator
    }
    u, *others = limits
    return {u: limits[u]} | {w: tuple(entry.xreplace(own) for entry in limits[w]) for w in others}
