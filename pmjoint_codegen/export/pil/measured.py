"""What a run on a processor measures, as a record and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from pmjoint_codegen.export.elsewhere import library_functions
from pmjoint_codegen.export.fields import model_y
from pmjoint_codegen.export.pil.chips import Chip
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.targets.target import Report


@dataclass(frozen=True)
class Measured:
    """One precision on a processor.

    Attributes:
        values: compared with this machine's, in the recorded run.
        other_bits: of them with other bits.
        step_over_bound: largest difference of a step from the same equations evaluated by NumPy in double,
            relative to the derived bound on the rounding errors of both.
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
    ("largest difference from NumPy / bound", "step_over_bound", ".2g"),
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
    ("closed loop: difference from NumPy / bound", "loop_over_bound", ".2g"),
    ("closed loop: largest |y - simulated y| [{}]", "loop_deviation", ".2g"),
)


def report_of(chip: Chip, program: Program, found: Mapping[str, Measured], samples: int) -> Report:
    """What is told of a run."""
    calls, unit = library_functions(program), model_y(program)
    columns: dict[str, Any] = {name: asdict(item) for name, item in found.items()}
    told = {
        "chip": chip.title,
        "samples": samples,
        "library_functions": list(calls),
        "y_unit": unit,
        **columns,
    }
    called = ", ".join(calls) if calls else "none, so both machines must agree in every bit"
    rows = [(label.format(unit), key, shape) for label, key, shape in _ROWS]
    width = max(len(label) for label, _, _ in rows)
    lines = [
        f"{chip.title} under {chip.emulator}, {samples} samples; both self tests hold there",
        f"functions of the C library whose last places differ: {called}",
        f"{'':{width}}" + "".join(f"{name:>10}" for name in columns),
    ]
    for label, key, shape in rows:
        cells = "".join(f"{format(values[key], shape):>10}" for values in columns.values())
        lines.append(f"{label:{width}}{cells}")
    return Report(told, tuple(lines))
