"""The folder of a processor: the controller in both precisions, start-up code, and what feeds it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pmjoint_codegen.export.fields import INTEGER, input_fields, output_fields
from pmjoint_codegen.export.hold import COMPUTED
from pmjoint_codegen.export.lines import comment
from pmjoint_codegen.export.package import TRACE, Export, export_c
from pmjoint_codegen.export.pil.chips import Chip
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.source import Identity, banner, joined, replaced, words_of
from pmjoint_codegen.export.tree import DOUBLE, FLOAT
from pmjoint_derive import Derivation

TEMPLATES: Final = Path(__file__).parent / "c"
PRECISIONS: Final = (DOUBLE, FLOAT)
_SHARED: Final = ("semihosting.c", "semihosting.h", "host.c")
_OWN: Final = ("start.c", "link.ld")


@dataclass(frozen=True)
class Columns:
    """What stands in the records of ``input.bin`` and ``output.bin``, by the names of the C structures.

    Attributes:
        given: fields of the input.
        states: fields of the state.
        outputs: fields of the output.
    """

    given: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def of(cls, program: Program) -> Columns:
        """The columns of a controller."""
        left_out = ("use_measured_u", "u_measured")
        return cls(
            tuple(item.name for item in input_fields(program) if item.name not in left_out),
            (*(symbol.name for symbol in program.states), "y"),
            tuple(item.name for item in output_fields(program) if item.kind != INTEGER),
        )

    @property
    def values(self) -> tuple[str, ...]:
        """The numbers of a record of ``output.bin``."""
        return (*self.states, *self.outputs)


def exports_of(derivation: Derivation, identity: Identity, hold: str = COMPUTED) -> dict[str, Export]:
    """The controller in every precision, by its name."""
    return {kind.name: export_c(derivation, identity, kind, hold) for kind in PRECISIONS}


def folder_files(chip: Chip, exports: Iterable[Export]) -> dict[str, str]:
    """Path inside the folder -> text.

    Args:
        chip: the processor.
        exports: one for each precision.
    """
    files = {name: _text(name) for name in _SHARED}
    files |= {name: _text(f"{chip.name}/{name}") for name in _OWN}
    files["chip.h"] = replaced(_text("chip.h.in"), {"mask": f"0x{chip.mask:X}"})
    for export in exports:
        prefix, place = export.identity.prefix, export.precision.name
        names = (f"{prefix}.c", f"{prefix}.h", TRACE)
        files |= {f"{place}/{name}": export.files[name] for name in names}
        files[f"{place}/pil.c"] = _program(export)
        for name in ("Makefile", "README.md"):  # of which each precision gives the same
            files[name] = replaced(_text(f"{name}.in"), _words(chip, export))
    return files


def _text(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _words(chip: Chip, export: Export) -> dict[str, str]:
    return {
        "name": export.identity.prefix,
        "model": comment(export.identity.model),
        "hash": export.identity.model_hash,
        "version": export.identity.version,
        "chip": chip.title,
        "target": chip.name,
        "compiler": chip.compiler,
        "flags": chip.flags,
        "emulator": chip.emulator,
        "emulation": chip.emulation,
        "packages": chip.packages,
    }


def _program(export: Export) -> str:
    """The program that feeds a controller."""
    program, precision = export.program, export.precision
    columns = Columns.of(program)
    sources = [*(f"state->{name}" for name in columns.states), *(f"out->{name}" for name in columns.outputs)]
    words = {
        **words_of(program, export.identity, precision),
        "banner": joined(banner(program, export.identity, precision)).rstrip(),
        "inputs": str(len(columns.given)),
        "values": str(len(columns.values)),
        "take": "\n".join(f"    in->{name} = given[{i}];" for i, name in enumerate(columns.given)),
        "show": "\n".join(f"    values[{i}] = {source};" for i, source in enumerate(sources)),
    }
    return replaced(_text("pil.c.in"), words)
