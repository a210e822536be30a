"""The kinks of a model in heyoka's loop: arguments of ``abs`` and ``sign``, and their sides.

Sides are run-time parameters, like the actuator's mode. Events locate the zeros of an argument. This module
finds the rest: the sides at the start, whether both sides point back to the kink, and whether an argument was
on the wrong side without an event.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Rates = Callable[[Array, Array, Array], tuple[Array, Array]]

UNIT: Final = 2.0**-53  # half an ulp of 1: relative rounding of one operation


class UntrustedError(ArithmeticError):
    """A heyoka run that cannot serve as reference; its message states why, to be read after "it"."""


class SlidingError(UntrustedError):
    """A run that ends at a discontinuity because the rates on both sides point to it.

    Attributes:
        t: when, s.
    """

    def __init__(self, t: float) -> None:
        """Record when."""
        super().__init__(f"is stuck to a kink at t = {t:.6g} s")
        self.t: Final = t


class Kinks:
    """The arguments of one model's kinks, evaluated by heyoka.

    Attributes:
        count: number of kinks, k.
        moving: for each, whether its argument can change within a run.
        sides: their places among the parameters.
    """

    def __init__(
        self,
        heyoka: Any,
        arguments: Sequence[Any],
        variables: Sequence[Any],
        rates: Rates,
        operations: int,
        first: int,
    ) -> None:
        """Compile the arguments and their gradients.

        Args:
            heyoka: the module.
            arguments: of the kinks, with time as the last variable.
            variables: the states, then time.
            rates: (t, X, parameters) -> X' and its derivatives.
            operations: number of operations in the arguments.
            first: index of the first side among the parameters.
        """
        self.count: Final = len(arguments)
        self.moving: Final = tuple(bool(heyoka.get_variables(argument)) for argument in arguments)
        self.sides: Final = slice(first, first + len(arguments))
        self._rates: Final = rates
        self._rounding: Final = UNIT * operations
        self._size: Final = len(variables)
        gradient = heyoka.diff_tensors(list(arguments), diff_args=list(variables)).jacobian
        self._compiled: Final = heyoka.cfunc([*arguments, *np.ravel(gradient)], vars=list(variables))

    def values(self, t: Array, states: Array, given: Array) -> tuple[Array, Array, Array]:
        """Arguments, their rates, and bounds on their rounding, each of shape (rows, k).

        Args:
            t: instants, s, shape (rows,).
            states: shape (rows, nX).
            given: parameters: offsets and slopes, sides, limit; shape (rows, parameters).
        """
        found = np.asarray(
            self._compiled(
                np.ascontiguousarray(np.column_stack([states, t]).T),
                pars=np.ascontiguousarray(given.T[: self._compiled.nparams]),
            ),
            dtype=np.float64,
        ).T
        arguments = found[:, : self.count]
        slopes = found[:, self.count :].reshape(-1, self.count, self._size)
        speeds = np.column_stack([self._rates(t, states, given)[0], np.ones(len(t))])
        sizes = np.maximum(1.0, np.abs(np.column_stack([states, t])))
        rates = np.einsum("rkj,rj->rk", slopes, speeds)
        terms = np.einsum("rkj,rj->rk", np.abs(slopes), sizes)
        # An event's time is rounded too: by then the states have moved.
        late = np.einsum("rkj,rj->rk", np.abs(slopes), np.abs(speeds)) * sizes[:, -1:]
        return arguments, rates, self._rounding * (np.abs(arguments) + terms + late)

    def begin(self, t: float, start: Array, given: Array) -> Array:
        """The sides at the start: an argument of 0 is on the side to which it goes.

        Args:
            t: s.
            start: state, shape (nX,).
            given: parameters, shape (parameters,); their sides are not used.

        Raises:
            SlidingError: it goes to neither.
            UntrustedError: it stays at 0 to first order, and no event would show when it leaves.
        """
        sides = np.ones(self.count)
        place = self.sides
        for _ in range(2 * self.count + 2):  # an argument depends on the sides before its own
            given[place] = sides
            arguments, rates = (row[0] for row in self.values(*_one(t, start, given))[:2])
            if np.any((arguments == 0.0) & (rates == 0.0) & self.moving):
                raise UntrustedError(f"rests on a kink at t = {t:.6g} s")
            now = np.where(np.where(arguments == 0.0, rates, arguments) < 0.0, -1.0, 1.0)
            if np.array_equal(now, sides):
                return sides
            sides = now
        raise SlidingError(t)

    def flip(self, kink: int, side: float, t: float, state: Array, given: Array) -> Array:
        """The sides after an event: that of its kink, and of those whose arguments jump with it.

        Args:
            kink: which.
            side: the new one, +1 or -1.
            t: s.
            state: shape (nX,).
            given: parameters up to here, shape (parameters,).

        Raises:
            SlidingError: the rates beyond point back.
        """
        place = self.sides
        sides = given[place].copy()
        sides[kink] = side
        for _ in range(self.count):
            given[place] = sides
            arguments, rates, rounding = (row[0] for row in self.values(*_one(t, state, given)))
            clear = np.abs(arguments) > rounding
            clear[kink] = False
            sides = np.where(clear, np.sign(arguments), sides)
        if rates[kink] * side < 0.0:
            raise SlidingError(t)
        return sides

    def wrong(self, t: Array, states: Array, given: Array) -> npt.NDArray[np.bool_]:
        """Where an argument is on the wrong side by more than rounding, shape (rows,)."""
        arguments, _, rounding = self.values(t, states, given)
        sides = given[:, self.sides]
        off: npt.NDArray[np.bool_] = ~np.all(arguments * sides >= -rounding, axis=1)
        return off


def _one(t: float, state: Array, given: Array) -> tuple[Array, Array, Array]:
    return np.array([t]), state[np.newaxis], given[np.newaxis]
