"""The exported folder: a derivation in, file name -> text out."""

from __future__ import annotations

from dataclasses import dataclass

from pmjoint_codegen.export.companions import companion_files
from pmjoint_codegen.export.hold import COMPUTED
from pmjoint_codegen.export.program import Program
from pmjoint_codegen.export.recording import recorded, self_test_lines
from pmjoint_codegen.export.source import Identity, header_text, joined, source_lines
from pmjoint_codegen.export.statements import program_of
from pmjoint_codegen.export.trace import trace_of, trace_text
from pmjoint_codegen.export.tree import DOUBLE, Precision
from pmjoint_derive import Derivation

TRACE = "trace.json"


@dataclass(frozen=True)
class Export:
    """An exported controller.

    Attributes:
        program: its statements.
        identity: names and hash.
        precision: of its numbers.
        files: name -> text.
    """

    program: Program
    identity: Identity
    precision: Precision
    files: dict[str, str]

    @property
    def source(self) -> str:
        """The C file's text."""
        return self.files[f"{self.identity.prefix}.c"]


@dataclass(frozen=True)
class Cost:
    """What a precision costs in v, over the samples of the self test.

    Attributes:
        bound: derived bound on the error of v.
        largest: the largest |v|.
    """

    bound: float
    largest: float


def cost_of(program: Program, precision: Precision) -> Cost:
    """The largest tolerance of v in the self test's data, and the largest |v| there."""
    samples = [sample for start in (False, True) for sample in recorded(program, precision, matched=start)]
    return Cost(max(item.tolerance[0] for item in samples), max(abs(item.expected[0]) for item in samples))


def export_c(
    derivation: Derivation, identity: Identity, precision: Precision = DOUBLE, hold: str = COMPUTED
) -> Export:
    """The controller of a derivation as a folder of C.

    Args:
        derivation: of the model.
        identity: names and hash.
        precision: double or float.
        hold: its matrices are `COMPUTED` by init, or `BAKED` in for the model's own sample time and gains.
    """
    program = program_of(derivation)
    lines = source_lines(program, identity, precision, self_test_lines(program, identity, precision), hold)
    source = f"{identity.prefix}.c"
    files = {
        source: joined(lines),
        f"{identity.prefix}.h": header_text(program, identity, precision, hold),
        TRACE: trace_text(trace_of(lines, source)),
        **companion_files(program, identity, precision, hold),
    }
    return Export(program, identity, precision, files)
