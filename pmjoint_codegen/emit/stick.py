"""Stick: what holds a run on a kink where the rates on both sides point to it.

Let g be the argument of a ``sign`` in the plant's rates, and s its side, +1 or -1. Where g is 0 and the sign
of g' = A + B s is that of -s on both sides, neither can be entered: Coulomb friction holds a joint at rest.
The motion stays on g = 0, and the side becomes the value for which g' = 0, ``s = -A/B`` in [-1, 1]. That is
Filippov's solution (Differential Equations with Discontinuous Righthand Sides, 1988, section 4) in the form
of Utkin's equivalent control. It ends where s reaches 1 or -1, on that side.

At rest, ``abs(g)`` and powers of ``sign(g)`` from 2 count as 0: ``1 - sign(g)**2`` is 1 at rest and 0 in
motion, so ``-(Fc + (Fs - Fc)*(1 - sign(x2)**2))*sign(x2)`` needs Fs to break away and slides with Fc.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_codegen.emit.vocabulary import Vocabulary
from pmjoint_derive import Equations, real_symbol

NEVER = sp.Integer(2)  # the side of a kink that cannot hold: no value in [-1, 1]


@dataclass(frozen=True)
class Stick:
    """The plant where one of its kinks may hold it, in terms of t, x, w, p, sides and flags.

    Attributes:
        flags: of each kink, 1 while it holds the run, else 0.
        rates: of the plant's states.
        channels: of each kink: its argument, or while it holds the run the side that does.
        given: definitions of symbols in these.
        sides: argument of a kink -> the symbol of its side.
        values: of each kink, the side that would hold; `NEVER` where none can.
        pulls: of each kink, B: it attracts where B is negative.
        places: of each kink, the state with g = 0 exactly, where g fixes one state.
        reported: disturbances by name, in terms of flags, without sides. The side that holds is clipped to
            [-1, 1]: where it lets go, it may be beyond. Also signals that are a kink's argument: 0 while it
            holds.
    """

    flags: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    channels: tuple[sp.Expr, ...]
    given: Mapping[sp.Symbol, sp.Expr]
    sides: Mapping[sp.Expr, sp.Symbol]
    values: tuple[sp.Expr, ...]
    pulls: tuple[sp.Expr, ...]
    places: tuple[sp.Expr, ...]
    reported: Mapping[sp.Symbol, sp.Expr]


@dataclass(frozen=True)
class _Rest:
    """One kink that can hold: g' = A + B s on g = 0, and what it holds still.

    Attributes:
        argument: g.
        A: g' without the side.
        B: slope of g' in the side.
        fixed: the state that g = 0 fixes, and its value in terms of `still`; None if there is no such state.
        still: other states that g depends on, whose rates are 0 on g = 0.
    """

    argument: sp.Expr
    A: sp.Expr
    B: sp.Expr
    fixed: tuple[sp.Symbol, sp.Expr] | None
    still: tuple[sp.Symbol, ...]


def stick(
    words: Vocabulary,
    time: sp.Symbol,
    rates: Sequence[sp.Symbol],
    given: Mapping[sp.Symbol, sp.Expr],
    equations: Equations,
    disturbances: Sequence[sp.Symbol] = (),
    signals: Sequence[sp.Symbol] = (),
) -> Stick | None:
    """What holds a run of this plant, or None if no kink can.

    A kink can hold if its argument depends on t, x and parameters only and has no kink inside, if its side
    enters the rate of its own argument, and if rates are affine in that side.

    Args:
        words: symbols of the plant.
        time: t.
        rates: names of the rates of the plant's states.
        given: definitions with priority over the equations, as of the row ``plant``.
        equations: the named equations.
        disturbances: names to report.
        signals: further names to report, of which an argument of a kink may be one.
    """
    known = {time, *words.x, *words.w, *words.p}
    arguments = [_unfolded(argument, known, given, equations) for argument in words.kinks]
    plain = [_unfolded(rate, known, given, equations) for rate in rates]
    slopes = dict(zip(words.x, plain, strict=True))
    allowed = {time, *words.x, *words.p}
    rests = [
        _rest(argument, [*arguments[:j], *arguments[j + 1 :]], time, slopes)
        if argument.free_symbols <= allowed and len(set(arguments)) == len(arguments)
        else None
        for j, argument in enumerate(arguments)
    ]
    if not any(rests):
        return None
    flags = tuple(real_symbol(f"held[{j}]") for j in range(len(rests)))
    free = tuple(real_symbol(f"free[{j}]") for j in range(len(rests)))
    holding = tuple(real_symbol(f"side_held[{j}]") for j in range(len(rests)))
    defined: dict[sp.Symbol, sp.Expr] = {}
    channels: list[sp.Expr] = []
    blended = plain
    for j, rest in enumerate(rests):
        if rest is None:
            channels.append(arguments[j])
            continue
        # Neither summand is undefined where its flag is 0, so lanes may choose by it.
        defined[free[j]] = 1 - flags[j]
        defined[holding[j]] = words.sides[j] * free[j] - flags[j] * rest.A / (flags[j] * rest.B + free[j])
        channels.append(flags[j] * holding[j] + free[j] * rest.argument)
        blended = [
            _replaced(rate, rest.argument, holding[j], free[j], free[j] * words.sides[j] * rest.argument)
            for rate in blended
        ]
    for j, rest in enumerate(rests):
        if rest is not None and rest.fixed is not None:  # exactly, not to rounding
            for place in map(words.x.index, (rest.fixed[0], *rest.still)):
                blended[place] = free[j] * blended[place]
    return Stick(
        flags=flags,
        rates=tuple(blended),
        channels=tuple(channels),
        given=defined,
        sides=dict(zip(arguments, words.sides, strict=True)),
        values=tuple(NEVER if rest is None else -rest.A / rest.B for rest in rests),
        pulls=tuple(sp.Integer(0) if rest is None else rest.B for rest in rests),
        places=tuple(place for rest in rests for place in _places(rest, words.x)),
        reported={
            **_reported(
                {name: _unfolded(name, known, given, equations) for name in disturbances}, rests, flags, free
            ),
            **_standing({name: _unfolded(name, known, given, equations) for name in signals}, rests, flags),
        },
    )


def _standing(
    signals: Mapping[sp.Symbol, sp.Expr], rests: Sequence[_Rest | None], flags: Sequence[sp.Symbol]
) -> dict[sp.Symbol, sp.Expr]:
    """Definitions for signals that are an argument of a kink, such as a joint's speed: 0 while it holds."""
    return {
        name: (1 - flags[j]) * value
        for name, value in signals.items()
        for j, rest in enumerate(rests)
        if rest is not None and sp.expand(value - rest.argument) == 0
    }


