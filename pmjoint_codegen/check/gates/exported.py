"""The exported C against the sampled run that `simulate` makes, sample by sample.

The export shares the derivation's equations with the kernels, and nothing behind them. At every sample of the
model's own run, from a zero and from a matched start, the exported controller is put into the recorded state
and takes one step: its next state, v, u, errors and estimate are those of the run. The bound is the sum of
two derived error bounds: of the statements of the exported C, and of the instructions of the kernels. The
matrices of the exact hold agree bit for bit. Then it runs alone through the recorded y, which shows how far
rounding errors carry it from the run.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pmjoint_codegen import __version__
from pmjoint_codegen.check.bits import different_bits
from pmjoint_codegen.check.oracles.error_bound import walk
from pmjoint_codegen.check.oracles.exported import Exported
from pmjoint_codegen.check.result import Difference, GateResult, failed, not_run, passed
from pmjoint_codegen.check.subject import Subject
from pmjoint_codegen.compile.compiler import Compiler
from pmjoint_codegen.export.bounds import Bounded, relative
from pmjoint_codegen.export.package import TRACE, Export, export_c
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.source import Identity
from pmjoint_codegen.export.trace import trace_faults
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.export.twin import COMMAND, Twin, bounded_arithmetic
from pmjoint_codegen.identity import model_hash
from pmjoint_codegen.kernels.evaluator import Array, Evaluator
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.simulate.samples import Recorded, record
from pmjoint_codegen.values import MATCHED, STARTS
from pmjoint_codegen.workspace import cache_dir

SAMPLES: Final = 4000  # of a run, at most


@dataclass(frozen=True)
class Comparison:
    """One run compared.

    Attributes:
        ratio: largest difference relative to its bound.
        values: how many values were compared.
        other_bits: how many differ in their bits.
        carried: largest difference of v when the export runs alone, relative to the largest |v|.
        difference: the worst value, if it is beyond its bound.
    """

    ratio: float
    values: int
    other_bits: int
    carried: float
    difference: Difference | None


def check(subject: Subject) -> GateResult:
    """Compile the export and compare it with the model's sampled runs."""
    if subject.compiler is None or subject.compiled is None:
        return not_run("no C compiler")
    if not subject.derivation.design.exact_hold:
        return not_run(f'law = "{subject.model.design}" is not exported')
    loaded = load(subject, subject.compiler)
    export = loaded.export
    faults = trace_faults(export.program, export.source, json.loads(export.files[TRACE]))
    if faults:
        return failed(faults[0], len(faults), 0, findings=tuple(faults[1:]))
    return judge(loaded, subject.compiled, subject.tapes)


def load(subject: Subject, compiler: Compiler) -> Exported:
    """Export a model's controller, compile and load it."""
    identity = Identity(subject.model.name, model_hash(subject.document), __version__)
    export = export_c(subject.derivation, identity)
    return Exported.load(export, compiler, cache_dir(subject.environment, subject.notify))


def judge(
    loaded: Exported, evaluator: Evaluator, tapes: Mapping[str, Tape], samples: int = SAMPLES
) -> GateResult:
    """Compare a loaded controller with runs of the kernels.

    Args:
        loaded: the controller.
        evaluator: of the kernels.
        tapes: their instructions.
        samples: of a run, at most.
    """
    row = loaded.call("self_test")
    if row != 0:
        return failed(f"self_test: row {row} differs from the recorded data")
    found = []
    for start in STARTS:
        recorded = begin(loaded, evaluator, start, samples)
        if isinstance(recorded, str):
            return failed(recorded)
        unequal = different_bits(loaded.hold(), recorded.hold)
        if unequal.any():
            return failed(f"{int(unequal.sum())} entries of the exact hold have other bits")
        found.append(compare(loaded, recorded, tapes, start))
    worst = max(found, key=lambda item: item.ratio)
    bits = f"{sum(item.other_bits for item in found)} of {sum(item.values for item in found)} values"
    detail = f"largest difference from the sampled run / derived bound; {bits} have other bits"
    carried = max(item.carried for item in found)
    told = f"running alone through the recorded y, v stays within {carried:.2g} of the largest |v|"
    if worst.difference is not None:
        return failed(detail, worst.ratio, 1.0, worst.difference)
    return passed(detail, worst.ratio, 1.0, told)


