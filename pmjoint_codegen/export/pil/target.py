"""Targets that are processors: the folder, and what a run of it on the emulated processor measures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from pmjoint_codegen.closed_loop import Source, evaluator_of
from pmjoint_codegen.errors import CheckFailed
from pmjoint_codegen.export.package import Export
from pmjoint_codegen.export.pil.chips import Chip, chip_named
from pmjoint_codegen.export.pil.compare import compare
from pmjoint_codegen.export.pil.folder import PRECISIONS, Columns, exports_of, folder_files
from pmjoint_codegen.export.pil.machine import Tools
from pmjoint_codegen.export.pil.measured import Measured, report_of
from pmjoint_codegen.export.pil.plant import answered_run
from pmjoint_codegen.export.pil.records import Answer, Array, Layout, check_counter
from pmjoint_codegen.export.targets.target import Delivery, Order, Report, Target
from pmjoint_codegen.export.tree import DOUBLE
from pmjoint_codegen.kernels.evaluator import Evaluator
from pmjoint_codegen.simulate.samples import Recorded, record
from pmjoint_codegen.simulate.settings import make_settings
from pmjoint_codegen.values import MATCHED, ZERO

SAMPLES: Final = 10_000
_CODE: Final = (".text", ".rodata", ".srodata")
# Where these turn a rounding error into a step of the encoder, or of the command, runs part for good.
_JUMPING: Final = frozenset({"resolution", "dead_zone"})
_MOST: Final = 3000  # samples of a closed loop: its plant takes 0.5 ms for each


def target_of(name: str) -> Target:
    """The target of a chip."""
    chip = chip_named(name)
    return Target(
        lambda order: deliver(chip, order), lambda order, folder: run(chip, order, folder), bakes=True
    )


def deliver(chip: Chip, order: Order) -> Delivery:
    """The folder; it has both precisions, whichever was asked for."""
    exports = exports_of(order.derivation, order.identity, order.hold)
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
    exports = exports_of(order.derivation, order.identity, order.hold)
    bench = Bench(tools, folder, evaluator, recorded, start, samples)
    in_double, first = bench.measure(exports[DOUBLE.name])
    found = {DOUBLE.name: first}
    for kind in PRECISIONS:
        if kind != DOUBLE:
            answer, other = bench.measure(exports[kind.name])
            v, exact = answer.column("v"), in_double.column("v")
            deviation = float(np.max(np.abs(v - exact)) / np.max(np.abs(exact)))
            found[kind.name] = replace(other, v_deviation=deviation)
    return report_of(chip, exports[DOUBLE.name].program, found, len(recorded.v[:samples]))


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
        if kind == DOUBLE.name and _JUMPING.isdisjoint(self.evaluator.manifest.chain):
            self._check_followed(asked, deviation, where)
        instructions = answer.instructions(chip)
        code, tested = self._code(place / f"{export.identity.prefix}.o")
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
            code=code - tested,
            code_with_self_test=code,
            image=self.tools.sections(place / "pil.elf")[".text"],
            loop_samples=len(asked),
            loop_values=inside.values,
            loop_other_bits=inside.other_bits,
            loop_over_bound=inside.ratio,
            loop_deviation=deviation,
            v_deviation=0.0,
        )

    def _code(self, file: Path) -> tuple[int, int]:
        """Bytes of an object's code and numbers, not of its name and hash; of them those of the self test."""
        sizes = self.tools.sections(file)
        code = {name: size for name, size in sizes.items() if name.startswith(_CODE) and ".str" not in name}
        tested = (size for name, size in code.items() if "self_test" in name or ".recorded" in name)
        return sum(code.values()), sum(tested)

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
