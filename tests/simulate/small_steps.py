"""The closed loop by small steps: SciPy's DOP853 on the derivation's own expressions, for comparison.

It shares the symbolic derivation with what it is compared with, and nothing else: no CasADi, no Taylor
recurrence, no guard. It is told where narrow features are, and never takes more than an eighth of one's width
while near; saturation and kinks are located on its dense output, and the step is then taken again up to
there, so that no step crosses one.

Friction is told apart: its ``sign(x2)`` with the side 0 leaves the other forces, A. At x2 = 0 the joint rests
as long as |A| is less than what friction holds there, which is given as a number; x2' is then 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import sympy as sp
from scipy.integrate import DOP853
from scipy.optimize import brentq

from pmjoint_codegen.check.oracles.program import compile_program
from pmjoint_codegen.check.subject import Subject

Array = npt.NDArray[np.float64]
Rates = Callable[[float, Any, Sequence[float]], tuple[list[float], list[float]]]

LONGEST = 2e-3  # s
REACH = 8.0  # widths from its place within which a feature counts: exp(-64), 1 - tanh(8)
FLIPS = 8  # at one instant; more is sliding along a discontinuity
INSIDE = (0.25, 0.5, 0.75, 1.0)  # of a step, where the sides are looked at


class SlidingError(ArithmeticError):
    """Both sides of a discontinuity point back to it."""


@dataclass(frozen=True)
class Feature:
    """Something narrow.

    Attributes:
        over: ``t``, ``x1`` or ``x2``.
        place: s, rad or rad/s.
        width: s, rad or rad/s.
    """

    over: str
    place: float
    width: float

    def room(self, at: float) -> float:
        """How far one may go from here at once."""
        return max(abs(at - self.place) - REACH * self.width, self.width / 8)


class Text:
    """An algebra that writes Python; what depends on parameters alone is written apart."""

    def __init__(self) -> None:
        self.lines: dict[bool, list[str]] = {False: [], True: []}

    def _named(self, text: str, *operands: tuple[str, bool]) -> tuple[str, bool]:
        varies = any(operand[1] for operand in operands)
        name = f"{'v' if varies else 'c'}{len(self.lines[varies])}"
        self.lines[varies].append(f"{name} = {text}")
        return name, varies

    def constant(self, value: sp.Expr) -> tuple[str, bool]:
        return f"({float(value)!r})", False

    def add(self, a: Any, b: Any) -> tuple[str, bool]:
        return self._named(f"{a[0]} + {b[0]}", a, b)

    def multiply(self, a: Any, b: Any) -> tuple[str, bool]:
        return self._named(f"{a[0]} * {b[0]}", a, b)

    def power(self, a: Any, exponent: sp.Rational) -> tuple[str, bool]:
        return self._named(f"{a[0]} ** {int(exponent) if exponent.is_Integer else float(exponent)!r}", a)

    def apply(self, function: str, *arguments: Any) -> tuple[str, bool]:
        return self._named(f"{function}({', '.join(name for name, _ in arguments)})", *arguments)


class Equations:
    """One model's rates as Python functions of numbers, for any parameters."""

    def __init__(self, subject: Subject) -> None:
        kernels = {name: subject.table[name] for name in ("closed_loop", "plant", "filters", "compensator")}
        equations, blocks = subject.derivation.equations, dict(kernels["closed_loop"].inputs)
        self.names = [symbol.name for symbol in blocks["p"]]
        self.n_plant = len(subject.derivation.signals.x)
        self.n_states = len(blocks["X"])
        self.n_kinks = len(kernels["closed_loop"].sides)
        self._limit = subject.manifest.limit
        self._loop = self._compiled("closed_loop", kernels, equations)
        self._parts = [self._compiled(name, kernels, equations) for name in list(kernels)[1:]]

    @staticmethod
    def _compiled(name: str, kernels: Mapping[str, Any], equations: Any) -> Callable[..., Any]:
        """Parameters -> function of the other blocks, in order -> one list for each result."""
        kernel, text = kernels[name], Text()
        inputs: dict[sp.Symbol, tuple[str, bool]] = {}
        for label, symbols in kernel.inputs:
            inputs |= {symbol: (f"{label}_{i}", label != "p") for i, symbol in enumerate(symbols)}
        outputs = [sp.sympify(entry) for _, entries in kernel.outputs for entry in entries]
        program = compile_program(outputs, list(inputs), equations, kernel.given, kernel.sides)
        found = iter([value for value, _ in program.run(text, inputs)])
        results = ", ".join(f"[{', '.join(next(found) for _ in entries)}]" for _, entries in kernel.outputs)
        blocks = {label: [inputs[symbol][0] for symbol in symbols] for label, symbols in kernel.inputs}
        others = [label for label in blocks if label != "p"]
        unpacked = [f"{''.join(f'{name}, ' for name in blocks[label])} = {label}" for label in others]
        source = "\n".join(
            [
                "def make(p):",
                *[f"    {line}" for line in [f"{', '.join(blocks['p'])}, = p", *text.lines[False]]],
                f"    def evaluate({', '.join(others)}):",
                *[f"        {line}" for line in [*unpacked, *text.lines[True], f"return [{results}]"]],
                "    return evaluate",
            ]
        )
        space: dict[str, Any] = {name: getattr(math, name) for name in ("sin", "cos", "exp", "log", "tanh")}
        exec(compile(source, f"<{name}>", "exec"), space)
        made: Callable[..., Any] = space["make"]
        return made

    def continuous(
        self,
        parameters: Mapping[str, float],
        features: Sequence[Feature],
        x0: Array,
        t: Array,
        rest: float | None = None,
    ) -> Array:
        """States and v at instants of a run, shape (instants, nX + 1)."""
        p = [parameters[name] for name in self.names]
        loop, limit = self._loop(p), parameters[self._limit]

        def rates(time: float, X: Any, sides: Sequence[float]) -> tuple[list[float], list[float]]:
            mode = (limit, 0.0) if sides[0] > 0 else (-limit, 0.0) if sides[1] < 0 else (0.0, 1.0)
            slopes, (v,), _, *kinks = loop((time,), X, (*mode, *sides[2:]))
            return slopes, [v - limit, v + limit, *(kinks[0] if kinks else [])]

        path = Path(rates, features, 2 + self.n_kinks, None if rest is None else Friction(2, rest))
        X = np.zeros(self.n_states)
        X[: self.n_plant] = x0
        states = np.array(path.along(X, t))
        v = [
            rates(time, state.tolist(), [-1.0] * (2 + self.n_kinks))[1][0] + limit
            for time, state in zip(t.tolist(), states, strict=True)
        ]
        return np.column_stack([states, v])

    def sampled(
        self,
        parameters: Mapping[str, float],
        features: Sequence[Feature],
        x0: Array,
        count: int,
        period: float,
        rest: float | None = None,
    ) -> Array:
        """States and v at the samples of a run, shape (count + 1, nX + 1); w and y are held in between."""
        p, n = [parameters[name] for name in self.names], self.n_plant
        loop, limit = self._loop(p), parameters[self._limit]
        plant, filters, compensator = (make(p) for make in self._parts)
        X = np.zeros(self.n_states)
        X[:n] = x0
        rows = []
        held: list[float] = []

        def rates(time: float, X: Any, sides: Sequence[float]) -> tuple[list[float], list[float]]:
            y, u, du = held
            slopes, _, *kinks = plant((time,), X[:n], (u, *sides))
            flat = [entry for block in filters((y,), X[n:], (u,)) for entry in block]
            return [*slopes, *flat, *compensator((y,), X[n:], (du,))[0]], list(kinks[0] if kinks else [])

        path = Path(rates, features, self.n_kinks, None if rest is None else Friction(0, rest))
        for k in range(count + 1):
            v = loop((k * period,), X.tolist(), (0.0, 1.0, *[1.0] * self.n_kinks))[1][0]
            rows.append([*X.tolist(), v])
            u = min(max(v, -limit), limit)
            held[:] = [float(X[0]), u, u - v]
            if k < count:
                X = path.along(X, np.array([k * period, (k + 1) * period]))[1]
        return np.array(rows)


