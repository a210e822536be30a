"""``kernels.tape``: the kernels as lists of elementary operations, in text that a person can read and diff.

    law y[1] s[8] y_r[3] p[12] -> z[2] alpha[1] v[1]
    0 input 0 0
    1 const 0x1.8p+1
    2 mul 0 1
    output 0 0 2

A line ``k operation operands`` defines value k; operands are earlier values, except for ``input`` (argument,
entry) and ``const`` (a hexadecimal double, exact). ``output result entry k`` returns value k. These are
CasADi's own instructions in their order, so that any reader of the tape does the same arithmetic as the C.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from pmjoint_codegen.operations import Operation, by_name

FILE_NAME = "kernels.tape"


@dataclass(frozen=True)
class Instruction:
    """One line of a tape.

    Attributes:
        operation: ``input``, ``const``, ``output`` or the name of a row of `operations`.
        operands: argument and entry of an input, earlier values of an operation, result, entry and value of
            an output.
        value: of a constant.
    """

    operation: str
    operands: tuple[int, ...]
    value: float = 0.0


@dataclass(frozen=True)
class Tape:
    """One kernel.

    Attributes:
        name: of the kernel.
        inputs: (label, length) of each argument.
        outputs: (label, length) of each result.
        instructions: in order; all but outputs define values 0, 1, 2, ...
    """

    name: str
    inputs: tuple[tuple[str, int], ...]
    outputs: tuple[tuple[str, int], ...]
    instructions: tuple[Instruction, ...]


def write_tapes(tapes: Iterable[Tape]) -> str:
    """The file's text, one block per kernel."""
    return "\n".join("\n".join([_head(tape), *_lines(tape), ""]) for tape in tapes)


def _head(tape: Tape) -> str:
    inputs, outputs = (
        " ".join(f"{label}[{size}]" for label, size in side) for side in (tape.inputs, tape.outputs)
    )
    return f"{tape.name} {inputs} -> {outputs}"


def _lines(tape: Tape) -> Iterator[str]:
    count = 0
    for item in tape.instructions:
        if item.operation == "output":
            yield " ".join(["output", *map(str, item.operands)])
            continue
        rest = [item.value.hex()] if item.operation == "const" else map(str, item.operands)
        yield " ".join([str(count), item.operation, *rest])
        count += 1


def read_tapes(text: str) -> dict[str, Tape]:
    """Parse the file's text; lines that begin with ``#`` state its origin.

    Raises:
        ValueError: for text that is not a list of tapes; the message names the line.
    """
    body = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    blocks = [block.strip().splitlines() for block in body.split("\n\n") if block.strip()]
    known = by_name()
    tapes = [_read_block(lines, known) for lines in blocks]
    return {tape.name: tape for tape in tapes}


def _read_block(lines: list[str], operations: Mapping[str, Operation]) -> Tape:
    name, *rest = lines[0].split(" ")
    arrow = rest.index("->")
    instructions = []
    count = 0
    for line in lines[1:]:
        instructions.append(_read_line(line, count, operations))
        count += instructions[-1].operation != "output"
    return Tape(name, _sizes(rest[:arrow]), _sizes(rest[arrow + 1 :]), tuple(instructions))


def _sizes(words: list[str]) -> tuple[tuple[str, int], ...]:
    pairs = (word.rstrip("]").split("[") for word in words if word)
    return tuple((label, int(size)) for label, size in pairs)


def _read_line(line: str, count: int, operations: Mapping[str, Operation]) -> Instruction:
    first, *rest = line.split(" ")
    if first == "output":
        result, entry, value = map(int, rest)
        known = value < count
        instruction = Instruction("output", (result, entry, value))
    elif rest[0] == "const":
        known = first == str(count)
        instruction = Instruction("const", (), float.fromhex(rest[1]))
    else:
        operands = tuple(map(int, rest[1:]))
        reads = rest[0] == "input"
        known = first == str(count) and (reads or rest[0] in operations)
        known = known and len(operands) == (2 if reads else operations[rest[0]].arity)
        known = known and (reads or all(operand < count for operand in operands))
        instruction = Instruction(rest[0], operands)
    if not known:
        raise ValueError(f"line {line!r} is not an instruction of a tape")
    return instruction
