"""A derivation in numbers of many digits, equation by equation."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mpmath
import sympy as sp

from pmjoint_derive import Derivation
from pmjoint_derive.adaptation import settings_of
from pmjoint_derive.signals import derivative_name
from pmjoint_derive.units import parse_unit

Step = tuple[Callable[..., Any], tuple[str, ...]]


class Steps(dict[str, Step]):
    """Function and argument names of each equation, compiled when it is first asked for."""

    def __init__(self, derivation: Derivation) -> None:
        super().__init__()
        self._equations = derivation.equations

    def __missing__(self, name: str) -> Step:
        item = self._equations[name]
        symbols = sorted(item.expression.free_symbols, key=str)
        dummies = [sp.Dummy() for _ in symbols]  # a name may be a word of Python, as lambda is
        value = item.expression.xreplace(dict(zip(symbols, dummies, strict=True)))
        self[name] = sp.lambdify(dummies, value, "mpmath"), tuple(symbol.name for symbol in symbols)
        return self[name]


class Values(dict[str, Any]):
    """Mpmath numbers by name, each computed when it is first asked for."""

    def __init__(self, steps: Steps, point: Mapping[str, Any]) -> None:
        super().__init__(point)
        self._steps = steps

    def __missing__(self, name: str) -> Any:
        function, arguments = self._steps[name]
        self[name] = function(*(self[argument] for argument in arguments))
        return self[name]


@dataclass(frozen=True)
class Numbers:
    """The continuous loop of a derivation.

    Attributes:
        derivation: what is evaluated.
        steps: its equations as functions.
    """

    derivation: Derivation
    steps: Steps

    @classmethod
    def of(cls, derivation: Derivation) -> Numbers:
        """Compile nothing yet."""
        return cls(derivation, Steps(derivation))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of all states of the loop."""
        s = self.derivation.signals
        return tuple(symbol.name for symbol in (*s.x, *s.controller_state))

    def at(self, point: Mapping[str, Any]) -> Values:
        """Equations at a point, when asked for; a name that the point gives, such as u, is not computed."""
        return Values(self.steps, point)

    def along(self, name: str, point: Mapping[str, Any], step: Any) -> Any:
        """Rate of a named quantity along the loop with t moving, by its values before and after."""
        here = self.at(point)
        rates = {state: here[derivative_name(sp.Symbol(state))] for state in self.states} | {"t": 1}

        def moved(h: Any) -> Any:
            return self.at({**point, **{key: point[key] + h * rate for key, rate in rates.items()}})[name]

        return (moved(step) - moved(-step)) / (2 * step)


def drawn(derivation: Derivation, seed: int) -> dict[str, Any]:
    """Draw states, gains and u; parameters and what belongs to estimates have the model's values."""
    draw, s, model = random.Random(seed), derivation.signals, derivation.model

    def number(low: float, high: float) -> Any:
        return mpmath.mpf(draw.randint(round(low * 1000), round(high * 1000))) / 1000

    point = {item.name: mpmath.mpf(item.value) for item in model.parameters}
    point |= {item.symbol.name: mpmath.mpf(item.value) for item in _settings(derivation)}
    states = (s.t, s.u, *s.x, *s.controller_state)
    point |= {symbol.name: number(-1.5, 1.5) for symbol in states}
    for symbols in s.gains_by_kind.values():
        point |= {symbol.name: number(0.5, 2.0) for symbol in symbols}
    point |= {s.compensator.name: mpmath.mpf(1), s.input_scale.name: number(0.5, 2.0)}
    if model.adaptation is not None:
        for entry in model.adaptation.unknown:
            place = number(0.1, 0.9)
            if entry.range is None:
                point[entry.estimate.name] = entry.guess - 0.5 + place
            else:  # its state is its logit, less that of the guess
                low, high = map(mpmath.mpf, entry.range)
                start = (entry.guess - low) / (high - entry.guess)
                point[entry.state.name] = mpmath.log(place / (1 - place)) - mpmath.log(start)
            point[entry.gamma.name] = number(0.5, 2.0)
    return point


def _settings(derivation: Derivation) -> list[Any]:
    return list(settings_of(derivation.model.adaptation, parse_unit(derivation.model.y_unit)))
