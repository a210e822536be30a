"""A recorded closed-loop run for an exported controller on another machine, and the judgement of its answers.

Without functions of the C library every operation is IEEE 754's, so the answers have the bits of this
machine's. With them, libraries differ in the last places. Each step is judged by itself: from the state that
the other machine had at one sample, its values at the next are what the equations give, within the bound of
`pmjoint_codegen.export.bounds`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.compile.compiler import Compiler, find_compiler, install_line
from pmjoint_codegen.compile.library import LIBRARY, build
from pmjoint_codegen.errors import CheckFailed, MissingToolError
from pmjoint_codegen.export import fields
from pmjoint_codegen.export.bounds import Bounded
from pmjoint_codegen.export.fields import INTEGER
from pmjoint_codegen.export.lines import Line
from pmjoint_codegen.export.package import Export, export_c
from pmjoint_codegen.export.recording import twin_of
from pmjoint_codegen.export.source import filled, joined, words_of
from pmjoint_codegen.export.statements import Program
from pmjoint_codegen.export.targets.target import Order
from pmjoint_codegen.export.tree import DOUBLE, operations_in, tree_of
from pmjoint_codegen.export.twin import COMMAND, bounded_arithmetic
from pmjoint_codegen.simulate.samples import record
from pmjoint_codegen.values import MATCHED, ZERO
from pmjoint_codegen.workspace import cache_dir

Array = npt.NDArray[np.float64]
SAMPLES: Final = 10_000
_HOST: Final = Path(__file__).with_name("replay.c.in")
_EXACT: Final = frozenset({"add", "sub", "mul", "div", "neg", "fmin", "fmax", "fabs", "sqrt", "sign"})
_LEAVES: Final = frozenset({"number", "name"})


@dataclass(frozen=True)
class Replay:
    """A recorded run and this machine's answers.

    Attributes:
        export: the controller.
        given: y, the reference and its derivatives, shape (samples, rho + 2).
        host: outputs and states after each sample, shape (samples, values).
    """

    export: Export
    given: Array
    host: Array


@dataclass(frozen=True)
class Agreement:
    """Another machine's answers compared.

    Attributes:
        samples: how many.
        values: how many were compared.
        other_bits: of them, with other bits than this machine's.
        over_bound: largest error of a step relative to its derived bound.
        functions: of the C library, those that IEEE 754 does not define.
    """

    samples: int
    values: int
    other_bits: int
    over_bound: float
    functions: tuple[str, ...]

    @property
    def record(self) -> Mapping[str, Any]:
        """As it joins the JSON document."""
        return {
            "samples": self.samples,
            "values": self.values,
            "other_bits": self.other_bits,
            "step_over_bound": self.over_bound,
            "library_functions": list(self.functions),
        }

    @property
    def line(self) -> str:
        """As it joins the text."""
        called = ", ".join(self.functions) or "no function"
        return (
            f"{self.samples} recorded samples: {self.other_bits} of {self.values} values have other bits "
            f"than on this machine; largest error of a step / derived bound {self.over_bound:.2g}; "
            f"of the C library it calls {called}"
        )


def input_names(program: Program) -> tuple[str, ...]:
    """Columns of the samples."""
    return ("y", *(symbol.name for symbol in program.derivation.signals.y_r))


def output_names(program: Program) -> tuple[str, ...]:
    """The first columns of the answers; the states' follow."""
    return tuple(item.name for item in fields.output_fields(program) if item.kind != INTEGER)


def state_names(program: Program) -> tuple[str, ...]:
    """The last columns of the answers, y as the controller holds it among them."""
    return (*(symbol.name for symbol in program.states), "y")


def replay_of(order: Order, samples: int = SAMPLES) -> Replay:
    """Simulate the model's closed loop, and give this machine's answers to what its controller saw.

    Args:
        order: what was exported.
        samples: at most.

    Raises:
        MissingToolError: there is no C compiler.
        CheckFailed: the run ends at once, or the controller raises a flag.
    """
    compiler = find_compiler(order.environment, order.notify)
    if compiler is None:
        raise MissingToolError(
            "a C compiler is needed to run the export", remedy=f"install it: {install_line()}"
        )
    source = Source(order.file, order.document, environment=order.environment)
    evaluator = evaluator_of(source, order.notify or (lambda line: None))
    start = MATCHED if order.derivation.model.gains.matched else ZERO
    recorded = record(evaluator, start, samples - 1)
    if isinstance(recorded, str):
        raise CheckFailed(recorded, where=order.identity.model)
    given = np.column_stack([recorded.reading, recorded.y_r])[:samples]
    export = export_c(order.derivation, order.identity, order.precision, order.hold)
    given = given.astype(_type(export)).astype(np.float64)
    return Replay(export, given, _host(export, given, compiler, cache_dir(order.environment)))


def _type(export: Export) -> type[np.floating[Any]]:
    return np.float32 if export.precision.suffix else np.float64


