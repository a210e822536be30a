"""The closed loop as heyoka integrates it: the derivation's own expressions, events located by heyoka.

What changes from run to run (the limit of u, thresholds of v, the actuator's mode) is a run-time parameter of
heyoka's, so that many runs need one compilation; other parameters are numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.check.golden import ACCURACY, Switches, Trajectory
from pmjoint_codegen.check.program import compile_program
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.simulate.modes import Actuator

Array = npt.NDArray[np.float64]

ONE_THRESHOLD: Final = 1e-3 * ACCURACY  # relative distance below which two thresholds are one


class Expressions:
    """heyoka's expressions as an algebra for a program of named equations."""

    def __init__(self, heyoka: Any) -> None:
        self._heyoka = heyoka

    def constant(self, value: sp.Expr) -> Any:
        """The nearest double."""
        return self._heyoka.expression(
            float(sp.Rational(value).p / sp.Rational(value).q if value.is_Rational else value)
        )

    def add(self, a: Any, b: Any) -> Any:
        """Sum."""
        return a + b

    def multiply(self, a: Any, b: Any) -> Any:
        """Product."""
        return a * b

    def power(self, a: Any, exponent: sp.Rational) -> Any:
        """Power."""
        return a ** float(exponent)

    def apply(self, function: str, *arguments: Any) -> Any:
        """A named function."""
        return getattr(self._heyoka, function)(*arguments)


class Loop:
    """One model's closed loop, made ready for runs from any state, with any limit of u.

    Attributes:
        names: of the states.
    """

    def __init__(self, heyoka: Any, subject: Subject, parameters: Mapping[str, float]) -> None:
        """Translate rates and v from the derivation.

        Args:
            heyoka: the module.
            subject: the model.
            parameters: value of every parameter and gain; that of the limit may change from run to run.
        """
        kernel, v = subject.table["closed_loop"], subject.derivation.signals.v
        blocks = dict(kernel.inputs)
        symbols = [symbol for block in blocks.values() for symbol in block]
        rates = [sp.sympify(entry) for entry in kernel.outputs[0][1]]
        program = compile_program(
            [*rates, v], symbols, subject.derivation.equations, kernel.given, kernel.sides
        )
        self.names: Final = tuple(item.name for item in subject.manifest.states)
        self._heyoka: Final = heyoka
        self._width: Final = len(blocks["g"])  # offset and slope of every channel; then comes the limit
        variables = [heyoka.expression(name) for name in self.names]
        known = dict(zip(self.names, variables, strict=True))
        known |= {name: heyoka.expression(value) for name, value in parameters.items()}
        known[subject.manifest.limit] = heyoka.par[self._width]
        known |= {symbol.name: heyoka.par[i] for i, symbol in enumerate(blocks["g"])}
        known[subject.derivation.signals.t.name] = heyoka.time
        *right, self._v = program.run(Expressions(heyoka), {one: known[one.name] for one in symbols})
        self._system = list(zip(variables, right, strict=True))
        gradient = heyoka.diff_tensors([self._v], diff_args=variables).gradient
        self._law = heyoka.cfunc([self._v, *gradient], vars=variables)
        self._solvers: dict[int, tuple[Any, _Crossings]] = {}

    def run(self, t: Array, start: Array, limit: float, actuator: Actuator) -> Trajectory:
        """Integrate, changing the actuator's mode where v crosses a threshold.

        Args:
            t: instants that are asked for, s.
            start: state at the first of them, shape (nX,).
            limit: of u.
            actuator: which values of v are thresholds, and what lies between them.

        Returns:
            The trajectory; NaN from where heyoka could not go on.
        """
        coarse = told_apart(actuator)
        thresholds = coarse.thresholds.tolist()
        mode = int(np.searchsorted(thresholds, self.law(t[:1], start[np.newaxis], limit)[0, 0]))
        solver, crossings = self._solver(len(thresholds))
        crossings.modes, crossings.found = coarse.modes.tolist(), []
        solver.reset_cooldowns()
        solver.time, solver.state[:] = float(t[0]), start
        solver.pars[:] = [*coarse.modes[mode], limit, *thresholds]
        states = np.full((len(t), len(start)), np.nan)
        reached = np.asarray(solver.propagate_grid(np.ascontiguousarray(t))[-1])
        states[: len(reached)] = reached
        values = np.hstack([states, self.law(t, states, limit)[:, :1]])
        labels = [(time, coarse.labels[place]) for time, place in crossings.found]
        return Trajectory((*self.names, "v"), t, values, _changes(coarse.labels[mode], labels))

    def law(self, t: Array, states: Array, limit: float) -> Array:
        """v, and its derivatives with respect to the states, shape (rows, 1 + nX)."""
        given = np.repeat([[0.0]] * self._width + [[limit]], len(t), axis=1)  # v knows no mode
        values = self._law(
            np.ascontiguousarray(states.T),
            pars=given[: self._law.nparams],
            time=np.ascontiguousarray(t),
        )
        return np.asarray(values, dtype=np.float64).T

    def scales(self, trajectory: Trajectory, limit: float) -> Array:
        """What the entries of a trajectory are held relative to, shape (rows, columns).

        A state's is max(1, |X_i|). v is a function of the states, which multiplies what they are off by: its
        scale is max(1, |v|) and, on top of it, the sum of |dv/dX_i| times the state's.
        """
        plain = np.maximum(1.0, np.abs(trajectory.values))
        slopes = np.abs(self.law(trajectory.t, trajectory.values[:, :-1], limit)[:, 1:])
        plain[:, -1] += np.sum(slopes * plain[:, :-1], axis=1)
        return plain

    def _solver(self, count: int) -> tuple[Any, _Crossings]:
        """A solver for a number of thresholds, and what its events read and fill."""
        if count not in self._solvers:
            crossings, first = _Crossings([], []), self._width + 1
            thresholds = [self._heyoka.par[first + place] for place in range(count)]
            solver = self._heyoka.taylor_adaptive(
                self._system,
                [0.0] * len(self.names),
                pars=[0.0] * (first + count),
                t_events=[
                    self._heyoka.t_event(self._v - threshold, callback=crossings.event(place))
                    for place, threshold in enumerate(thresholds)
                ],
            )
            self._solvers[count] = solver, crossings
        return self._solvers[count]


