"""The arithmetic that a function over lanes must do, evaluated along its tape in NumPy.

What NumPy does here is exact by IEEE 754: sums, products, quotients, square roots, choices. Sine, cosine,
exponential, logarithm and the like are the lanes' own, called one by one. ``lanes.c`` departs from the tape
in two rules: a repeated divisor is inverted once, and its inverse multiplied; and sine and cosine of one
argument are computed together, which changes no bit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from pmjoint_codegen.kernels.evaluator import Array
from pmjoint_codegen.kernels.tape import Instruction, Tape
from pmjoint_codegen.operations import by_name

Operation = Callable[..., Array]
Name = tuple[int, ...]  # of a value: (argument, entry) of an input, or (position,)


def walk(tape: Tape, arguments: Sequence[Array], elementary: Mapping[str, Operation]) -> tuple[Array, ...]:
    """Evaluate a tape on rows.

    Args:
        tape: of a function over lanes.
        arguments: one per input, shape (points, size).
        elementary: the lanes' functions by the tape's names, on arrays of shape (points,).

    Returns:
        One array per result, shape (points, size).
    """
    points = len(arguments[0])
    results = tuple(np.zeros((points, size)) for _, size in tape.outputs)
    operations = {**_exact(), **elementary}
    names = _names(tape)
    often = _often(tape, names)
    values: list[Array] = []
    with np.errstate(all="ignore"):
        for item in tape.instructions:
            operands = item.operands
            if item.operation == "output":
                results[operands[0]][:, operands[1]] = values[operands[2]]
            elif item.operation == "input":
                values.append(arguments[operands[0]][:, operands[1]])
            elif item.operation == "const":
                values.append(np.full(points, item.value))
            elif item.operation == "div" and names[operands[1]] in often:
                values.append(values[operands[0]] * (1.0 / values[operands[1]]))
            else:
                values.append(operations[item.operation](*(values[operand] for operand in operands)))
    return results


def _names(tape: Tape) -> list[Name]:
    """A name for every value; an entry of an argument keeps its name however often it is read."""
    defining = [item for item in tape.instructions if item.operation != "output"]
    return [
        item.operands if item.operation == "input" else (position,) for position, item in enumerate(defining)
    ]


def _often(tape: Tape, names: Sequence[Name]) -> frozenset[Name]:
    """Divisors of more than one quotient, without literals."""
    defining = [item for item in tape.instructions if item.operation != "output"]
    divided = Counter(names[item.operands[1]] for item in defining if _moves(item, defining))
    return frozenset(name for name, count in divided.items() if count > 1)


def _moves(item: Instruction, defining: Sequence[Instruction]) -> bool:
    return item.operation == "div" and defining[item.operands[1]].operation != "const"


def _choose(where: npt.NDArray[np.bool_], a: Array, b: Array) -> Array:
    return np.asarray(np.where(where, a, b), dtype=np.float64)


def _exact() -> Mapping[str, Operation]:
    """Operations that are exact by IEEE 754; choices of two zeros, and with NaN, are those of the lanes."""
    exact = {name: row.of(np) for name, row in by_name().items() if row.exact}
    return exact | {
        "fmin": lambda a, b: _choose(a < b, a, b),  # of two zeros, and with NaN, the second
        "fmax": lambda a, b: _choose(a > b, a, b),
        "fabs": lambda a: _choose(a > -a, a, -a),
        "sign": lambda a: np.select([a > 0.0, a < 0.0], [1.0, -1.0], 0.0),
    }