def _host(export: Export, given: Array, compiler: Compiler, cache: Path) -> Array:
    """This machine's answers."""
    program, prefix = export.program, export.identity.prefix
    taken = [f"out.{name}" for name in output_names(program)]
    taken += [f"state.{name}" for name in state_names(program)]
    blocks = {
        "set": [
            Line(f"        in.{name} = ({export.precision.name})given[{place}];")
            for place, name in enumerate(input_names(program))
        ],
        "store": [Line(f"        found[{place}] = (double){name};") for place, name in enumerate(taken)],
    }
    words = words_of(program, export.identity, export.precision)
    words |= {"inputs": str(given.shape[1]), "values": str(len(taken))}
    text = joined(filled(_HOST.read_text(encoding="utf-8"), blocks, words))
    sources = {name: export.files[name].encode() for name in (f"{prefix}.c", f"{prefix}.h")}
    library = ctypes.CDLL(str(build({**sources, "replay.c": text.encode()}, compiler, cache) / LIBRARY))
    held, found = np.ascontiguousarray(given), np.empty((len(given), len(taken)))
    numbers = ctypes.POINTER(ctypes.c_double)
    pointers = [array.ctypes.data_as(numbers) for array in (held, found)]
    failed = library.replay(pointers[0], len(held), pointers[1])
    if failed:
        what = (
            "init refuses the model's own parameters" if failed < 0 else f"step raises a flag at row {failed}"
        )
        raise CheckFailed(what, where=f"{prefix}, on this machine")
    return found


def judged(replay: Replay, found: Array, where: str) -> Agreement:
    """Compare another machine's answers with this machine's and with the equations.

    Args:
        replay: what it was given.
        found: its answers, in the shape of ``replay.host``.
        where: the machine, for messages.

    Raises:
        CheckFailed: bits differ though no function of the library is called, or a step is beyond its bound.
    """
    program = replay.export.program
    names = (*output_names(program), *state_names(program))
    if found.shape != replay.host.shape:
        raise CheckFailed(f"{found.shape} values came back, {replay.host.shape} expected", where=where)
    functions = library_functions(program)
    differing = found.view(np.int64) != replay.host.view(np.int64)
    if differing.any() and not functions:
        row, column = (int(i) for i in np.argwhere(differing)[0])
        a, b = float(replay.host[row, column]), float(found[row, column])
        told = f"{names[column]} at sample {row} is {b!r}, on this machine {a!r}"
        raise CheckFailed(f"{int(differing.sum())} values have other bits: {told}", where=where)
    ratios = step_ratios(replay, found)
    row, column = (int(i) for i in np.unravel_index(np.argmax(ratios), ratios.shape))
    worst = float(ratios[row, column])
    if not worst <= 1.0:
        told = f"{names[column]} at sample {row + 1} is off by {worst:.3g} times its derived bound"
        raise CheckFailed(told, where=where)
    return Agreement(len(found), found.size, int(differing.sum()), worst, functions)


def library_functions(program: Program) -> tuple[str, ...]:
    """The functions of the C library that a controller calls, but those that IEEE 754 defines exactly."""
    groups = (program.constants, program.law, program.update, program.start)
    trees = [item.tree for group in groups for item in group]
    trees += [tree_of(entry.value) for entry in program.matrices]
    trees += [tree_of(value) for value in program.starts.values()]
    found = set[str]().union(*(operations_in(tree) for tree in trees)) - _EXACT - _LEAVES
    if "filter" in program.derivation.model.chain:
        found.add("expm1")
    return tuple(sorted(found))


def step_ratios(replay: Replay, found: Array) -> Array:
    """How far each step is from the equations, relative to its bound, shape (samples - 1, values)."""
    program, precision = replay.export.program, replay.export.precision
    signals = program.derivation.signals
    names = [*output_names(program), *state_names(program)]
    symbols = {symbol.name: symbol for symbol in (*program.states, *program.estimate, *signals.z)}
    symbols |= {"y": signals.y, "v": signals.v, "u": signals.u, "command": COMMAND}
    twin = twin_of(program, bounded_arithmetic(precision), precision, matched=False)
    kept = ("v", "u", "command", *state_names(program))
    twin.values = {symbols[name]: Bounded(found[:-1, names.index(name)], 0.0) for name in kept}
    twin.ready = True
    y, *y_r = (Bounded(column, 0.0) for column in replay.given[1:].T)
    expected = {**twin.values, **twin.step(y, y_r)} | {
        symbol: twin.values[symbol] for symbol in program.states
    }
    expected[signals.y] = twin.values[signals.y]
    factor = 1.0 + DOUBLE.roundoff / precision.roundoff  # the twin rounds too, to double
    columns = []
    for place, name in enumerate(names):
        item = expected[symbols[name]]
        error = np.abs(found[1:, place] - item.value)
        with np.errstate(all="ignore"):  # 0/0 is a value that both have exactly
            ratio = np.where(error > 0.0, error / (factor * item.error), 0.0)
        columns.append(np.where(np.isnan(error) | np.isnan(ratio), np.inf, ratio))
    return np.column_stack(columns)