def begin(loaded: Exported, evaluator: Evaluator, start: str, samples: int) -> Recorded | str:
    """Record a run, and initialise a loaded controller as the run's was; or why that cannot be."""
    recorded = record(evaluator, start, samples)
    if isinstance(recorded, str):
        return recorded
    loaded.params.matched = int(start == MATCHED)
    if loaded.init(recorded.reading[0], recorded.y_r[0]) != 0:
        return f"init refuses the model's own parameters, {start} start"
    return recorded


def compare(loaded: Exported, recorded: Recorded, tapes: Mapping[str, Tape], start: str) -> Comparison:
    """Every sample's step from the recorded state, and the run alone."""
    program = loaded.export.program
    shown = [*_shown(program)]
    names = [*(f"{state}_next" for state in program.states), "v", "u", *shown]
    columns = (recorded.s, recorded.v, recorded.u, recorded.z, recorded.x_hat)
    expected = np.column_stack([array[1:] for array in columns])
    alone = _alone(loaded, recorded)
    found = _steps(loaded, recorded)
    bounds = step_bounds(loaded.export, recorded, tapes, matched=start == MATCHED)
    error = np.abs(found - expected)
    ratio = relative(error, bounds)
    row, column = (int(i) for i in np.unravel_index(np.argmax(ratio), ratio.shape))
    worst = float(ratio[row, column])
    difference = None
    if worst > 1.0:
        a, b = float(expected[row, column]), float(found[row, column])
        place = f"{start} start, sample {row + 1}"
        figures = (repr(a), repr(b), f"{error[row, column]:.3g}", f"{bounds[row, column]:.3g}")
        difference = Difference(f"{loaded.export.identity.prefix}_step", names[column], place, *figures)
    carried = float(np.max(np.abs(alone - recorded.v)) / np.max(np.abs(recorded.v)))
    return Comparison(worst, error.size, int(different_bits(expected, found).sum()), carried, difference)


def _alone(loaded: Exported, recorded: Recorded) -> Array:
    """V of the controller that runs from its own start."""
    loaded.init(recorded.reading[0], recorded.y_r[0])
    found = np.empty(len(recorded.v))
    for k, y in enumerate(recorded.reading.tolist()):
        loaded.step(y, recorded.y_r[k])
        found[k] = loaded.output.v
    return found


def _steps(loaded: Exported, recorded: Recorded) -> Array:
    """Next states, v and u of the step from every recorded sample but the last."""
    program, state = loaded.export.program, loaded.state
    states = [symbol.name for symbol in program.states]
    outputs = ["v", "u", *_shown(program)]
    found = np.empty((len(recorded.v) - 1, len(states) + len(outputs)))
    s, y, y_r = recorded.s.tolist(), recorded.y.tolist(), recorded.y_r.tolist()
    v, u, command, reading = (
        array.tolist() for array in (recorded.v, recorded.u, recorded.command, recorded.reading)
    )
    for k in range(len(found)):
        for name, value in zip(states, s[k], strict=True):
            setattr(state, name, value)
        if program.kept:  # what the law leaves for the update, found in this state
            state.ready = 0
            loaded.step(y[k], y_r[k])
        state.y, state.v, state.u, state.command, state.ready = y[k], v[k], u[k], command[k], 1
        loaded.step(reading[k + 1], y_r[k + 1])
        found[k] = [
            *(getattr(state, name) for name in states),
            *(getattr(loaded.output, name) for name in outputs),
        ]
    return found


def _shown(program: Program) -> list[str]:
    """Names of the errors and of the estimate."""
    return [symbol.name for symbol in (*program.derivation.signals.z, *program.estimate)]