class Steps(DOP853):  # type: ignore[misc]
    """SciPy's steps, where errors may underflow: it divides 0 by 0 there and never ends."""

    def _estimate_error_norm(self, K: Array, h: float, scale: Array) -> float:
        with np.errstate(invalid="ignore"):
            norm = float(super()._estimate_error_norm(K, h, scale))
        return 0.0 if math.isnan(norm) and bool(np.all(np.isfinite(K))) else norm


@dataclass(frozen=True)
class Friction:
    """Coulomb's friction.

    Attributes:
        side: which of the sides is that of its ``sign(x2)``.
        level: what it holds at rest, rad/s^2.
    """

    side: int
    level: float


class Path:
    """A run between located changes of side."""

    def __init__(
        self, rates: Rates, features: Sequence[Feature], count: int, friction: Friction | None = None
    ) -> None:
        self.given = rates
        self.friction = friction
        self.over_t = [feature for feature in features if feature.over == "t"]
        self.over_x1 = [feature for feature in features if feature.over == "x1"]
        self.over_x2 = [feature for feature in features if feature.over == "x2"]
        self.count = count

    def rates(self, t: float, X: Any, sides: Sequence[float]) -> tuple[list[float], list[float]]:
        """The rates and what tells the sides; at rest x2' is 0."""
        slopes, arguments = self.given(t, X, sides)
        if self.friction is not None and sides[self.friction.side] == 0.0:
            arguments[self.friction.side] = self.friction.level - abs(slopes[1])
            slopes[1] = 0.0
        return slopes, arguments

    def met(self, t: float, X: Array, sides: list[float], crossed: int) -> None:
        """A side changes, or the joint comes to rest, or leaves it."""
        if self.friction is None or crossed != self.friction.side:
            sides[crossed] = -sides[crossed]
            return
        was, sides[crossed] = sides[crossed], 0.0
        force = self.given(t, X.tolist(), sides)[0][1]
        if was == 0.0:
            sides[crossed] = math.copysign(1.0, force)
        elif abs(force) < self.friction.level:
            X[1] = 0.0
        else:
            sides[crossed] = -was

    def along(self, X: Array, t: Array) -> list[Array]:
        """States at instants; the first is that of X."""
        now, rows, flips = float(t[0]), [X.copy()], 0
        sides = [1.0] * self.count
        for _ in range(self.count + 1):  # an argument may depend on the sides before its own
            sides = [-1.0 if value < 0 else 1.0 for value in self.given(now, X.tolist(), sides)[1]]
        if self.friction is not None and X[1] == 0.0:
            self.met(now, X, sides, self.friction.side)
            if sides[self.friction.side] != 0.0:  # it is torn off at once
                sides[self.friction.side] = 0.0
                self.met(now, X, sides, self.friction.side)
        while len(rows) < len(t):
            end, X, crossed = self._smooth(now, X, float(t[-1]), sides, t[len(rows) :], rows)
            flips = flips + 1 if end == now else 0
            if flips > FLIPS:
                raise SlidingError(f"t = {now}")
            now = end
            if crossed >= 0:
                self.met(now, X, sides, crossed)
        return rows

    def longest(self, t: float, X: Array, slopes: Array) -> float:
        """How long the next step may be."""
        longest = min([LONGEST, *(feature.room(t) for feature in self.over_t)])
        for feature in self.over_x2:  # half the room, for the rate of x2 changes within a step
            longest = min(longest, feature.room(float(X[1])) / (2 * abs(float(slopes[1])) + 1e-9))
        for feature in self.over_x1:
            room = feature.room(float(X[0]))
            speed, rate = abs(float(slopes[0])), abs(float(slopes[1]))
            longest = min(longest, room / (2 * speed + 1e-9), math.sqrt(room / (rate + 1e-9)))
        return longest

    def _smooth(
        self, t: float, X: Array, end: float, sides: list[float], due: Array, rows: list[Array]
    ) -> tuple[float, Array, int]:
        """Go on until `end` or a change of side; rows are added on the way."""
        fixed = list(sides)
        solver = self._solver(t, X, end, fixed)
        before = self._signed(t, X, fixed)
        change = np.full(self.count, np.inf)
        first, place = True, 0
        while solver.status == "running":
            solver.max_step = self.longest(solver.t, solver.y, solver.f)
            message = solver.step()
            if solver.status == "failed":
                raise ArithmeticError(message)
            after = self._signed(solver.t, solver.y, fixed)
            near = np.minimum(np.abs(before), np.abs(after)) <= 2 * np.maximum(change, np.abs(after - before))
            output = None
            if first or np.any(after < 0) or np.any(near):
                output = solver.dense_output()
                found = self._crossing(output, solver.t_old, solver.t, fixed)
                if found is not None:
                    when, crossed = found
                    self._write(output, when, due, place, rows)
                    if when <= t:
                        return t, X, crossed
                    return when, self._again(output, solver.t_old, when, fixed), crossed
            if place < len(due) and due[place] <= solver.t:
                place = self._write(output or solver.dense_output(), solver.t, due, place, rows)
            change, before, first = np.abs(after - before), after, False
        return end, solver.y, -1

    def _solver(self, t: float, X: Array, end: float, sides: list[float]) -> Steps:
        def slopes(time: float, state: Array) -> list[float]:
            return self.rates(time, state.tolist(), sides)[0]

        step = min(1e-4, (end - t), self.longest(t, X, np.array(slopes(t, X))))
        return Steps(slopes, t, X, end, max_step=LONGEST, rtol=1e-11, atol=1e-12, first_step=step)

    def _signed(self, t: float, X: Array, sides: list[float]) -> Array:
        """What tells the sides, positive where it is on its own."""
        values, sided = np.array(self.rates(t, X.tolist(), sides)[1]), np.array(sides)
        signed: Array = np.where(sided == 0.0, values, values * sided)
        return signed

    def _crossing(
        self, output: Any, start: float, end: float, sides: list[float]
    ) -> tuple[float, int] | None:
        """The first change of side in a step: when, and which."""
        low = start
        for part in INSIDE:
            high = start + part * (end - start) if part < 1.0 else end
            beyond = np.flatnonzero(self._signed(high, output(high), sides) < 0)
            if len(beyond):
                return min((self._root(output, low, high, sides, int(j)), int(j)) for j in beyond)
            low = high
        return None

    def _root(self, output: Any, low: float, high: float, sides: list[float], j: int) -> float:
        def value(t: float) -> float:
            return float(self._signed(t, output(t), sides)[j])

        return low if value(low) <= 0 else float(brentq(value, low, high, xtol=1e-15, rtol=1e-15))

    def _again(self, output: Any, start: float, when: float, sides: list[float]) -> Array:
        """The state at a change of side, by steps that end there."""
        if when == start:
            return np.asarray(output(start))
        solver = self._solver(start, output(start), when, sides)
        while solver.status == "running":
            solver.max_step = self.longest(solver.t, solver.y, solver.f)
            solver.step()
        return np.asarray(solver.y)

    def _write(self, output: Any, until: float, due: Array, place: int, rows: list[Array]) -> int:
        while place < len(due) and due[place] <= until:
            rows.append(output(float(due[place])))
            place += 1
        return place
