"""The signals of the closed loop and the symbols that stand for them, with the paper's names and units.

Order of the loop's state: plant x, then the controller's own state s = (xi, Xi row by row, lambda, r) and,
of an adaptive design, its estimates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

import sympy as sp

from pmjoint_derive.adaptation import adaptation_units
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.model import Model, Plant
from pmjoint_derive.units import SECOND, Unit, parse_unit


def named(stem: str, count: int, first: int = 1) -> tuple[sp.Symbol, ...]:
    """Real symbols ``stem1 ... stemN``."""
    return tuple(real_symbol(f"{stem}{i}") for i in range(first, first + count))


def reference_name(order: int) -> str:
    """Name of a derivative of the reference: ``y_r``, ``dy_r``, ``d2y_r``, ..."""
    return {0: "y_r", 1: "dy_r"}.get(order, f"d{order}y_r")


@dataclass(frozen=True)
class Signals:
    """Every symbol of one design.

    Attributes:
        t: time.
        y: measured output.
        x: n plant states.
        xi: n states of the filter (14) driven by y.
        Xi: n rows of p states of the filter (14) driven by Phi.
        lambda_: n states of the filter (14) driven by the applied input.
        r: rho states of the compensator (23).
        y_r: the reference and its derivatives up to order rho.
        z: rho backstepping errors (24).
        alpha: rho - 1 virtual controls (25).
        epsilon: n estimation errors (17).
        v: the control law's output (29).
        u: the applied, saturated input (10).
        du: the clipped part of the input, u - v (23).
        c, e, ck: rho gains each; k: n filter gains.
        compensator: 1 when (23) is driven, 0 for plain clipping.
        input_scale: kappa > 0, the weight of z_2 ... z_rho in V (30): the law is that of the input kappa u.
        braking: the share of the limit that a braking compensator reckons with, alone; else empty.
        observer: the bandwidth of an extended-state observer, alone; else empty.
        estimates: estimates of the unknown entries of Theta; empty where all are known.
        learnt: the state of each estimate: itself or, with a range, its logit.
        inverse: the estimate of 1/b_m, alone; else empty.
        covariance: upper triangle of the gain matrix of least squares, row by row; else empty.
        adaptation: run-time parameters of guesses and estimates.
    """

    t: sp.Symbol
    y: sp.Symbol
    x: tuple[sp.Symbol, ...]
    xi: tuple[sp.Symbol, ...]
    Xi: tuple[tuple[sp.Symbol, ...], ...]
    lambda_: tuple[sp.Symbol, ...]
    r: tuple[sp.Symbol, ...]
    y_r: tuple[sp.Symbol, ...]
    z: tuple[sp.Symbol, ...]
    alpha: tuple[sp.Symbol, ...]
    epsilon: tuple[sp.Symbol, ...]
    v: sp.Symbol
    u: sp.Symbol
    du: sp.Symbol
    c: tuple[sp.Symbol, ...]
    e: tuple[sp.Symbol, ...]
    ck: tuple[sp.Symbol, ...]
    k: tuple[sp.Symbol, ...]
    compensator: sp.Symbol
    input_scale: sp.Symbol
    braking: tuple[sp.Symbol, ...] = ()
    observer: tuple[sp.Symbol, ...] = ()
    estimates: tuple[sp.Symbol, ...] = ()
    learnt: tuple[sp.Symbol, ...] = ()
    inverse: tuple[sp.Symbol, ...] = ()
    covariance: tuple[sp.Symbol, ...] = ()
    adaptation: tuple[sp.Symbol, ...] = ()

    @classmethod
    def of(cls, plant: Plant) -> Signals:
        """The signals of a design for ``plant``."""
        n, rho, p = plant.order, plant.rho, plant.p
        return cls(
            t=real_symbol("t"),
            y=real_symbol("y"),
            x=named("x", n),
            xi=named("xi", n),
            Xi=tuple(tuple(real_symbol(f"Xi{i}{j}") for j in range(1, p + 1)) for i in range(1, n + 1)),
            lambda_=named("lambda", n),
            r=named("r", rho),
            y_r=tuple(real_symbol(reference_name(i)) for i in range(rho + 1)),
            z=named("z", rho),
            alpha=named("alpha", rho - 1),
            epsilon=named("epsilon", n),
            v=real_symbol("v"),
            u=real_symbol("u"),
            du=real_symbol("du"),
            c=named("c", rho),
            e=named("e", rho),
            ck=named("ck", rho),
            k=named("k", n),
            compensator=real_symbol("compensator"),
            input_scale=real_symbol("input_scale"),
        )

    @property
    def controller_state(self) -> tuple[sp.Symbol, ...]:
        """What the controller integrates: xi, Xi row by row, lambda, r, what it learns."""
        return tuple(chain.from_iterable(self.controller_blocks.values()))

    @property
    def controller_blocks(self) -> dict[str, tuple[sp.Symbol, ...]]:
        """The same by block."""
        Xi = tuple(chain.from_iterable(self.Xi))
        found = {"xi": self.xi, "Xi": Xi, "lambda": self.lambda_, "r": self.r}
        learnt = {"Theta": self.learnt, "rho": self.inverse, "Gamma": self.covariance}
        return found | {block: symbols for block, symbols in learnt.items() if symbols}

    @property
    def measurable(self) -> tuple[sp.Symbol, ...]:
        """What a virtual control may depend on besides parameters: y, `had`, the reference."""
        return (self.y, *self.had, *self.y_r)

    @property
    def had(self) -> tuple[sp.Symbol, ...]:
        """The controller's state, with the estimates themselves for their states."""
        blocks = self.controller_blocks | ({"Theta": self.estimates} if self.estimates else {})
        return tuple(chain.from_iterable(blocks.values()))

    @property
    def gains(self) -> tuple[sp.Symbol, ...]:
        """All gains as in the parameter vector, then switch, input scale, braking, observer, adaptation."""
        design = (self.compensator, self.input_scale, *self.braking, *self.observer, *self.adaptation)
        return (*chain.from_iterable(self.gains_by_kind.values()), *design)

    @property
    def gains_by_kind(self) -> dict[str, tuple[sp.Symbol, ...]]:
        """The symbols of `pmjoint_derive.model.Gains.by_kind`."""
        return {"c": self.c, "e": self.e, "ck": self.ck, "k": self.k}

    @property
    def filter_gains(self) -> tuple[sp.Expr, ...]:
        """The first column of A0 with its sign changed: k, or that of n + 1 poles at ``-observer``."""
        if not self.observer:
            return self.k
        size = len(self.xi)
        return tuple(sp.binomial(size, i) * self.observer[0] ** i for i in range(1, size + 1))

    @property
    def weights(self) -> tuple[sp.Expr, ...]:
        """Weight of each ``z_i^2/2`` in V (30): 1, then kappa^2, for the errors of ``kappa u``."""
        return (sp.Integer(1), *(self.input_scale**2,) * (len(self.z) - 1))