def step_bounds(export: Export, recorded: Recorded, tapes: Mapping[str, Tape], *, matched: bool) -> Array:
    """Bounds on the differences of `_steps`: of the exported statements and of the kernels' instructions."""
    program, rows = export.program, len(recorded.v) - 1
    then = slice(1, rows + 1)
    states, twin = _state_errors(export, recorded, tapes, matched=matched)
    given = [recorded.y[then, np.newaxis], recorded.s[then], recorded.y_r[then], recorded.p[then]]
    z, _, v_error = walk(tapes["law"], given)
    (x_hat,) = walk(tapes["estimate"], [recorded.s[then], recorded.p[then]])
    s = program.derivation.signals
    twin.values |= {
        symbol: Bounded(twin.values[symbol].value, states[:, i]) for i, symbol in enumerate(program.states)
    }
    filtered = twin.filtered(Bounded(recorded.reading[then], 0.0))
    twin.values[s.y] = Bounded(filtered.value, 2.0 * filtered.error)  # both sides round
    twin.values |= {symbol: Bounded(recorded.y_r[then, i], 0.0) for i, symbol in enumerate(s.y_r)}
    found: Any = twin.run(program.law, twin.values, {})
    shown = [_broadcast(found[symbol].error, rows) for symbol in (*s.z, *program.estimate)]
    v = Bounded(found[s.v].value, found[s.v].error + v_error.error[:, 0])
    twin.actuate(v, first=False)
    u = 2.0 * _broadcast(twin.values[s.u].error, rows)  # both sides round
    return np.column_stack([states, v.error, u, np.column_stack(shown) + np.hstack([z.error, x_hat.error])])


def local_errors(
    export: Export, recorded: Recorded, tapes: Mapping[str, Tape], *, matched: bool
) -> tuple[Array, Array]:
    """Bounds on what one sample alone adds: to the next states, (rows - 1, ns), and to v, (rows,)."""
    states, twin = _state_errors(export, recorded, tapes, matched=matched)
    program, s, rows = export.program, export.program.derivation.signals, len(recorded.v)
    given = [recorded.y[:, np.newaxis], recorded.s, recorded.y_r, recorded.p]
    _, _, kernel = walk(tapes["law"], given)
    exact = {symbol: recorded.s[:, i] for i, symbol in enumerate(program.states)} | {s.y: recorded.y}
    exact |= {symbol: recorded.y_r[:, i] for i, symbol in enumerate(s.y_r)}
    found = twin.run(program.law, {symbol: Bounded(array, 0.0) for symbol, array in exact.items()}, {})
    return states, _broadcast(found[s.v].error, rows) + kernel.error[:, 0]


def _state_errors(
    export: Export, recorded: Recorded, tapes: Mapping[str, Tape], *, matched: bool
) -> tuple[Array, Twin]:
    """Bounds on the differences of the next states, and the twin that is there."""
    program, rows = export.program, len(recorded.v) - 1
    now = slice(0, rows)
    column = {name: getattr(recorded, name)[now, np.newaxis] for name in ("y", "u", "v")}
    h = np.tile(recorded.hold, (rows, 1))
    given = [recorded.y_r[now], column["u"], column["v"], h, recorded.p[now]]
    (update,) = walk(tapes["sampled_update"], [column["y"], recorded.s[now], *given])
    twin = twin_of(program, bounded_arithmetic(DOUBLE), DOUBLE, matched=matched)
    # Both take the same bits of the hold's matrices, so their own error is no difference.
    twin.fixed |= {symbol: Bounded(twin.fixed[symbol].value, 0.0) for symbol in program.hold.symbols}
    s = program.derivation.signals
    twin.values = {symbol: Bounded(recorded.s[now, i], 0.0) for i, symbol in enumerate(program.states)}
    taken = {s.y: recorded.y, s.u: recorded.u, s.v: recorded.v, COMMAND: recorded.command}
    taken |= {symbol: recorded.y_r[:, i] for i, symbol in enumerate(s.y_r)}
    twin.values |= {symbol: Bounded(array[now], 0.0) for symbol, array in taken.items()}
    twin.keep()
    twin.ready = True
    twin.advance()
    errors = np.column_stack([_broadcast(twin.values[symbol].error, rows) for symbol in program.states])
    return errors + update.error, twin


def _broadcast(error: Any, rows: int) -> Array:
    return np.broadcast_to(np.asarray(error, dtype=np.float64), (rows,))
