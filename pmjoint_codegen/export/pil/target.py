"""Targets that are processors: the folder, and what a run of it on the emulated processor measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.chips import Chip, chip_named
from pmjoint_codegen.export.pil.compare import compare, library_functions
from pmjoint_codegen.export.pil.folder import PRECISIONS, Columns, exports_of, folder_files
from pmjoint_codegen.export.pil.machine import Tools
from pmjoint_codegen.export.pil.plant import answered_run
from pmjoint_codegen.export.pil.records import Answer, Array, Layout, check_counter
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.simulate.samples import Recorded, record
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.values import MATCHED, ZERO

SAMPLES: Final = 10_000
_MOST: Final = 3000  # samples of a closed loop: its plant takes 0.5 ms for each


@dataclass(frozen=True)
class Measured:
    """One precision on a processor.

    Attributes:
        values: compared with this machine's, in the recorded run.
        other_bits: of them with other bits.
        step_over_bound: largest difference of a step from the equations, relative to its derived bound.
        step_instructions: mean of the steps, call included.
        step_instructions_most: of one step.
        init_instructions: of init.
        step_stack: bytes.
        init_stack: bytes.
        self_test_stack: bytes.
        code: bytes of the controller without its self test.
        code_with_self_test: bytes of all that the exported C becomes.
        image: bytes of code of the whole program, libraries included.
        loop_samples: of the closed loop.
        loop_values: compared with this machine's, in the closed loop.
        loop_other_bits: of them with other bits.
        loop_over_bound: as `step_over_bound`.
        loop_deviation: largest |y - y of the simulated run|, in the kernels' unit.
        v_deviation: largest |v - v in double| in the recorded run, relative to the largest |v|.
    """

    values: int
    other_bits: int
    step_over_bound: float
    step_instructions: float
    step_instructions_most: int
    init_instructions: int
    step_stack: int
    init_stack: int
    self_test_stack: int
    code: int
    code_with_self_test: int
    image: int
    loop_samples: int
    loop_values: int
    loop_other_bits: int
    loop_over_bound: float
    loop_deviation: float
    v_deviation: float


_ROWS: Final = (
    ("values compared with this machine's", "values", "d"),
    ("of them with other bits", "other_bits", "d"),
    ("largest error of a step / derived bound", "step_over_bound", ".2g"),
    ("largest |v - v in double| / largest |v|", "v_deviation", ".2g"),
    ("instructions of a step, mean", "step_instructions", ".0f"),
    ("instructions of a step, most", "step_instructions_most", "d"),
    ("instructions of init", "init_instructions", "d"),
    ("stack of a step, bytes", "step_stack", "d"),
    ("stack of init, bytes", "init_stack", "d"),
    ("stack of the self test, bytes", "self_test_stack", "d"),
    ("code without self test, bytes", "code", "d"),
    ("code with self test, bytes", "code_with_self_test", "d"),
    ("code of the whole program, bytes", "image", "d"),
    ("closed loop: samples", "loop_samples", "d"),
    ("closed loop: values with other bits", "loop_other_bits", "d"),
    ("closed loop: largest error / bound", "loop_over_bound", ".2g"),
    ("closed loop: largest |y - simulated y|", "loop_deviation", ".2g"),
)


def target_of(name: str) -> Target:
    """The target of a chip."""
    chip = chip_named(name)
    return Target(lambda order: deliver(chip, order), lambda order, folder: run(chip, order, folder))


def deliver(chip: Chip, order: Order) -> Delivery:
    """The folder; it has both precisions, whichever was asked for."""
    exports = exports_of(order.derivation, order.identity)
    return Delivery(folder_files(chip, exports.values()), Report())


def run(chip: Chip, order: Order, folder: Path, samples: int = SAMPLES) -> Report:
    """Build the folder, and run both precisions on the emulated processor.

    Args:
        chip: the processor.
        order: what was exported.
        folder: where it was written.
        samples: of the recorded run, at most.

    Raises:
        MissingToolError: a tool is absent.
        BuildError: it does not build.
        CheckFailed: the processor does something else than this machine, or than the equations.
    """
    tools = Tools.find(chip, order.environment)
    folder = folder.resolve()
    tools.build(folder)
    evaluator = _evaluator(order)
    start = MATCHED if order.derivation.model.gains.matched else ZERO
    recorded = record(evaluator, start, samples - 1)
    if isinstance(recorded, str):
        raise CheckFailed(recorded, where=chip.name)
    exports = exports_of(order.derivation, order.identity)
    bench = Bench(tools, folder, evaluator, recorded, start, samples)
    in_double, first = bench.measure(exports[DOUBLE.name])
    found = {DOUBLE.name: first}
    for kind in PRECISIONS:
        if kind != DOUBLE:
            answer, other = bench.measure(exports[kind.name])
            v, exact = answer.column("v"), in_double.column("v")
            deviation = float(np.max(np.abs(v - exact)) / np.max(np.abs(exact)))
            found[kind.name] = replace(other, v_deviation=deviation)
    calls = library_functions(exports[DOUBLE.name].program)
    return _report(chip, found, len(recorded.v[:samples]), calls)


def _evaluator(order: Order) -> Evaluator:
    """The kernels of the model's plant."""
    source = Source(order.file, order.document, environment=order.environment)
    return evaluator_of(source, order.notify or (lambda line: None))


