"""C text of tapes as straight lines: every value is one named constant.

So the compiler sees arithmetic without calls through pointers, branches or checks. A dialect defines the type
of a value, a double or a vector of doubles, and the column of the table of operations that spells an
operation on it. Every literal, also in a column, is written by the dialect: with float32, none is a double.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.operations import Operation, by_name

MARGIN = 118
_LITERAL = re.compile(r"(?<![\w.])\d+\.\d+(?![\w.])")  # in a column of the table

Operand = str | float


@dataclass(frozen=True)
class Dialect:
    """How values and operations are written.

    Attributes:
        number: C type of a value.
        spelling: column of the table.
        literal: writes a number.
        fill: a literal as a value, where C's operators would not convert it.
        together: two operations on one operand -> the call that gives both results.
        inverts: whether a divisor that occurs more than once is inverted once.
        arrays: name of an argument -> what is read from; entries are then read into constants, at their first
            use, so that no store can change them.
    """

    number: str
    spelling: Callable[[Operation], str]
    literal: Callable[[float], str] = repr
    fill: str = "{}"
    together: Mapping[tuple[str, str], str] = field(default_factory=dict)
    inverts: bool = False
    arrays: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Step:
    """One operation with a name for what it defines.

    Attributes:
        operation: name in the table, or ``output``.
        result: name of the constant that it defines, or the place that it writes.
        operands: names of constants, places that it reads, or literals.
    """

    operation: str
    result: str
    operands: tuple[Operand, ...]


def steps(tape: Tape) -> list[Step]:
    """A tape's operations and outputs in order."""
    values: list[Operand] = []
    found: list[Step] = []
    for item in tape.instructions:
        if item.operation == "input":
            values.append(f"{tape.inputs[item.operands[0]][0]}[{item.operands[1]}]")
        elif item.operation == "const":
            values.append(item.value)
        elif item.operation == "output":
            result, entry, value = item.operands
            found.append(Step("output", f"{tape.outputs[result][0]}[{entry}]", (values[value],)))
        else:
            name = f"a{len(found)}"
            found.append(Step(item.operation, name, tuple(values[operand] for operand in item.operands)))
            values.append(name)
    return found


def print_c(tape: Tape, dialect: Dialect) -> list[str]:
    """The statements of a function's body.

    Args:
        tape: of the function.
        dialect: how they are written.
    """
    listing = list(_arranged(steps(tape), dialect))
    pairs = _pairs(listing, dialect)
    templates = {name: _typed(item, dialect) for name, item in by_name().items()}
    templates |= {"read": "{0}", "output": "{0}"}
    lines: dict[str, None] = {}  # what several steps need is the same line, and stands before the first
    for step in listing:
        together = pairs.get((step.operation, step.operands[0]))
        lines |= dict.fromkeys(together or (_statement(step, dialect, templates[step.operation]),))
    return list(lines)


def _arranged(listing: Sequence[Step], dialect: Dialect) -> Iterator[Step]:
    """The steps in a dialect: entries read into constants, common divisors inverted once."""
    divisors = Counter(step.operands[1] for step in listing if step.operation == "div")
    for step in listing:
        operands: list[Operand] = []
        for operand in step.operands:
            label, _, entry = str(operand).rstrip("]").partition("[")
            taken = entry and label in dialect.arrays
            operands.append(f"{label}_{entry}" if taken else operand)
            if taken:
                yield Step("read", f"{label}_{entry}", (f"{dialect.arrays[label]}[{entry}]",))
        divisor = step.operands[-1]
        if dialect.inverts and step.operation == "div" and isinstance(divisor, str) and divisors[divisor] > 1:
            inverse = "inverse_" + divisor.replace("[", "_").replace("]", "")
            yield Step("inv", inverse, (operands[1],))
            yield Step("mul", step.result, (operands[0], inverse))
        else:
            yield replace(step, operands=tuple(operands))


def _typed(operation: Operation, dialect: Dialect) -> str:
    """An operation's spelling with its literals as the dialect writes them."""
    return _LITERAL.sub(lambda found: dialect.literal(float(found[0])), dialect.spelling(operation))


def _pairs(listing: Sequence[Step], dialect: Dialect) -> Mapping[tuple[str, Operand], tuple[str, ...]]:
    """Operation and operand of each step that another one is computed with -> the lines for both."""
    found: dict[tuple[str, Operand], tuple[str, ...]] = {}
    for operations, call in dialect.together.items():
        first, second = (
            {step.operands[0]: step.result for step in listing if step.operation == name}
            for name in operations
        )
        for operand in first.keys() & second.keys():
            names = first[operand], second[operand]
            declared = (f"{dialect.number} {name};" for name in names)
            lines = (*declared, f"{call}({operand}, &{names[0]}, &{names[1]});")
            found |= {(name, operand): lines for name in operations}
    return found


def _statement(step: Step, dialect: Dialect, template: str) -> str:
    """One step as one line of C; a call and a result take values alone."""
    literal = dialect.fill if "(" in template or step.operation == "output" else "{}"
    value = template.format(
        *(
            literal.format(dialect.literal(operand)) if isinstance(operand, float) else operand
            for operand in step.operands
        )
    )
    place = step.result if step.operation == "output" else f"const {dialect.number} {step.result}"
    return f"{place} = {value};"


def definition(tape: Tape, head: str, lines: Sequence[str]) -> str:
    """A function's C: its head, then the lines that its tape was printed as."""
    read = {str(operand).partition("[")[0] for step in steps(tape) for operand in step.operands}
    unused = [f"(void){label};" for label, _ in tape.inputs if label not in read]
    body = "\n".join(f"    {line}" for line in [*unused, *lines])
    return f"{head}\n{{\n{body}\n}}"


def signature(tape: Tape, opening: str, number: str) -> str:
    """A function's head: a pointer an input, a restricted pointer an output, lines broken at the margin.

    Args:
        tape: of the function.
        opening: everything up to the first argument.
        number: C type of a value.
    """
    inputs = [f"const {number} *{name}" for name, _ in tape.inputs]
    outputs = [f"{number} *restrict {name}" for name, _ in tape.outputs]
    lines = [opening]
    for position, argument in enumerate([*inputs, *outputs]):
        comma = ", " if position else ""
        if len(lines[-1]) + len(comma + argument) > MARGIN:
            lines[-1] += ","
            lines.append(" " * len(opening) + argument)
        else:
            lines[-1] += comma + argument
    return "\n".join(lines) + ")"
