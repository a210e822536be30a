"""A derived running error bound on a kernel's result.

The emitted instruction list is evaluated at a point. With hats for computed values and ``e`` for bounds on
their errors, each operation propagates its operands' errors and adds its own rounding; the table of
operations gives the rule (`rounding`).

Inputs are exact. A literal of the code is a rounded exact number, unless it is a whole number that every
double near it could have been (up to 2^53; beyond, rounded ones are whole too). The bound is computed in
double precision itself; all its terms are positive, so one small factor per operation covers its own
roundings. See Higham, Accuracy and Stability of Numerical Algorithms (2002), 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pmjoint_codegen.check.oracles import rounding
from pmjoint_codegen.check.oracles.rounding import ROUNDOFF, Array, Bounded, Rule
from pmjoint_codegen.kernels.tape import Tape
from pmjoint_codegen.operations import by_name

INFLATION = 1 + 32 * ROUNDOFF  # each rule rounds fewer than 16 times
LITERAL_ROUNDINGS = (
    4  # a literal may be a quotient of rounded numbers that were folded when the code was generated
)


def walk(tape: Tape, arguments: Sequence[Array], literal_roundings: int = LITERAL_ROUNDINGS) -> list[Bounded]:
    """Evaluate an instruction list with bounds.

    Args:
        tape: the kernel's instructions.
        arguments: one for each input, shape (points, size); exact.
        literal_roundings: how many roundings a literal may contain; a Taylor kernel's ``1/k!`` is folded
            factor by factor.

    Returns:
        One for each output, arrays of shape (points, size).
    """
    points = len(arguments[0])
    outputs = [Bounded(np.zeros((points, size)), np.zeros((points, size))) for _, size in tape.outputs]
    values: list[Bounded] = []
    rules = {name: operation.rounding(rounding) for name, operation in by_name().items()}
    with np.errstate(all="ignore"):
        for item in tape.instructions:
            if item.operation == "output":
                result, entry, place = item.operands
                outputs[result].value[:, entry] = values[place].value
                outputs[result].error[:, entry] = values[place].error
            elif item.operation == "input":
                block, entry = item.operands
                values.append(Bounded(arguments[block][:, entry], np.zeros(points)))
            elif item.operation == "const":
                values.append(_literal(item.value, points, literal_roundings))
            else:
                values.append(_operate(rules[item.operation], [values[place] for place in item.operands]))
    return outputs


def _operate(rule: Rule, operands: list[Bounded]) -> Bounded:
    value, error = rule(*operands)
    finite = np.isfinite(value) & ~np.isnan(error)
    return Bounded(value, np.where(finite, error * INFLATION, np.inf))


def _literal(value: float, points: int, roundings: int) -> Bounded:
    exact = float(value).is_integer() and abs(value) <= 2.0**53  # beyond, a rounded number is whole as well
    error = 0.0 if exact else roundings * ROUNDOFF * abs(value) * INFLATION
    return Bounded(np.full(points, float(value)), np.full(points, error))
