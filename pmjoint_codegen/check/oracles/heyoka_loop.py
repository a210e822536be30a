"""The closed loop integrated by heyoka: the derivation's own expressions, events located by heyoka.

Its steps are short, because a step sized from derivatives at its start may miss narrow features inside it.
Short steps are also compared with the right-hand side at points inside: a run that deviates from its
equations there is not a valid reference.

What changes from run to run (the limit of u, thresholds of v, the actuator's mode, the sides of kinks) is a
run-time parameter of heyoka's, so many runs need only one compilation; other parameters are numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.check.oracles.heyoka_events import MOST_FLIPS, Crossings, Deviation
from pmjoint_codegen.check.oracles.heyoka_expressions import Expressions
from pmjoint_codegen.check.oracles.heyoka_kinks import UNIT, Kinks, SlidingError, UntrustedError
from pmjoint_codegen.check.oracles.heyoka_rests import Rests
from pmjoint_codegen.check.oracles.program import Program, compile_program, operation_count
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.check.trajectory import ACCURACY, Switches, Trajectory
from pmjoint_codegen.emit.stick import NEVER
from pmjoint_codegen.loops.modes import Actuator
from pmjoint_codegen.reference.segments import inside
from pmjoint_codegen.simulate.settings import make_settings

Array = npt.NDArray[np.float64]

LONGEST_STEPS: Final = (2e-3, 2e-4)  # s; the shorter one if a run with the longer one deviates
MOST_STEPS: Final = 200_000  # twice as many as the short ones; heyoka may meet one event over and over
HORIZON: Final = 20.0  # s: steps of a longer run, as a ship's, are longer in proportion
POINTS: Final = (0.25, 0.5, 0.75, 1.0)  # of a step, where its polynomial is compared with the right-hand side
ONE_THRESHOLD: Final = 1e-3 * ACCURACY  # relative distance below which two thresholds are one

FREE: Final = -1  # no kink holds
# s within which an event is not found twice. heyoka's own (-1) is 0 where a kink lets go, at a rate of 0.
COOLDOWN: Final = (-1.0, 1e-9)  # of a threshold of v, of a kink


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
        self._segments: Final = make_settings(subject.manifest).reference
        first = self._first = subject.manifest.segment  # the reference's segment comes before all of these
        variables = [heyoka.expression(name) for name in self.names]
        known = dict(zip(self.names, variables, strict=True))
        known |= {name: heyoka.expression(value) for name, value in parameters.items()}
        limits = subject.manifest.limit_parameters
        self._count: Final = len(limits)
        known |= {name: heyoka.par[first + self._width + i] for i, name in enumerate(limits)}
        known |= {symbol.name: heyoka.par[first + i] for i, symbol in enumerate(blocks["g"])}
        known |= (
            {item.name: heyoka.par[i] for i, item in enumerate(subject.manifest.parameters[-first:])}
            if first
            else {}
        )

        def translated(what: Program, clock: Any) -> list[Any]:
            given = known | {time: clock}
            return what.run(Expressions(heyoka), {one: given[one.name] for one in symbols})

        *right, self._v = translated(program, heyoka.time)
        self._system = list(zip(variables, right, strict=True))
        jacobian = heyoka.diff_tensors(right, diff_args=variables).jacobian
        self._rates = {FREE: heyoka.cfunc([*right, *np.ravel(jacobian)], vars=variables)}
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
                first + self._width - len(kernel.sides),
            )
            if kernel.sides
            else None
        )
        holds = dict(subject.table["holds"].outputs)["value"] if "holds" in subject.table else ()
        self._rests: Final = Rests(
            heyoka,
            [kink for kink, side in enumerate(holds) if side != NEVER],
            translated(arguments, clock),
            [*variables, clock],
            right,
            first + self._width - len(kernel.sides),
        )
        self._solvers: dict[tuple[int, int], tuple[Any, Crossings]] = {}

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
        slow = max(1.0, float(t[-1]) / HORIZON)
        *longer, last = (slow * longest for longest in LONGEST_STEPS)
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
        limits = np.atleast_1d(limit)
        given = np.array([*self._row(float(t[0])), *coarse.modes[mode], *[1.0] * self._n_kinks, *limits])
        held, found, deviation = (
            self._begin(float(t[0]), start, given),
            list[tuple[float, int]](),
            Deviation(),
        )
        states = np.full((len(t), len(start)), np.nan)
        time, state, now = float(t[0]), start, mode
        breaks = [] if self._segments is None else inside(self._segments, float(t[-1]))[0].tolist()
        ends, left = [*breaks, float(t[-1])], FREE
        for _ in range(MOST_FLIPS):  # of the reference, or between stick and slip
            solver, crossings = self._solver(len(thresholds), held)
            crossings.begin(coarse.modes.tolist(), now, time, given, self._first, left)
            solver.reset_cooldowns()
            solver.time, solver.state[:] = time, state
            solver.pars[:] = [*given, *thresholds]
            outcome = solver.propagate_until(
                ends[0], max_delta_t=longest, c_output=True, max_steps=MOST_STEPS
            )
            if outcome[0] == self._heyoka.taylor_outcome.step_limit:
                raise UntrustedError(f"does not pass t = {float(solver.time):.6g} s")
            output = outcome[4]
            if crossings.ended is not None:
                raise crossings.ended
            found += crossings.found
            reached = time if output is None else float(output.bounds[1])
            rows = (t >= time) & (t <= reached)
            if output is not None and np.any(rows):
                states[rows] = output(np.ascontiguousarray(t[rows]))
            arrived = reached >= ends[0] and np.all(np.isfinite(solver.state))
            if not arrived and crossings.rest is None:
                break
            if output is not None:
                self._note_deviation(deviation, output, crossings.along, held)
            time, state, now = float(solver.time), np.array(solver.state), crossings.mode
            given = crossings.along[-1][1].copy()
            if crossings.rest is not None:
                deviation.trust()
                before, held = held, self._rest(crossings.rest, held, given)
                left = before if held == FREE else FREE
                continue
            left = FREE
            del ends[0]
            if not ends:
                deviation.trust()
                break
            given[: self._first] = self._row(time)
            v = self.law(np.array([time]), state[np.newaxis], limit)[0, 0]
            after = int(np.searchsorted(thresholds, v))
            if after != now:
                given[self._first : self._sides.start] = coarse.modes[after]
                found.append((time, after))
                now = after
            side = 0.0 if held == FREE else self._rests.pull(held, time, state, given)[0]
            if not abs(side) < 1.0:  # u has jumped with the reference, and the kink lets go
                held = self._rest((held, np.copysign(1.0, side)), held, given)
        values = np.hstack([states, self.law(t, states, limit)[:, :1]])
        labels = [(time, coarse.labels[place]) for time, place in found]
        return Trajectory((*self.names, "v"), t, values, _changes(coarse.labels[mode], labels))

    def _begin(self, t: float, start: Array, given: Array) -> int:
        """Set the sides at the start; the kink that holds the run there, or `FREE`."""
        if self._kinks is None:
            return FREE
        arguments = self._kinks.values(np.array([t]), start[np.newaxis], given[np.newaxis])[0][0]
        for kink in np.flatnonzero(arguments == 0.0).tolist():
            if self._rests.holds(kink, t, start, given):
                return self._rest((kink, 0.0), FREE, given)
        given[self._sides] = self._kinks.begin(t, start, given)
        return FREE

    def _rest(self, change: tuple[int, float], held: int, given: Array) -> int:
        """A kink begins to hold the run, with the side 0, or lets go to another; gives the one that holds."""
        kink, side = change
        given[self._sides.start + kink] = side
        return FREE if held == kink else kink

    def _row(self, t: float) -> Array:
        """Parameters of the reference's segment at an instant; empty if it is an expression."""
        found: Array = self._rows(np.array([t]))[0]
        return found

    def _rows(self, t: Array) -> Array:
        if self._segments is None:
            return np.empty((len(t), 0))
        found: Array = self._segments.rows[self._segments.places(t)]
        return found

    def law(self, t: Array, states: Array, limit: float | Sequence[float]) -> Array:
        """v, and its derivatives with respect to the states, shape (rows, 1 + nX)."""
        others = np.zeros((self._width + self._count, len(t)))  # v depends on neither mode nor side
        others[self._width :] = np.atleast_1d(limit)[:, np.newaxis]
        given = np.ascontiguousarray(np.concatenate([self._rows(t).T, others]))
        values = self._law(
            np.ascontiguousarray(states.T),
            pars=given[: self._law.nparams],
            time=np.ascontiguousarray(t),
        )
        return np.asarray(values, dtype=np.float64).T

    def defect(self, output: Any, given: Array, held: int) -> Array:
        """Deviation of every step from the equations, shape (steps,): the worst |p' - f| times its length.

        Relative to max(1, |X_i|), beyond rounding.

        Args:
            output: heyoka's continuous output.
            given: parameters step by step, shape (steps, parameters).
            held: the kink that holds the run, or `FREE`.

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
            rates, slopes_of_rates = self._of_rates(t, states, given, held)
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

    def _of_rates(self, t: Array, states: Array, given: Array, held: int = FREE) -> tuple[Array, Array]:
        """X', shape (rows, nX), and its derivatives with respect to X, shape (rows, nX, nX)."""
        compiled = self._rates[held]
        values = compiled(
            np.ascontiguousarray(states.T),
            pars=np.ascontiguousarray(given.T[: compiled.nparams]),
            time=np.ascontiguousarray(t),
        )
        count = len(self.names)
        both = np.asarray(values, dtype=np.float64).T
        return both[:, :count], both[:, count:].reshape(-1, count, count)

    def _note_deviation(
        self, deviation: Deviation, output: Any, along: Sequence[tuple[float, Array]], held: int
    ) -> None:
        """Add a part of a run's deviation; raise `UntrustedError` if it leaves a side wrongly."""
        began = np.array([t for t, _ in along])
        given = np.array([parameters for _, parameters in along])
        middles = 0.5 * (output.times[:-1] + output.times[1:])
        places = np.maximum(np.searchsorted(began, middles, side="right") - 1, 0)
        deviation.add(output.times, self.defect(output, given[places], held))

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
        return slice(self._first + self._width - self._n_kinks, self._first + self._width)

    def _solver(self, count: int, held: int) -> tuple[Any, Crossings]:
        """A solver for a number of thresholds and a kink that holds, and the record that its events use."""
        if held not in self._rates:
            right, variables = self._rests.systems[held], [variable for variable, _ in self._system]
            jacobian = self._heyoka.diff_tensors(right, diff_args=variables).jacobian
            self._rates[held] = self._heyoka.cfunc([*right, *np.ravel(jacobian)], vars=variables)
        if (count, held) not in self._solvers:
            crossings, first, kinks = Crossings(), self._first + self._width + self._count, self._kinks
            thresholds = [self._heyoka.par[first + place] for place in range(count)]
            events = [(self._v - level, crossings.crossing(i)) for i, level in enumerate(thresholds)]
            if kinks is not None:
                arguments = zip(self._arguments, kinks.moving, strict=True)
                events += [
                    (argument, crossings.flipping(kinks, self._rests if held == FREE else None, i))
                    for i, (argument, moving) in enumerate(arguments)
                    if moving and i != held
                ]
            system = self._system
            if held != FREE:
                ends = [(self._rests.sides[held] - end, end) for end in (-1.0, 1.0)]
                events += [(value, crossings.letting_go(held, end)) for value, end in ends]
                variables = [variable for variable, _ in self._system]
                system = list(zip(variables, self._rests.systems[held], strict=True))
            solver = self._heyoka.taylor_adaptive(
                system,
                [0.0] * len(self.names),
                pars=[0.0] * (first + count),
                t_events=[
                    self._heyoka.t_event(value, callback=callback, cooldown=COOLDOWN[i >= count])
                    for i, (value, callback) in enumerate(events)
                ],
            )
            self._solvers[count, held] = solver, crossings
        return self._solvers[count, held]


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
