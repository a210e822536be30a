"""The closed loop integrated by heyoka: the derivation's own expressions, events located by heyoka.

Its steps are short, because a step sized from derivatives at its start may miss narrow features inside it.
Short steps are also compared with the right-hand side at points inside: a run that deviates from its
equations there is not a valid reference.

What changes from run to run (the limit of u, thresholds of v, the actuator's mode, the sides of kinks) is a
run-time parameter of heyoka's, so many runs need only one compilation; other parameters are numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.check.oracles.heyoka_kinks import UNIT, Kinks, SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.program import Program, compile_program
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, Switches, Trajectory
from pmjoint_codegen.loops.modes import Actuator

Array = npt.NDArray[np.float64]

LONGEST_STEPS: Final = (
    2e-3,
    2e-4,
)  # s; the shorter one if a run with the longer one deviates from its equations
POINTS: Final = (0.25, 0.5, 0.75, 1.0)  # of a step, where its polynomial is compared with the right-hand side
TRUSTED: Final = (
    0.1 * ACCURACY
)  # allowed deviation of a run from its equations: the defect's integral, relative
MOST_FLIPS: Final = 10_000  # of sides in a run; more is sliding by ever shorter steps
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
    """One model's closed loop, prepared for runs from any state, with any limit of u.

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
        equations, time = subject.derivation.equations, subject.derivation.signals.t.name
        rates = [sp.sympify(entry) for entry in kernel.outputs[0][1]]
        program = compile_program([*rates, v], symbols, equations, kernel.given, kernel.sides)
        arguments = compile_program(tuple(kernel.sides), symbols, equations, kernel.given, kernel.sides)
        self.names: Final = tuple(item.name for item in subject.manifest.states)
        self._heyoka: Final = heyoka
        # Offset and slope of every channel, then the sides; the limits come next.
        self._width: Final = len(blocks["g"])
        self._rounding: Final = UNIT * operation_count(program)
        variables = [heyoka.expression(name) for name in self.names]
        known = dict(zip(self.names, variables, strict=True))
        known |= {name: heyoka.expression(value) for name, value in parameters.items()}
        limits = subject.manifest.limit_parameters
        self._count: Final = len(limits)
        known |= {name: heyoka.par[self._width + i] for i, name in enumerate(limits)}
        known |= {symbol.name: heyoka.par[i] for i, symbol in enumerate(blocks["g"])}

        def translated(what: Program, clock: Any) -> list[Any]:
            given = known | {time: clock}
            return what.run(Expressions(heyoka), {one: given[one.name] for one in symbols})

        *right, self._v = translated(program, heyoka.time)
        self._system = list(zip(variables, right, strict=True))
        jacobian = heyoka.diff_tensors(right, diff_args=variables).jacobian
        self._rates = heyoka.cfunc([*right, *np.ravel(jacobian)], vars=variables)
        gradient = heyoka.diff_tensors([self._v], diff_args=variables).gradient
        self._law = heyoka.cfunc([self._v, *gradient], vars=variables)
        self._arguments = translated(arguments, heyoka.time)
        clock = heyoka.expression(time)  # heyoka differentiates by variables, not by its time
        self._kinks = (
            Kinks(
                heyoka,
                translated(arguments, clock),
                [*variables, clock],
                self._of_rates,
                operation_count(program) + operation_count(arguments),
            )
            if kernel.sides
            else None
        )
        self._solvers: dict[int, tuple[Any, _Crossings]] = {}

    def run(self, t: Array, start: Array, limit: float | Sequence[float], actuator: Actuator) -> Trajectory:
        """Integrate, changing mode or side where v crosses a threshold, or a kink's argument zero.

        Args:
            t: output instants, s.
            start: state at the first of them, shape (nX,).
            limit: of u; two where lower and upper limit are.
            actuator: its thresholds of v, and the modes between them.

        Returns:
            The trajectory; NaN from the instant at which heyoka could not continue.

        Raises:
            SlidingError: both sides of a discontinuity point to it.
            UntrustedError: the trajectory deviates from its own equations between the ends of its steps.
        """
        *longer, last = LONGEST_STEPS
        for longest in longer:
            try:
                return self._run(t, start, limit, actuator, longest)
            except SlidingError:
                raise
            except UntrustedError:
                continue
        return self._run(t, start, limit, actuator, last)

    def _run(
        self, t: Array, start: Array, limit: float | Sequence[float], actuator: Actuator, longest: float
    ) -> Trajectory:
        """The same, with a given longest step."""
        coarse = without_narrow_modes(actuator)
        thresholds = coarse.thresholds.tolist()
        mode = int(np.searchsorted(thresholds, self.law(t[:1], start[np.newaxis], limit)[0, 0]))
        solver, crossings = self._solver(len(thresholds))
        given = np.array([*coarse.modes[mode], *[1.0] * self._n_kinks, *np.atleast_1d(limit)])
        if self._kinks is not None:
            given[self._sides] = self._kinks.begin(float(t[0]), start, given)
        crossings.begin(coarse.modes.tolist(), mode, float(t[0]), given)
        solver.reset_cooldowns()
        solver.time, solver.state[:] = float(t[0]), start
        solver.pars[:] = [*given, *thresholds]
        states = np.full((len(t), len(start)), np.nan)
        output = solver.propagate_until(float(t[-1]), max_delta_t=longest, c_output=True)[4]
        if crossings.ended is not None:
            raise crossings.ended
        reached = 0 if output is None else int(np.searchsorted(t, output.bounds[1], side="right"))
        if reached:
            states[:reached] = output(np.ascontiguousarray(t[:reached]))
        if reached == len(t):
            self._trust(output, crossings.along)
        values = np.hstack([states, self.law(t, states, limit)[:, :1]])
        labels = [(time, coarse.labels[place]) for time, place in crossings.found]
        return Trajectory((*self.names, "v"), t, values, _changes(coarse.labels[mode], labels))

    def law(self, t: Array, states: Array, limit: float | Sequence[float]) -> Array:
        """v, and its derivatives with respect to the states, shape (rows, 1 + nX)."""
        given = np.repeat(
            [[value] for value in (*[0.0] * self._width, *np.atleast_1d(limit))], len(t), axis=1
        )  # v depends on neither mode nor side
        values = self._law(
            np.ascontiguousarray(states.T),
            pars=given[: self._law.nparams],
            time=np.ascontiguousarray(t),
        )
        return np.asarray(values, dtype=np.float64).T

    def defect(self, output: Any, given: Array) -> Array:
        """Deviation of every step from the equations, shape (steps,): the worst |p' - f| times its length.

        Relative to max(1, |X_i|), beyond rounding.

        Args:
            output: heyoka's continuous output.
            given: parameters step by step, shape (steps, parameters).

        Raises:
            UntrustedError: a kink's argument is on the wrong side.
        """
        powers = np.arange(output.tcs.shape[2])
        # Rounding of a rate, relative to itself and to sum |df/dX_j| max(1, |X_j|): each operation adds at
        # # most half an ulp of these, and so do the polynomial's sum and its derivative's.
        unit = self._rounding + UNIT * 4 * len(powers)
        lengths = np.diff(output.times)
        worst = np.zeros(len(lengths))
        for part in POINTS:
            tau = part * lengths
            terms = output.tcs * (tau[:, np.newaxis] ** powers)[:, np.newaxis, :]
            states, t = terms.sum(axis=2), output.times[:-1] + tau
            # Not by the terms above: a step between two events at one instant has length 0.
            lower = powers[1:] * tau[:, np.newaxis] ** powers[:-1]
            slopes = (output.tcs[:, :, 1:] * lower[:, np.newaxis, :]).sum(axis=2)
            rates, slopes_of_rates = self._of_rates(t, states, given)
            sizes = np.maximum(1.0, np.abs(states))
            # Terms of a rate cancel, at high gain most of all.
            terms_of_rates = np.sum(np.abs(slopes_of_rates) * sizes[:, np.newaxis, :], axis=2)
            rounding = unit * (np.abs(rates) + terms_of_rates)
            beyond = np.maximum(np.abs(slopes - rates) - rounding, 0.0) / sizes
            worst = np.maximum(worst, np.max(beyond, axis=1) * lengths)
            if self._kinks is not None:
                wrong = self._kinks.wrong(t, states, given) & (lengths > 0.0)
                if np.any(wrong):
                    raise UntrustedError(f"misses a kink near t = {float(t[np.argmax(wrong)]):.6g} s")
        return worst

    def _of_rates(self, t: Array, states: Array, given: Array) -> tuple[Array, Array]:
        """X', shape (rows, nX), and its derivatives with respect to X, shape (rows, nX, nX)."""
        values = self._rates(
            np.ascontiguousarray(states.T),
            pars=np.ascontiguousarray(given.T[: self._rates.nparams]),
            time=np.ascontiguousarray(t),
        )
        count = len(self.names)
        both = np.asarray(values, dtype=np.float64).T
        return both[:, :count], both[:, count:].reshape(-1, count, count)

    def _trust(self, output: Any, along: Sequence[tuple[float, Array]]) -> None:
        """Raise `UntrustedError` if a run deviates from its equations, or leaves a side wrongly."""
        began = np.array([t for t, _ in along])
        given = np.array([parameters for _, parameters in along])
        middles = 0.5 * (output.times[:-1] + output.times[1:])
        defects = self.defect(output, given[np.searchsorted(began, middles, side="right") - 1])
        if not float(np.sum(defects)) <= TRUSTED:
            place = int(np.argmax(np.where(np.isnan(defects), np.inf, defects)))
            raise UntrustedError(
                f"leaves its equations by {float(np.sum(defects)):.3g} in all, "
                f"most of it near t = {float(output.times[place]):.6g} s"
            )

    def scales(self, trajectory: Trajectory, limit: float | Sequence[float]) -> Array:
        """Scales of the errors of a trajectory's entries, shape (rows, columns).

        A state's is max(1, |X_i|). v is a function of the states and amplifies their errors: its scale is
        max(1, |v|) plus the sum of |dv/dX_i| times the state's.
        """
        plain = np.maximum(1.0, np.abs(trajectory.values))
        slopes = np.abs(self.law(trajectory.t, trajectory.values[:, :-1], limit)[:, 1:])
        plain[:, -1] += np.sum(slopes * plain[:, :-1], axis=1)
        return plain

    @property
    def _n_kinks(self) -> int:
        return len(self._arguments)

    @property
    def _sides(self) -> slice:
        """Indices of the sides among the parameters."""
        return slice(self._width - self._n_kinks, self._width)

    def _solver(self, count: int) -> tuple[Any, _Crossings]:
        """A solver for a number of thresholds, and the record that its events use."""
        if count not in self._solvers:
            crossings, first, kinks = _Crossings(), self._width + self._count, self._kinks
            thresholds = [self._heyoka.par[first + place] for place in range(count)]
            events = [(self._v - level, crossings.crossing(i)) for i, level in enumerate(thresholds)]
            if kinks is not None:
                arguments = zip(self._arguments, kinks.moving, strict=True)
                events += [
                    (argument, crossings.flipping(kinks, i))
                    for i, (argument, moving) in enumerate(arguments)
                    if moving
                ]
            solver = self._heyoka.taylor_adaptive(
                self._system,
                [0.0] * len(self.names),
                pars=[0.0] * (first + count),
                t_events=[self._heyoka.t_event(value, callback=callback) for value, callback in events],
            )
            self._solvers[count] = solver, crossings
        return self._solvers[count]


