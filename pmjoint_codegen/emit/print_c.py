"""C text of tapes as straight lines: every value is one named constant.

So the compiler sees arithmetic without calls through pointers, branches or checks. A dialect says what a
value is, a double or a vector of them, and which column of the table of operations spells an operation on it.
No literal reaches the text but through the dialect, those in a column included: on float32, none is a double.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

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
        fill: a literal as a value, where C's operators would not make it one.
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
    listing = steps(tape)
    templates = {name: _typed(item, dialect) for name, item in by_name().items()}
    pairs, often = _pairs(listing, dialect), _often(listing) if dialect.inverts else frozenset()
    lines: list[str] = []
    done: set[str] = set()
    for step in listing:
        for line in _before(step, dialect, templates, pairs, often):
            if line not in done:
                done.add(line)
                lines.append(line)
        if (step.operation, step.operands[0]) not in pairs:
            lines.append(_statement(step, dialect, templates, often))
    return lines


def _typed(operation: Operation, dialect: Dialect) -> str:
    """An operation's spelling with its literals as the dialect writes them."""
    return _LITERAL.sub(lambda found: dialect.literal(float(found[0])), dialect.spelling(operation))


Pairs = Mapping[tuple[str, Operand], tuple[str, ...]]


def _pairs(listing: Sequence[Step], dialect: Dialect) -> Pairs:
    """Operation and operand of each step that another one is computed with -> the lines for both."""
    found: dict[tuple[str, Operand], tuple[str, ...]] = {}
    for operations, call in dialect.together.items():
        first, second = (
            {step.operands[0]: step.result for step in listing if step.operation == name}
            for name in operations
        )
        for operand in first.keys() & second.keys():
            one, other = first[operand], second[operand]
            declared = [f"{dialect.number} {name};" for name in (one, other)]
            lines = (*declared, f"{call}({_written(operand, dialect)}, &{one}, &{other});")
            found |= {(name, operand): lines for name in operations}
    return found


def _often(listing: Sequence[Step]) -> frozenset[Operand]:
    """Divisors of more than one quotient, literals left out."""
    divisors = Counter(step.operands[1] for step in listing if step.operation == "div")
    return frozenset(name for name, count in divisors.items() if count > 1 and isinstance(name, str))


def _before(
    step: Step,
    dialect: Dialect,
    templates: Mapping[str, str],
    pairs: Pairs,
    often: frozenset[Operand],
) -> Iterator[str]:
    """What a step needs, each line once: entries read, a divisor inverted, two results computed together."""
    for operand in step.operands:
        label, _, entry = str(operand).partition("[")
        if entry and label in dialect.arrays:
            name = _written(operand, dialect)
            yield f"const {dialect.number} {name} = {dialect.arrays[label]}[{entry};"
    if step.operation == "div" and step.operands[1] in often:
        divisor = _written(step.operands[1], dialect)
        yield f"const {dialect.number} {_inverse(divisor)} = {templates['inv'].format(divisor)};"
    if (step.operation, step.operands[0]) in pairs:
        yield from pairs[step.operation, step.operands[0]]


def _statement(step: Step, dialect: Dialect, templates: Mapping[str, str], often: frozenset[Operand]) -> str:
    """One step as one line of C."""
    if step.operation == "output":
        return f"{step.result} = {_written(step.operands[0], dialect, filled=True)};"
    template = templates[step.operation]
    if step.operation == "div" and step.operands[1] in often:
        inverse = _inverse(_written(step.operands[1], dialect))
        value = templates["mul"].format(_written(step.operands[0], dialect), inverse)
    else:
        filled = "(" in template  # a call takes values alone
        value = template.format(*(_written(operand, dialect, filled=filled) for operand in step.operands))
    return f"const {dialect.number} {step.result} = {value};"


def _written(operand: Operand, dialect: Dialect, *, filled: bool = False) -> str:
    """An operand as it stands in C."""
    if isinstance(operand, float):
        return (dialect.fill if filled else "{}").format(dialect.literal(operand))
    label, bracket, entry = operand.rstrip("]").partition("[")
    return f"{label}_{entry}" if bracket and label in dialect.arrays else operand


def _inverse(divisor: str) -> str:
    return "inverse_" + divisor.replace("[", "_").replace("]", "")


def definition(tape: Tape, head: str, dialect: Dialect) -> str:
    """A function's C: its head, then what its tape does."""
    read = {str(operand).partition("[")[0] for step in steps(tape) for operand in step.operands}
    unused = [f"(void){label};" for label, _ in tape.inputs if label not in read]
    body = "\n".join(f"    {line}" for line in [*unused, *print_c(tape, dialect)])
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
