"""A plant as people write it: rates of its own states, an input and an output.

``s' = f(s) + g(s) u``, ``y = h(s)``, with f, g and h functions of the states and of parameters. `split` takes
rates in which u stands wherever the author put it; what is not of this form is refused with the term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from pmjoint_derive.dependence import settled
from pmjoint_derive.equation import real_symbol
from pmjoint_derive.model import OutsideClassError
from pmjoint_derive.shield import shielded

U, Y = real_symbol("u"), real_symbol("y")


@dataclass(frozen=True)
class Physics:
    """``s' = f(s) + g(s) u``, ``y = h(s)``.

    Attributes:
        states: n symbols s.
        drift: n functions f of the states.
        gain: n functions g of the states.
        output: h, a function of the states.
    """

    states: tuple[sp.Symbol, ...]
    drift: tuple[sp.Expr, ...]
    gain: tuple[sp.Expr, ...]
    output: sp.Expr

    @property
    def hidden(self) -> tuple[sp.Symbol, ...]:
        """The states that are not measured: all but the output, where that is a state."""
        return tuple(state for state in self.states if state != self.output)

    def along(self, form: sp.Expr) -> sp.Expr:
        """Rate of a function of the states at u = 0: its Lie derivative along f."""
        return lie(form, self.states, self.drift)

    def driven(self, form: sp.Expr) -> sp.Expr:
        """What multiplies u in that rate: the Lie derivative along g."""
        return lie(form, self.states, self.gain)


def lie(form: sp.Expr, states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> sp.Expr:
    """Total derivative of a function of some states along their rates."""
    terms = (sp.diff(form, state) * rate for state, rate in zip(states, rates, strict=True) if rate != 0)
    return sum(terms, sp.Integer(0))


def split(states: tuple[sp.Symbol, ...], rates: tuple[sp.Expr, ...], output: sp.Expr) -> Physics:
    """Part rates into f and g.

    Args:
        states: n symbols.
        rates: n functions of states, u and parameters.
        output: of states, u and parameters.

    Raises:
        OutsideClassError: u in the output, or a rate that is not affine in u; naming the term.
    """
    if settled(sp.diff(output, U), (U, *states)) != 0:
        raise OutsideClassError(
            "system.output",
            f"u acts on the output at once, in {output}: a direct feedthrough",
            "measure a quantity that does not jump with u, or add the lag of sensor or actuator as a state",
        )
    for i, rate in enumerate(rates, start=1):
        if settled(sp.diff(rate, U, 2), (U, *states)) != 0:
            bent = [term for term in terms_of(rate, states) if sp.diff(term, U, 2) != 0]
            raise OutsideClassError(
                f"system.rates, entry {i}",
                f"{bent[0] if bent else rate} is not linear in the input",
                "redefine the input so that it is, such as w = i**2 for the current of a magnet",
            )
    nothing = {U: sp.Integer(0)}
    return Physics(
        states,
        tuple(rate.xreplace(nothing) for rate in rates),
        tuple(sp.diff(rate, U).xreplace(nothing) for rate in rates),
        output.xreplace(nothing),
    )


def terms_of(value: sp.Expr, states: Sequence[sp.Symbol]) -> tuple[sp.Expr, ...]:
    """The summands of a rate, multiplied out except inside functions."""
    return tuple(sp.Add.make_args(shielded(sp.expand, value, (*states, U))))
