"""A recorded closed-loop run for an exported controller on another machine, and the judgement of its answers.

Answers are judged as `pmjoint_codegen.export.elsewhere` says.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
from collections.abc import Callable, Mapping, Sequence
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
from pmjoint_codegen.export.elsewhere import library_functions, step_ratios
from pmjoint_codegen.export.fields import INTEGER
from pmjoint_codegen.export.lines import Line
from pmjoint_codegen.export.package import Export, export_c
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import filled, joined, words_of
from pmjoint_codegen.export.targets.target import Order
from pmjoint_codegen.scratch import scratch
from pmjoint_codegen.simulate.samples import record
from pmjoint_codegen.values import MATCHED, ZERO
from pmjoint_codegen.workspace import cache_dir

Array = npt.NDArray[np.float64]
SAMPLES: Final = 10_000
_HOST: Final = Path(__file__).with_name("replay.c.in")


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
    columns = dict(zip(names, found.T, strict=True))
    ratios = step_ratios(replay.export, replay.given, columns)
    row, column = (int(i) for i in np.unravel_index(np.argmax(ratios), ratios.shape))
    worst = float(ratios[row, column])
    if not worst <= 1.0:
        told = f"{names[column]} at sample {row + 1} is off by {worst:.3g} times its derived bound"
        raise CheckFailed(told, where=where)
    return Agreement(len(found), found.size, int(differing.sum()), worst, functions)


def asked(replay: Replay, where: str, ask: Callable[[Path, Path], str]) -> tuple[dict[str, Any], Agreement]:
    """Give the run to a program by a file, take its answers from another, and judge them.

    Args:
        replay: what it is given.
        where: the program, for messages.
        ask: runs it: the file with the samples, the file for the answers -> what it prints, a JSON document
            whose entries ``self_test``, ``init`` and ``flags`` are 0.

    Raises:
        CheckFailed: an entry is not 0, or the answers are not those of `judged`.
    """
    with scratch("pmjoint-replay") as place:
        given, found = place / "given", place / "found"
        given.write_bytes(replay.given.tobytes())
        told = json.loads(ask(given, found))
        if told["self_test"]:
            raise CheckFailed(
                f"self_test: row {told['self_test']} differs from the recorded data", where=where
            )
        if told["init"]:
            raise CheckFailed("init refuses the model's own parameters", where=where)
        if told["flags"]:
            raise CheckFailed(f"flags {told['flags']} of step", where=where)
        answers = np.fromfile(found).reshape(-1, replay.host.shape[1])
    return told, judged(replay, answers, where)


def ended(command: Sequence[str], folder: Path, patience: float) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, or to ours.

    Raises:
        CheckFailed: it takes longer than `patience`, s.
    """
    try:
        return subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=patience, check=False
        )
    except subprocess.TimeoutExpired:
        name = Path(command[0]).name
        raise CheckFailed(f"{name} does not end within {patience:g} s", where=str(folder)) from None


def printed(done: subprocess.CompletedProcess[str], folder: Path, mark: str) -> str:
    """What a program printed, if it ended well; `mark` is in the line that tells its error.

    Raises:
        CheckFailed: it did not.
    """
    if done.returncode != 0:
        lines = done.stderr.splitlines()
        said = [line.strip() for line in lines if mark in line] or lines
        what = said[0] if said else f"{Path(done.args[0]).name} ends with {done.returncode}"
        raise CheckFailed(what, where=str(folder))
    return done.stdout