def _reported(
    disturbances: Mapping[sp.Symbol, sp.Expr],
    rests: Sequence[_Rest | None],
    flags: Sequence[sp.Symbol],
    free: Sequence[sp.Symbol],
) -> dict[sp.Symbol, sp.Expr]:
    """Definitions for what is reported: see `Stick.reported`."""
    found: dict[sp.Symbol, sp.Expr] = dict(disturbances)
    for j, rest in enumerate(rests):
        if rest is None:
            continue
        held = flags[j] * rest.A / (flags[j] * rest.B + free[j])
        side = free[j] * sp.sign(rest.argument) - sp.Max(-1, sp.Min(1, held))
        symbol = real_symbol(f"side_reported[{j}]")
        found = {
            name: _replaced(value, rest.argument, symbol, free[j], free[j] * sp.Abs(rest.argument))
            if name in disturbances
            else value
            for name, value in found.items()
        }
        found |= {symbol: side, free[j]: 1 - flags[j]}
    return found


def _unfolded(
    expression: sp.Expr,
    known: set[sp.Symbol],
    given: Mapping[sp.Symbol, sp.Expr],
    equations: Equations,
) -> sp.Expr:
    """An expression in terms of `known`, every other name replaced by its definition."""
    while names := [symbol for symbol in expression.free_symbols if symbol not in known]:
        expression = expression.xreplace(
            {name: given[name] if name in given else equations[name.name].expression for name in names}
        )
    return expression