@dataclass(frozen=True)
class Bench:
    """A built folder, and the run that its controllers are fed with.

    Attributes:
        tools: that built it.
        folder: where it is.
        evaluator: of the plant's kernels.
        recorded: the sampled run.
        start: of the controller.
        samples: at most.
    """

    tools: Tools
    folder: Path
    evaluator: Evaluator
    recorded: Recorded
    start: str
    samples: int

    def measure(self, export: Export) -> tuple[Answer, Measured]:
        """Everything about one precision; and its answers to the recorded run."""
        chip, kind = self.tools.chip, export.precision.name
        place, layout = self.folder / kind, Layout.of(Columns.of(export.program), export.precision)
        where = f"{chip.name}, {kind}"
        given = np.column_stack([self.recorded.reading, self.recorded.y_r])[: self.samples]
        emulated, native = self.tools.emulated(place), self.tools.native(place)
        answer = emulated.recorded(given, layout)
        check_counter(answer.header, chip)
        agreement = compare(export, given, answer, native.recorded(given, layout), where)
        asked, looped = self._closed(place, layout)
        inside = compare(
            export, asked, looped, native.recorded(asked, layout), f"{where}, in the closed loop"
        )
        deviation = float(np.max(np.abs(asked[:, 0] - self.recorded.reading[: len(asked)])))
        if kind == DOUBLE.name:
            self._check_followed(asked, deviation, where)
        instructions = answer.instructions(chip)
        sizes = self.tools.sections(place / f"{export.identity.prefix}.o")
        code = {
            name: size for name, size in sizes.items() if name.startswith((".text", ".rodata", ".srodata"))
        }
        tested = sum(size for name, size in code.items() if "self_test" in name or ".recorded" in name)
        return answer, Measured(
            values=agreement.values,
            other_bits=agreement.other_bits,
            step_over_bound=agreement.ratio,
            step_instructions=float(instructions.mean()),
            step_instructions_most=int(instructions.max()),
            init_instructions=answer.init_instructions(chip),
            step_stack=answer.step_stack,
            init_stack=answer.header["init_stack"],
            self_test_stack=answer.header["self_test_stack"],
            code=sum(code.values()) - tested,
            code_with_self_test=sum(code.values()),
            image=self.tools.sections(place / "pil.elf")[".text"],
            loop_samples=len(asked),
            loop_values=inside.values,
            loop_other_bits=inside.other_bits,
            loop_over_bound=inside.ratio,
            loop_deviation=deviation,
            v_deviation=0.0,
        )

    def _closed(self, place: Path, layout: Layout) -> tuple[Array, Answer]:
        """The processor in the loop: the samples that it was given, and its answers."""
        T = self.evaluator.manifest.simulation.sample_time
        rows = min(len(self.recorded.v), self.samples, _MOST)
        late = {name: 0.0 for key, name in self.evaluator.manifest.chain.items() if key == "jitter"}
        settings = make_settings(
            self.evaluator.manifest,
            parameters=late,
            horizon=(rows - 1) * T,
            output_step=T,
            controller="sampled",
            start=self.start,
        )
        places = [layout.columns.values.index(name) for name in ("v", "command", "u")]
        with self.tools.emulated(place).session(layout) as session:
            asked, _ = answered_run(
                self.evaluator, settings, lambda given: session.step(given)["values"][places].tolist()
            )
            return asked, session.answer

    def _check_followed(self, asked: Array, deviation: float, where: str) -> None:
        """Raise `CheckFailed` unless y is the simulated one up to the errors that both runs allow themselves.

        Both integrate each hold to the run's tolerance, so they may drift apart by twice that with each.
        """
        tolerance = make_settings(self.evaluator.manifest).tolerance
        allowed = 2.0 * len(asked) * tolerance * max(1.0, float(np.max(np.abs(asked[:, 0]))))
        if not deviation <= allowed:
            told = f"y leaves the simulated run by {deviation:.3g}, allowed {allowed:.3g}"
            raise CheckFailed(told, where=f"{where}, in the closed loop")


def _report(chip: Chip, found: Mapping[str, Measured], samples: int, calls: tuple[str, ...]) -> Report:
    """What is told of a run."""
    columns: dict[str, Any] = {name: asdict(item) for name, item in found.items()}
    record = {"chip": chip.title, "samples": samples, "library_functions": list(calls), **columns}
    called = ", ".join(calls) if calls else "none, so both machines must agree in every bit"
    width = max(len(label) for label, _, _ in _ROWS)
    lines = [
        f"{chip.title} under {chip.emulator}, {samples} samples; both self tests hold there",
        f"functions of the C library whose last places differ: {called}",
        f"{'':{width}}" + "".join(f"{name:>10}" for name in columns),
    ]
    for label, key, shape in _ROWS:
        cells = "".join(f"{format(values[key], shape):>10}" for values in columns.values())
        lines.append(f"{label:{width}}{cells}")
    return Report(record, tuple(lines))