class _Crossings:
    """The data that the events of a solver share with the run.

    Attributes:
        found: (t in s, mode that begins) in order.
        along: (t in s, parameters from there on) in order; the first is the start's.
        ended: why the run ended.
    """

    def __init__(self) -> None:
        """Start without findings."""
        self._modes: list[list[float]] = []
        self.found: list[tuple[float, int]] = []
        self.along: list[tuple[float, Array]] = []
        self.ended: UntrustedError | None = None

    def begin(self, modes: list[list[float]], mode: int, t: float, given: Array) -> None:
        """Prepare for a run.

        Args:
            modes: offsets and slopes of every channel, for every mode.
            mode: the first.
            t: s.
            given: parameters at the start: offsets and slopes, sides, limit.
        """
        self._modes, self.found, self.along, self.ended = modes, [], [(t, given.copy())], None

    def crossing(self, place: int) -> Callable[[Any, int], bool]:
        """The callback for a crossing of a threshold by v: the mode on its other side begins."""

        def crossed(solver: Any, direction: int) -> bool:
            mode = place + 1 if direction > 0 else place
            given = self.along[-1][1].copy()
            given[: len(self._modes[mode])] = self._modes[mode]
            self.found.append((float(solver.time), mode))
            return self._go_on(solver, given)

        return crossed

    def flipping(self, kinks: Kinks, place: int) -> Callable[[Any, int], bool]:
        """The callback for a zero of a kink's argument: its other side begins, unless it points back."""

        def flipped(solver: Any, direction: int) -> bool:
            t, given = float(solver.time), self.along[-1][1].copy()
            try:
                if direction == 0 or len(self.along) > MOST_FLIPS:
                    raise (
                        SlidingError(t) if direction else UntrustedError(f"rests on a kink at t = {t:.6g} s")
                    )
                sides = kinks.flip(place, float(direction), t, np.array(solver.state), given.copy())
            except UntrustedError as error:
                self.ended = error
                return False
            given[len(given) - 1 - kinks.count : len(given) - 1] = sides
            return self._go_on(solver, given)

        return flipped

    def _go_on(self, solver: Any, given: Array) -> bool:
        solver.pars[: len(given)] = given
        self.along.append((float(solver.time), given))
        return True


def operation_count(program: Program) -> int:
    """Roundings of a program at most: one an operation of two numbers, two a function (an ulp)."""
    counts = {"input": 0, "constant": 1}
    return sum(
        len(step.operands) - 1 if step.kind in ("add", "multiply") else counts.get(step.kind, 2)
        for step in program.operations
    )


def without_narrow_modes(actuator: Actuator) -> Actuator:
    """The actuator without modes that are narrower than anything compared here.

    Coinciding limits of two channels may round to different thresholds. No event can be located between them;
    w is continuous in v, so omitting the mode between them changes w as little.
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
    """The crossings at which u enters or leaves a limit; those of other channels only are omitted."""
    before = [label, *(later for _, later in found)]
    return tuple(item for item, earlier in zip(found, before, strict=False) if item[1] != earlier)
