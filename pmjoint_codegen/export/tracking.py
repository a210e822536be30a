"""What a precision costs in tracking: rounding errors of every sample, carried through the closed loop.

The loop is that of the exported example: the controller with the plant that it was designed for, without
disturbance. Each sample adds at most the derived bounds of `bounds`, the rounding of y and of the reference,
and that of the parameters. The derivative of one sample's map, taken along the run, carries every error to
all later samples; the bound there is the sum of their magnitudes. It is of first order in the errors.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import sympy as sp

from pmjoint_codegen.export.bounds import Bounded
from pmjoint_codegen.export.exact import context, exact_hold
from pmjoint_codegen.export.example import example_plant, in_numbers
from pmjoint_codegen.export.fields import INTEGER, SAMPLE_TIME, parameter_fields
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.tree import DOUBLE, Precision, number
from pmjoint_codegen.export.twin import COMMAND, Arithmetic, Twin, bounded_arithmetic

Array = npt.NDArray[np.float64]
SAMPLES: Final = 2000  # of the run, at most
SUBSTEPS: Final = 4  # of the plant, from sample to sample
STRIDE: Final = 20  # samples from one instant of the bound to the next
_DIFFERENCE: Final = 1e-5  # for derivatives, relative to the size of each quantity


@dataclass(frozen=True)
class Plant:
    """The design's plant in numbers, and the reference.

    Attributes:
        rates: of x, from x and u, arrays of any shape (n, ...).
        rest: x at the start.
        y_r: the reference and its derivatives at t.
    """

    rates: Callable[[Array, Any], Array]
    rest: Array
    y_r: Callable[[float], Array]

    def hold(self, x: Array, u: Any, T: float) -> Array:
        """Runge and Kutta's classical method over one hold."""
        h = T / SUBSTEPS
        for _ in range(SUBSTEPS):
            k1 = self.rates(x, u)
            k2 = self.rates(x + 0.5 * h * k1, u)
            k3 = self.rates(x + 0.5 * h * k2, u)
            k4 = self.rates(x + h * k3, u)
            x = x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return x


@dataclass(frozen=True)
class Tracking:
    """What a precision may do to the loop.

    Attributes:
        y: bound on the error of y over the run.
        largest: the largest |y| of the run.
        seconds: length of the run.
    """

    y: float
    largest: float
    seconds: float


def tracking_of(program: Program, precision: Precision) -> Tracking:
    """The bound on what a precision does to y, along the run of the example."""
    plant = plant_of(program)
    T = program.derivation.model.simulation.sample_time
    rows = max(2, min(SAMPLES, round(program.derivation.model.simulation.horizon / T)))
    with np.errstate(all="ignore"):  # what overflows has no bound
        run = Loop.of(program, plant, rows, T)
        local = run.local(precision)
        bound = _carried(run.derivatives(), local)
    largest = float(np.max(np.abs(run.Z[:, 0])))
    return Tracking(bound if np.isfinite(bound) else np.inf, largest, (rows - 1) * T)


def plant_of(program: Program) -> Plant:
    """The design's plant and the reference as functions of numbers."""
    d, s = program.derivation, program.derivation.signals
    plant = example_plant(d)

    def plain(value: sp.Expr) -> sp.Expr:
        return in_numbers(d, value).xreplace({s.y: s.x[0]})

    following = (*s.x[1:], sp.Integer(0))
    known = plant.known_rates(s.u)
    values = [plain(after + rate) for after, rate in zip(following, known, strict=True)]
    rates = sp.lambdify([s.x, s.u], values, modules="numpy", cse=True)
    y0 = d.model.simulation.x0[0]
    drift = [float(plain(value).xreplace({s.x[0]: sp.Float(y0)})) for value in plant.drift]
    rest = np.array([y0, *(-value for value in drift[: d.plant.order - 1])])
    reference = [plain(d.equations[item.name].expression) for item in s.y_r]
    if d.model.segment:
        reference = [sp.Integer(0)] * len(reference)
    y_r = sp.lambdify([s.t], reference, modules="math")

    def rated(x: Array, u: Any) -> Array:
        return np.array([np.broadcast_to(item, np.shape(x[0])) for item in rates(x, u)])

    return Plant(rated, rest, lambda t: np.array(y_r(t), dtype=np.float64))


def plain_arithmetic() -> Arithmetic:
    """Doubles, single ones or arrays."""
    mp = context()
    names = "sqrt sin cos tan exp expm1 log tanh sinh cosh fmin fmax fabs sign".split()  # noqa: SIM905
    table: Mapping[str, Callable[..., Any]] = {
        "number": number,
        "add": operator.add,
        "sub": operator.sub,
        "neg": operator.neg,
        "mul": operator.mul,
        "div": operator.truediv,
        "pow": np.power,
        "atan": np.arctan,
        "between": np.clip,
        **{name: getattr(np, name) for name in names},
    }

    def hold(A: Any, T: Any) -> tuple[Any, Any]:
        first, second = (
            [[float(entry) for entry in row] for row in matrix] for matrix in exact_hold(mp, A, T)
        )
        return first, second

    return Arithmetic(table, float, np.clip, hold)


