"""What holds a run on a kink, in heyoka's expressions: stick, for the reference.

The side s of a kink with the argument g is a run-time parameter. To first order in s, g' = A + B s on g = 0;
heyoka differentiates by s. The kink holds where s = -A/B lies in (-1, 1) and B is negative; the rates with
that s keep g at 0. The loops get theirs from SymPy, before any number is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Rests:
    """The kinks of one model that may hold a run.

    Attributes:
        sides: kink -> the side that holds there.
        systems: kink -> rates of the states there.
    """

    def __init__(
        self,
        heyoka: Any,
        able: Sequence[int],
        arguments: Sequence[Any],
        variables: Sequence[Any],
        right: Sequence[Any],
        first: int,
    ) -> None:
        """Differentiate.

        Args:
            heyoka: the module.
            able: the kinks that may hold.
            arguments: of all kinks, with time as the last variable.
            variables: the states, then time.
            right: rates of the states, over heyoka's own time.
            first: index of the side of kink 0 among the parameters.
        """
        self.sides: Final[dict[int, Any]] = {}
        self.systems: Final[dict[int, list[Any]]] = {}
        self._compiled: Final[dict[int, Any]] = {}
        *states, clock = variables
        for kink in able:
            par, now = heyoka.par[first + kink], {clock: heyoka.time}
            gradient = np.ravel(heyoka.diff_tensors([arguments[kink]], diff_args=list(variables)).jacobian)
            *slopes, drift = (heyoka.subs(entry, now) for entry in gradient)
            rate = drift
            for slope, speed in zip(slopes, right, strict=True):
                rate = rate + slope * speed

            def parts(value: Any, par: Any = par) -> tuple[Any, Any]:
                none = {par: heyoka.expression(0.0)}
                return heyoka.subs(value, none), heyoka.subs(heyoka.diff(value, par), none)

            A, B = parts(rate)
            side = -A / B
            self.sides[kink] = side
            self.systems[kink] = [alone + factor * side for alone, factor in map(parts, right)]
            self._compiled[kink] = heyoka.cfunc([side, B], vars=list(states))

    def holds(self, kink: int, t: float, state: Array, given: Array) -> bool:
        """Whether a kink on whose zero the run stands holds it.

        Args:
            kink: which.
            t: s.
            state: shape (nX,).
            given: parameters, shape (parameters,).
        """
        if kink not in self._compiled:
            return False
        side, pull = self.pull(kink, t, state, given)
        return abs(side) <= 1.0 and pull < 0.0

    def pull(self, kink: int, t: float, state: Array, given: Array) -> tuple[float, float]:
        """The side that would hold the run, and its slope in the argument's rate; see `holds`."""
        compiled = self._compiled[kink]
        side, pull = compiled(state.copy(), pars=given[: compiled.nparams].copy(), time=t)
        return float(side), float(pull)
