"""The text of a tape: read back as written, and refused where it is none."""

from __future__ import annotations

import pytest

from pmjoint_codegen.kernels.tape import Instruction, Tape, read_tapes, write_tapes

TAPE = Tape(
    "law",
    (("y", 1), ("p", 2)),
    (("v", 1), ("none", 0)),
    (
        Instruction("input", (1, 0)),
        Instruction("const", (), 0.1),
        Instruction("mul", (0, 1)),
        Instruction("output", (0, 0, 2)),
    ),
)
TEXT = """\
law y[1] p[2] -> v[1] none[0]
0 input 1 0
1 const 0x1.999999999999ap-4
2 mul 0 1
output 0 0 2
"""


def test_text() -> None:
    assert write_tapes([TAPE]) == TEXT
    assert read_tapes(TEXT) == {"law": TAPE}


def test_blocks_are_apart() -> None:
    other = Tape("plant", TAPE.inputs, TAPE.outputs, TAPE.instructions)
    assert read_tapes(write_tapes([TAPE, other])) == {"law": TAPE, "plant": other}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("2 mul 0 1", "2 mul 0 2"),  # reads a value that is not there yet
        ("2 mul 0 1", "3 mul 0 1"),  # skips a number
        ("2 mul 0 1", "2 mul 0"),
        ("2 mul 0 1", "2 system 0 1"),
        ("output 0 0 2", "output 0 0 3"),
        ("0 input 1 0", "0 input 1"),
    ],
)
def test_what_is_no_tape_is_refused_with_its_line(old: str, new: str) -> None:
    with pytest.raises(ValueError, match=new):
        read_tapes(TEXT.replace(old, new))
