"""The closed loop as heyoka integrates it: the derivation's own expressions, events located by heyoka.

Its steps are short, for a step that is sized from derivatives at its start may pass over what is narrow and
lies inside. Short steps too are compared with the right-hand side at points inside: a run that leaves its
equations there is no reference.

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

LONGEST_STEPS: Final = (2e-3, 2e-4)  # s; the shorter one where the longer leaves a run's equations
POINTS: Final = (0.25, 0.5, 0.75, 1.0)  # of a step, where its polynomial is compared with the right-hand side
TRUSTED: Final = 0.1 * ACCURACY  # what a run may leave its equations by: the defect's integral, relative
# What a rate may be rounded by, relative to itself and to sum |df/dX_j| max(1, |X_j|): a hundred operations.
ROUNDING: Final = 3e-14
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


class UntrustedError(ArithmeticError):
    """A run of heyoka's that leaves its own equations between the ends of its steps.

    Attributes:
        t: where the worst step begins, s.
        defect: integral of what it leaves them by, relative.
    """

    def __init__(self, t: float, defect: float) -> None:
        """Record where and by how much."""
        super().__init__(f"leaves its equations by {defect:.3g} in all, most of it near t = {t:.6g} s")
        self.t: Final = t
        self.defect: Final = defect


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
        jacobian = heyoka.diff_tensors(right, diff_args=variables).jacobian
        self._rates = heyoka.cfunc([*right, *np.ravel(jacobian)], vars=variables)
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

        Raises:
            UntrustedError: the trajectory leaves its own equations between the ends of its steps.
        """
        *longer, last = LONGEST_STEPS
        for longest in longer:
            try:
                return self._run(t, start, limit, actuator, longest)
            except UntrustedError:
                continue
        return self._run(t, start, limit, actuator, last)

    def _run(self, t: Array, start: Array, limit: float, actuator: Actuator, longest: float) -> Trajectory:
        """The same, with steps of some length at most."""
        coarse = told_apart(actuator)
        thresholds = coarse.thresholds.tolist()
        mode = int(np.searchsorted(thresholds, self.law(t[:1], start[np.newaxis], limit)[0, 0]))
        solver, crossings = self._solver(len(thresholds))
        crossings.modes, crossings.found = coarse.modes.tolist(), []
        solver.reset_cooldowns()
        solver.time, solver.state[:] = float(t[0]), start
        solver.pars[:] = [*coarse.modes[mode], limit, *thresholds]
        states = np.full((len(t), len(start)), np.nan)
        output = solver.propagate_until(float(t[-1]), max_delta_t=longest, c_output=True)[4]
        reached = 0 if output is None else int(np.searchsorted(t, output.bounds[1], side="right"))
        if reached:
            states[:reached] = output(np.ascontiguousarray(t[:reached]))
        if reached == len(t):
            self._trust(output, [(float(t[0]), mode), *crossings.found], coarse, limit)
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

    def defect(self, output: Any, modes: Array, limit: float) -> Array:
        """By how much every step leaves the equations, shape (steps,): the worst |p' - f| times its length.

        Relative to max(1, |X_i|), beyond what rounding explains.

        Args:
            output: heyoka's continuous output.
            modes: offsets and slopes of every channel, step by step, shape (steps, 2 channels).
            limit: of u.
        """
        powers = np.arange(output.tcs.shape[2])
        lengths = np.diff(output.times)
        worst = np.zeros(len(lengths))
        for part in POINTS:
            tau = part * lengths
            terms = output.tcs * (tau[:, np.newaxis] ** powers)[:, np.newaxis, :]
            states = terms.sum(axis=2)
            # Not by the terms above: a step between two events at one instant has length 0.
            lower = powers[1:] * tau[:, np.newaxis] ** powers[:-1]
            slopes = (output.tcs[:, :, 1:] * lower[:, np.newaxis, :]).sum(axis=2)
            rates, slopes_of_rates = self._of_rates(output.times[:-1] + tau, states, modes, limit)
            sizes = np.maximum(1.0, np.abs(states))
            # Terms of a rate cancel, at high gain most of all.
            terms_of_rates = np.sum(np.abs(slopes_of_rates) * sizes[:, np.newaxis, :], axis=2)
            rounding = ROUNDING * (np.abs(rates) + terms_of_rates)
            beyond = np.maximum(np.abs(slopes - rates) - rounding, 0.0) / sizes
            worst = np.maximum(worst, np.max(beyond, axis=1) * lengths)
        return worst

    def _of_rates(self, t: Array, states: Array, modes: Array, limit: float) -> tuple[Array, Array]:
        """X', shape (rows, nX), and its derivatives with respect to X, shape (rows, nX, nX)."""
        given = np.vstack([modes.T, np.full(len(t), limit)])
        values = self._rates(
            np.ascontiguousarray(states.T),
            pars=np.ascontiguousarray(given[: self._rates.nparams]),
            time=np.ascontiguousarray(t),
        )
        count = len(self.names)
        both = np.asarray(values, dtype=np.float64).T
        return both[:, :count], both[:, count:].reshape(-1, count, count)

    def _trust(self, output: Any, modes: list[tuple[float, int]], actuator: Actuator, limit: float) -> None:
        """Raise `UntrustedError` where a run leaves its equations."""
        began = np.array([t for t, _ in modes])
        labels = np.array([mode for _, mode in modes])
        middles = 0.5 * (output.times[:-1] + output.times[1:])
        along = labels[np.searchsorted(began, middles, side="right") - 1]
        defects = self.defect(output, np.asarray(actuator.modes)[along], limit)
        if not float(np.sum(defects)) <= TRUSTED:
            place = int(np.argmax(np.where(np.isnan(defects), np.inf, defects)))
            raise UntrustedError(float(output.times[place]), float(np.sum(defects)))

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