@dataclass
class _Crossings:
    """What the events of a solver share with the run that goes on.

    Attributes:
        modes: offsets and slopes of every channel, for every mode.
        found: (t in s, mode that begins) in order.
    """

    modes: list[list[float]]
    found: list[tuple[float, int]]

    def event(self, place: int) -> Callable[[Any, int], bool]:
        """What happens where v crosses a threshold: the mode on its other side begins."""

        def crossed(solver: Any, direction: int) -> bool:
            mode = place + 1 if direction > 0 else place
            solver.pars[: len(self.modes[mode])] = self.modes[mode]
            self.found.append((float(solver.time), mode))
            return True

        return crossed


def told_apart(actuator: Actuator) -> Actuator:
    """The actuator without modes that are narrower than anything held here.

    Limits of two channels that follow one another are thresholds which round apart. No event can be located
    between them; w is continuous in v, so that leaving the mode between out changes w by as little.
    """
    at = actuator.thresholds
    last = [
        i
        for i in range(len(at))
        if i + 1 == len(at) or at[i + 1] - at[i] > ONE_THRESHOLD * max(1.0, abs(at[i]), abs(at[i + 1]))
    ]
    modes = [0, *(i + 1 for i in last)]
    return Actuator(
        actuator.limits, at[last], actuator.modes[modes], tuple(actuator.labels[i] for i in modes)
    )


def _changes(label: int, found: list[tuple[float, int]]) -> Switches:
    """The crossings at which u enters or leaves a limit; those of other channels alone are left out."""
    before = [label, *(later for _, later in found)]
    return tuple(item for item, earlier in zip(found, before, strict=False) if item[1] != earlier)