def derivative_name(symbol: sp.Symbol) -> str:
    """Name of a time derivative: ``x1`` gives ``x1_dot``."""
    return f"{symbol.name}_dot"


def partial_name(of: sp.Symbol, by: sp.Symbol) -> str:
    """Name of a partial derivative: ``dalpha1_dy``."""
    return f"d{of.name}_d{by.name}"


class Units:
    """Physical units of the signals, from the units of y, u and the parameters.

    A unit that a parameter does not state is taken from its place: ``k_i`` is 1/s^i whatever the model.
    """

    def __init__(self, model: Model, s: Signals) -> None:
        """Label every signal ``s`` of a design for ``model``."""
        plant = model.plant
        y, u = parse_unit(model.y_unit), parse_unit(model.u_unit)
        stated = {item.name: parse_unit(item.unit) for item in model.parameters}
        stated |= {item.name: item.unit or Unit({}) for item in model.constants}
        rho, n = plant.rho, plant.order
        per_second = SECOND**-1
        input_side = [
            u * SECOND ** (rho - i + 1) for i in range(1, rho + 1)
        ]  # of v_{m,i}, z_i and alpha_{i-1}, i >= 2
        table: dict[sp.Symbol, Unit] = {item.symbol: stated[item.name] for item in model.parameters}
        table |= {item.symbol: item.unit or Unit({}) for item in (*model.constants, *model.reported)}
        table |= {state.symbol: parse_unit(state.unit) for state in model.extras}
        table |= {channel.symbol: parse_unit(channel.unit) for channel in model.actuator}
        table |= {s.t: SECOND, s.y: y, s.v: u, s.u: u, s.du: u}
        table |= dict.fromkeys((s.compensator, s.input_scale, *s.braking), Unit({}))
        for block in (s.x, s.xi, s.epsilon, s.r):
            table |= {symbol: y / SECOND**i for i, symbol in enumerate(block)}
        table |= {symbol: y / SECOND**i for i, symbol in enumerate(s.y_r)}
        table |= {symbol: u * SECOND ** (n - i) for i, symbol in enumerate(s.lambda_)}
        for i, row in enumerate(s.Xi):
            table |= {
                entry: y / SECOND**i / stated.get(str(th), Unit({}))
                for entry, th in zip(row, plant.theta, strict=True)
            }
        of_rates = [y / SECOND**i for i in range(n)]  # an observer's errors are those of y and its rates
        of_steps = [y, *input_side[1:]]
        table |= dict(zip(s.z, of_rates if s.observer else of_steps, strict=False))
        table |= {symbol: input_side[i + 1] for i, symbol in enumerate(s.alpha)}
        table |= {symbol: per_second for symbol in (*s.c, *s.ck, *s.observer)}
        if model.measures.si is not None:  # gains mean what they mean in SI units, whatever the columns have
            y, u = map(parse_unit, model.measures.si)
        table |= {
            symbol: per_second if i == 0 else y**2 / (u * SECOND ** (rho - i)) ** 2 / SECOND
            for i, symbol in enumerate(s.e)
        }
        table |= {symbol: SECOND**-i for i, symbol in enumerate(s.k, start=1)}
        self._table = table | adaptation_units(model.adaptation, parse_unit(model.y_unit))

    def of(self, symbol: sp.Symbol) -> Unit:
        """Unit of a signal, gain or parameter.

        Raises:
            KeyError: for a symbol that is no signal of the design.
        """
        return self._table[symbol]


def free(expressions: Iterable[sp.Expr]) -> list[sp.Symbol]:
    """The free symbols of some expressions, in order of their names."""
    found: set[sp.Symbol] = set().union(*(sp.sympify(item).free_symbols for item in expressions))
    return sorted(found, key=lambda symbol: symbol.name)