@dataclass(frozen=True)
class Loop:
    """A run in doubles: its numbers at every sample.

    Attributes:
        program: of the controller.
        plant: around it.
        T: sample time.
        y_r: shape (rows, rho + 1).
        Z: shape (rows, size): x, the controller's states, what it keeps, y, u, v and the command it holds.
    """

    program: Program
    plant: Plant
    T: float
    y_r: Array
    Z: Array

    @classmethod
    def of(cls, program: Program, plant: Plant, rows: int, T: float) -> Loop:
        """Run the loop."""
        twin, x = _twin(program, T), plant.rest
        y_r = np.array([plant.y_r(k * T) for k in range(rows)])
        found = []
        twin.reset(float(x[0]), list(y_r[0]))
        for k in range(rows):
            if k:
                x = plant.hold(x, twin.values[program.derivation.signals.u], T)
            twin.step(float(x[0]), list(y_r[k]))
            found.append([*x, *(float(twin.values[key]) for key in _keys(program))])
        return cls(program, plant, T, y_r, np.array(found))

    def derivatives(self) -> Array:
        """Of Z at the next sample in Z at this one, shape (rows - 1, size, size)."""
        base, size = self.Z[:-1], self.Z.shape[1]
        sizes = np.max(np.abs(self.Z), axis=0)
        step = _DIFFERENCE * np.maximum(sizes, 1e-3 * (np.max(sizes) or 1.0))
        found = np.empty((len(base), size, size))
        for i in range(size):
            shift = np.zeros(size)
            shift[i] = step[i]
            found[:, :, i] = (self.following(base + shift) - self.following(base - shift)) / (2.0 * step[i])
        return found

    def following(self, Z: Array) -> Array:
        """Z one sample later, for every row at once."""
        program, keys = self.program, _keys(self.program)
        s, n = program.derivation.signals, program.derivation.plant.order
        twin = _twin(program, self.T)
        twin.ready = True
        twin.values = {key: Z[:, n + i] for i, key in enumerate(keys)}
        x = self.plant.hold(Z[:, :n].T, twin.values[s.u], self.T)
        twin.step(x[0], list(self.y_r[1:].T))
        rows = len(Z)
        return np.column_stack([*x, *(np.broadcast_to(twin.values[key], rows) for key in keys)])

    def local(self, precision: Precision) -> Array:
        """Bounds on what one sample alone adds to Z at its end, shape (rows - 1, size)."""
        program, keys = self.program, _keys(self.program)
        n, rows = program.derivation.plant.order, len(self.Z) - 1
        twin = _rounding_twin(program, precision, self.T)
        twin.ready = True
        twin.values = {key: Bounded(self.Z[:-1, n + i], 0.0) for i, key in enumerate(keys)}
        y, y_r = self.Z[1:, 0], self.y_r[1:].T
        twin.step(_rounded(y, precision), [_rounded(item, precision) for item in y_r])
        errors = [np.broadcast_to(twin.values[key].error, rows) for key in keys]
        return np.column_stack([np.zeros((rows, n)), *errors])


def _keys(program: Program) -> list[sp.Symbol]:
    """What the controller remembers."""
    s = program.derivation.signals
    return [*program.states, *program.kept, s.y, s.u, s.v, COMMAND]


def _twin(program: Program, T: float) -> Twin:
    values = dict(_defaults(program))
    return Twin(program, plain_arithmetic(), values, T, bool(program.derivation.model.gains.matched))


def _rounding_twin(program: Program, precision: Precision, T: float) -> Twin:
    """The controller in a precision, whose parameters are rounded numbers."""
    values = {symbol: _rounded(value, precision) for symbol, value in _defaults(program)}
    matched = bool(program.derivation.model.gains.matched)
    return Twin(program, bounded_arithmetic(precision), values, _rounded(T, precision), matched)


def _defaults(program: Program) -> list[tuple[sp.Symbol, float]]:
    items = [item for item in parameter_fields(program) if item.kind != INTEGER and item.name != SAMPLE_TIME]
    return [(symbol, item.value) for symbol, item in zip(program.parameters, items, strict=True)]


def _rounded(value: Any, precision: Precision) -> Bounded:
    """A double and how far its nearest number of a precision may be."""
    exact = precision.roundoff == DOUBLE.roundoff
    return Bounded(value, 0.0 if exact else precision.roundoff * np.abs(value))


def _carried(dZ: Array, local: Array) -> float:
    """The largest bound on y, over every `STRIDE`-th sample and the last.

    Backwards through the run, the sensitivity of each later y to the present error is kept.
    """
    rows, size = local.shape
    instants = np.unique([*range(STRIDE, rows + 1, STRIDE), rows])
    weights, total = np.zeros((len(instants), size)), np.zeros(len(instants))
    for k in range(rows, 0, -1):
        first = int(np.searchsorted(instants, k))
        if instants[first] == k:
            weights[first, 0] = 1.0
        total[first:] += np.abs(weights[first:]) @ local[k - 1]
        weights[first:] = weights[first:] @ dZ[k - 1]
    return float(np.max(total))
