"""The simulated plant with its own values of parameters that the controller uses too.

"J is 30 % off" means that the plant's J differs from the law's. Every parameter that both the plant and the
controller use, such as ``J``, has a twin ``J_plant`` that only the plant uses; if the two agree, the run is
the nominal one. Equations of the plant that depend on such a parameter have twins by the same rule:
``b0_plant``, ``D2_plant``, ``x2_dot_plant``. The design's own equations, and the theory, stay as they are.

To the design, the model mismatch is disturbance. In ``x_i' = x_{i+1} + known_i + D_i`` (11), (12), with
``known_i = phi_i + (Phi theta)_i + b_i sigma u``, the effective disturbance is ``D_i_effective = D_i_plant +
mismatch_i``, where ``mismatch_i = known_i_plant - known_i``. The estimation error obeys (17) with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import sympy as sp

from pmjoint_derive.closed_loop import disturbance_symbols
from pmjoint_derive.design import Design
from pmjoint_derive.equation import Equation, Equations, real_symbol
from pmjoint_derive.model import Model, Plant
from pmjoint_derive.signals import Signals, derivative_name, free
from pmjoint_derive.units import SECOND
from pmjoint_derive.valve import COMMAND, drive

SECTION = "True plant"
SUFFIX = "_plant"


def own_symbol(symbol: sp.Symbol) -> sp.Symbol:
    """The plant's own ``J_plant`` of a parameter or name ``J``."""
    return real_symbol(f"{symbol.name}{SUFFIX}")


def effective_symbol(symbol: sp.Symbol) -> sp.Symbol:
    """``D1_effective`` of ``D1``: the remainder of x1' without the design's model."""
    return real_symbol(f"{symbol.name}_effective")


def true_plant(
    model: Model,
    design: Design,
    physics: Sequence[Equation],
    derived: Sequence[Equation],
    told: Sequence[Equation] = (),
) -> tuple[Mapping[sp.Symbol, sp.Symbol], tuple[Equation, ...]]:
    """Find the parameters that plant and controller share, and write the plant in its own.

    Args:
        model: what is derived from.
        design: the controller's model.
        physics: the equations of the plant and of its actuator, u excepted: the controller clips v itself.
        derived: all equations, the design's among them.
        told: what is told of the loop with the plant's values, such as V; the plant does not use it, so that
            its parameters need none of their own.

    Returns:
        shared parameter -> the plant's own, in the model's order; the twins and the effective disturbance.
    """
    known = _known_rates(design, design.certified)
    really = _known_rates(design, design.truth)
    table = Equations([*derived, *known])
    shared = _shared(model, design.signals, table, physics)
    own = {symbol: own_symbol(symbol) for symbol in shared}
    driven = drive(model)
    changed = _depending([*physics, *told, *really], {**own, **driven})
    changed |= {item.symbol for item, true in zip(known, really, strict=True) if item != true}
    disturbances = disturbance_symbols(design.plant)
    differing = [i for i, item in enumerate(known) if item.symbol in changed]
    changed |= {disturbances[i] for i in differing}  # D_i keeps its name; x_i' has changed with known_i
    twins = own | {symbol: own_symbol(symbol) for symbol in changed}
    twins |= {u: twins.get(symbol, symbol) for u, symbol in driven.items()}
    return (
        own,
        (
            *(known[i] for i in differing),
            *(_twin(item, twins) for item in (*physics, *told, *really) if item.symbol in changed),
            *(entry for i in differing for entry in _effective(disturbances[i], known[i])),
        ),
    )


def _known_rates(design: Design, plant: Plant) -> list[Equation]:
    """``known_i``: a plant's x_i', beyond x_{i+1}; the design's model of it, or the truth."""
    x, known = design.signals.x, plant.known_rates(design.signals.u)
    return [
        Equation(
            real_symbol(f"known{i}"),
            rate,
            SECTION,
            "(11)",
            f"what the design knows of the rate of {state}",
            design.units.of(state) / SECOND,
        )
        for i, (state, rate) in enumerate(zip(x, known, strict=True), start=1)
    ]


def _shared(
    model: Model, signals: Signals, table: Equations, physics: Sequence[Equation]
) -> tuple[sp.Symbol, ...]:
    """Parameters that both sides use; not the limits of u, which the controller applies itself (10).

    The plant takes u and v as numbers: what v is made of, such as an amplitude of y_r, is no part of it.
    """
    controller = [signals.v, *map(_rate, signals.controller_state), *signals.y_r]
    plant = _reach((item.symbol for item in physics), table, until={signals.u, signals.v, COMMAND})
    used = (_reach(controller, table) & plant) - set(free(model.limits))
    return tuple(item.symbol for item in model.parameters if item.symbol in used)


def _rate(state: sp.Symbol) -> sp.Symbol:
    return real_symbol(derivative_name(state))


def _reach(names: Iterable[sp.Symbol], table: Equations, until: Iterable[sp.Symbol] = ()) -> set[sp.Symbol]:
    """The names, and everything that their equations speak of, directly or by way of others but `until`."""
    found = set(until)
    waiting = list(names)
    while waiting:
        symbol = waiting.pop()
        if symbol not in found:
            found.add(symbol)
            waiting += free([table[symbol.name].expression]) if symbol.name in table else []
    return found


def _depending(equations: Iterable[Equation], on: Iterable[sp.Symbol]) -> set[sp.Symbol]:
    """Left-hand sides that depend on some symbols, directly or by way of others."""
    items, found = list(equations), set(on)
    size = -1
    while len(found) > size:
        size = len(found)
        found |= {item.symbol for item in items if item.expression.free_symbols & found}
    return found & {item.symbol for item in items}


def _twin(item: Equation, twins: Mapping[sp.Symbol, sp.Symbol]) -> Equation:
    """An equation of the plant in its own values."""
    return Equation(
        twins[item.symbol],
        item.expression.xreplace(dict(twins)),
        SECTION,
        item.number,
        f"{item.meaning}, of the true plant",
        item.unit,
    )


def _effective(disturbance: sp.Symbol, known: Equation) -> tuple[Equation, Equation]:
    """The part of one rate that the design does not know."""
    index = disturbance.name.removeprefix("D")
    mismatch = real_symbol(f"mismatch{index}")
    return (
        Equation(
            mismatch,
            own_symbol(known.symbol) - known.symbol,
            SECTION,
            "(12)",
            f"model mismatch in the rate of x{index}",
            known.unit,
        ),
        Equation(
            effective_symbol(disturbance),
            own_symbol(disturbance) + mismatch,
            SECTION,
            "(12)",
            "effective disturbance: what the controller faces",
            known.unit,
        ),
    )