def _rest(
    argument: sp.Expr,
    others: Iterable[sp.Expr],
    time: sp.Symbol,
    slopes: Mapping[sp.Symbol, sp.Expr],
) -> _Rest | None:
    """How a kink holds, if it can: see `stick`."""
    own = {sp.sign(argument), sp.Abs(argument)}
    if argument.has(sp.sign, sp.Abs) or any(other.atoms(sp.sign, sp.Abs) & own for other in others):
        return None
    side = sp.Dummy("side", real=True)
    at_rest = [_replaced(rate, argument, side, sp.Integer(0), sp.Integer(0)) for rate in slopes.values()]
    if any(sp.expand(sp.diff(rate, side, 2)) != 0 for rate in at_rest):
        return None
    rate = sp.diff(argument, time) + sum(
        sp.diff(argument, state) * at_rest[i] for i, state in enumerate(slopes)
    )
    pull = sp.diff(rate, side)
    if sp.expand(pull) == 0:
        return None
    fixed, still = _fixed(argument, time, dict(zip(slopes, at_rest, strict=True)))
    if sp.expand(pull.xreplace(_zero(argument, slopes))) == 0:  # sign(g)*g: a bend at g = 0, not a jump
        return None
    return _Rest(argument, rate.xreplace({side: sp.Integer(0)}), pull, fixed, still)


def _replaced(rate: sp.Expr, argument: sp.Expr, side: sp.Expr, power: sp.Expr, magnitude: sp.Expr) -> sp.Expr:
    """A rate with a kink's side and magnitude replaced.

    Args:
        rate: in terms of ``sign(argument)`` and ``abs(argument)``.
        argument: of the kink.
        side: for ``sign``.
        power: for its even powers; odd ones from 3 become this times `side`.
        magnitude: for ``abs``.
    """
    kink = sp.sign(argument)

    def is_power(part: sp.Basic) -> bool:
        return bool(part.is_Pow and part.base == kink and part.exp.is_Integer and part.exp >= 2)

    replaced = rate.replace(is_power, lambda part: power if part.exp % 2 == 0 else power * side)
    return replaced.xreplace({kink: side, sp.Abs(argument): magnitude})


def _zero(argument: sp.Expr, states: Iterable[sp.Symbol]) -> dict[sp.Expr, sp.Expr]:
    """A replacement for g = 0: of a state in which g is linear, else of g itself."""
    for state in states:
        slope = sp.diff(argument, state)
        if slope != 0 and state not in slope.free_symbols:
            return {state: -argument.xreplace({state: sp.Integer(0)}) / slope}
    return {argument: sp.Integer(0)}


def _fixed(
    argument: sp.Expr, time: sp.Symbol, rates: Mapping[sp.Symbol, sp.Expr]
) -> tuple[tuple[sp.Symbol, sp.Expr] | None, tuple[sp.Symbol, ...]]:
    """The one state that g = 0 fixes, with its value, and the other states of g, which stand still there.

    g = x2 fixes x2 at 0. A joint's speed x2 - a x1 fixes x2 at a x1 since x1' is that speed.

    Args:
        argument: g.
        time: t.
        rates: of the plant's states on g = 0.
    """
    moving = [state for state in rates if state in argument.free_symbols]
    if not moving or time in argument.free_symbols:
        return None, ()
    *others, state = moving
    slope = sp.diff(argument, state)
    if slope.free_symbols & set(rates):
        return None, ()
    value = sp.expand(-argument.xreplace({state: sp.Integer(0)}) / slope)
    if any(sp.expand(rates[other].xreplace({state: value})) != 0 for other in others):
        return None, ()
    return (state, value), tuple(others)


def _places(rest: _Rest | None, states: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """The states, the fixed one at its value."""
    fixed = {} if rest is None or rest.fixed is None else dict([rest.fixed])
    return [fixed.get(state, state) for state in states]
